//! What chance reaches on two scans, from the mirror image of the source.
//!
//! A scan is never the mirror image of what another scanner saw, but has the same densities, planes, repetition and noise. So the best
//! pose of the mirrored source shows how much evidence a wrong pose of these scans can have: target-decoy competition, as for
//! spectra of peptides (Elias and Gygi, Nature Methods 2007).

use std::sync::OnceLock;

use nalgebra::{Matrix3, Vector3};

use crate::error::Result;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::pose_graph::motion::{compose, inverse};
use crate::verification::{align_by, score_poses};

use super::clock::Stage;
use super::evidence::{Evidence, misfit};
use super::lazy::lazily;
use super::level::{FinePair, Pair};
use super::posterior::{Case, share_probability};
use super::proposals::VoxelMatches;
use super::search::Run;
use super::settings::{
    CHANCE_OF_SYMMETRY, CHANCE_SHARE, CLOSELY, DECOYS, KEPT, LEAD_BY_CHANCE, LEAST_CHANCE,
    MISFIT_OF_SYMMETRY, ROUGHLY,
};

/// The best pose of the mirrored source, as a mirrored rotation of the source itself.
#[derive(Debug, Clone, Copy)]
pub struct Decoy {
    case: Case,
    /// Sum of the probabilities of its rivals, as multiples of its own.
    rivals: f64,
    pose: Rigid,
}

impl Decoy {
    /// Returns the probability of this pose, with the best pose of the source as what chance reaches.
    pub fn probability(&self, best: &Case) -> f64 {
        1.0 / (1.0 / self.case.as_decoy(best) + self.rivals)
    }
}

/// What chance reaches on two scans.
#[derive(Debug, Clone, Copy)]
pub struct Chance {
    /// Nats against a pose.
    pub nats: f64,
    /// The mirrored pose, unless it is a symmetry of the scan.
    pub decoy: Option<Decoy>,
}

impl Run<'_> {
    /// Returns the nats that chance reaches on these scans, and the mirrored pose that reaches them.
    ///
    /// If the scan is its own mirror image, a pose and a mirrored one both align it; then the mirrored one counts little.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub(super) fn chance(&self, pose: &Rigid) -> Result<Chance> {
        let Some(decoy) = self.decoy()? else {
            return Ok(Chance { nats: CHANCE_SHARE * LEAST_CHANCE, decoy: None });
        };
        let (nats, surfaces) = (decoy.case.chance_nats(), decoy.case.lead_of_surfaces());
        let is_a_symmetry = nats > CHANCE_OF_SYMMETRY
            && self.symmetry(&compose(&inverse(pose), &decoy.pose))?.is_some_and(|itself| {
                itself.misfit < MISFIT_OF_SYMMETRY && itself.lead_of_surfaces() >= surfaces - LEAD_BY_CHANCE
            });
        self.clock.end(Stage::Evidence);
        Ok(if is_a_symmetry {
            Chance { nats: CHANCE_OF_SYMMETRY, decoy: None }
        } else {
            Chance { nats, decoy: Some(decoy) }
        })
    }

    /// Returns the evidence that a mirrored rotation maps the source onto itself; none if nothing is paired.
    fn symmetry(&self, itself: &Rigid) -> Result<Option<Case>> {
        let pair = Pair { target: self.pair.source, ..self.pair };
        let fine = FinePair { target: self.fine.source, ..self.fine };
        let found = align_by(fine.source, fine.target, itself, &[ROUGHLY, CLOSELY], self.execution)?;
        if found.residuals.is_empty() {
            return Ok(None);
        }
        let surface = pair.source.surface();
        let score = score_poses(surface, surface, &[found.pose], self.execution)?[0];
        let evidence = Evidence::gather(pair, fine, &found.pose, self.execution)?;
        let misfit = misfit(&found, pair.voxel())?;
        Ok(Some(Case { score, support: 0, misfit, evidence, chance: None }))
    }

    /// Returns the best pose of the mirrored source, from its mutual matches; none if there is none.
    fn decoy(&self) -> Result<Option<Decoy>> {
        let found = lazily(&self.decoy, || {
            let mirror = mirror_along(self.options.axis);
            let matches = VoxelMatches::find(self.pair, 1, Some(mirror), self.execution)?;
            self.clock.end(Stage::Matching);
            let run = Run { matches, decoy: OnceLock::new(), ..*self };
            let mut verified = run.verify(&run.propose()?, KEPT.1)?;
            verified.truncate(DECOYS);
            let mut finalists = run.settle(&verified)?;
            let rows = run.gather(&mut finalists)?;
            self.clock.end(Stage::Evidence);
            let cases = memory::collect(rows.iter().filter_map(|&row| finalists[row].case))?;
            let mut shares = Vec::new();
            share_probability(&cases, 1, &mut shares);
            let (Some(&row), Some(&case)) = (rows.first(), cases.first()) else { return Ok(None) };
            Ok(Some(Decoy { case, rivals: shares.iter().sum(), pose: finalists[row].found.pose }))
        });
        found.copied()
    }
}

/// Returns the mirror image at a plane through an axis, if one is given.
fn mirror_along(axis: Option<[f64; 3]>) -> Matrix3<f64> {
    let axis = Vector3::from(axis.unwrap_or([0.0, 0.0, 1.0]));
    let across = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).try_normalize(0.0).unwrap_or_else(Vector3::y);
    Matrix3::identity() - 2.0 * across * across.transpose()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::cloud::Cloud;
    use crate::execution::Execution;
    use crate::registration::{Options, Outcome, Prepared, register};

    /// Heights of 150 x 150 points, 1 apart, above the plane of x and y.
    fn heights(height: impl Fn(f64, f64) -> f64) -> Vec<[f64; 3]> {
        let place = |i: u32| (f64::from(i % 150) - 74.5, f64::from(i / 150) - 74.5);
        (0..22_500).map(place).map(|(x, y)| [x, y, height(x, y)]).collect()
    }

    fn hills(x: f64, y: f64) -> f64 {
        let waves = 6.0 * (0.31 * x + 0.002 * y * y).sin() * (0.27 * y + 0.001 * x * x).cos();
        waves + 5.0 * (0.013 * x * y + 0.2 * x).sin() - 0.2 * x
    }

    fn probability(source: &[[f64; 3]], target: &[[f64; 3]]) -> Result<f64> {
        let execution = Execution::default();
        let scan = |rows: &[[f64; 3]]| Prepared::of(Arc::new(Cloud::from_rows("points", rows)?), 2.0, None);
        let outcome = register(&scan(source)?, &scan(target)?, &Options::default(), &execution)?;
        Ok(if let Outcome::Found(done) = outcome { done.found.probability } else { 0.0 })
    }

    #[test]
    fn a_mirror_image_is_refused_but_no_scan_that_is_its_own() -> Result<()> {
        let (scan, itself) = (heights(hills), heights(|x, y| hills(x.abs() + 3.0, y)));
        let turned = |rows: &[[f64; 3]]| rows.iter().map(|&[x, y, z]| [3.0 + z, x, y]).collect::<Vec<_>>();
        let mirrored: Vec<[f64; 3]> = scan.iter().map(|&[x, y, z]| [-x, y, z]).collect();
        assert!(probability(&scan, &turned(&scan))? > 0.9);
        assert!(probability(&mirrored, &turned(&scan))? < 0.1);
        assert!(probability(&itself, &turned(&itself))? > 0.9);
        Ok(())
    }

    #[test]
    fn a_mirror_keeps_the_axis() {
        for axis in [None, Some([0.0, 0.0, 2.0]), Some([1.0, 0.01, 0.0]), Some([0.3, -4.0, 1.0])] {
            let mirror = mirror_along(axis);
            let axis = Vector3::from(axis.unwrap_or([0.0, 0.0, 1.0]));
            assert!((mirror.determinant() + 1.0).abs() < 1e-12);
            assert!((mirror * axis - axis).norm() < 1e-12 * axis.norm());
        }
    }
}
