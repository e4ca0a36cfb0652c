//! RANSAC: the rigid transform of three random correspondences with the most inliers.
//!
//! The paper, section 3.2 (after Fischler, Bolles, CACM 1981): 10,000 samples of three, a
//! least-squares transform each, inliers nearer than 5 pr, no refit. Cost O(iterations n).

use super::GroupingMethod;
use crate::consensus::{Consensus, SampleConsensus};
use crate::geometry::rigid::{Rigid, fit_rigid, fixes_rotation};
use crate::options::{BELOW_ONE, ROUNDS, SHARE, method};
use crate::rule::{Agreement, Kind, Rule};
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};

method! {
    /// Parameters of random sample consensus.
    pub struct Ransac = "ransac", ["source", "target"], optional ["resolution"], {
        /// Residuals of inliers are below this length; default `5 * resolution`.
        pub tolerance: Option<f64> = None;
        /// Number of samples.
        pub iterations: usize = 10_000, ROUNDS;
        /// Seed of the random numbers, which depend on it and on the iteration alone.
        pub seed: u64 = 0;
        /// Fit the transform to all inliers once and select again.
        pub refine: bool = false;
        /// Drop samples with an edge whose length ratio `min(ds/dt, dt/ds)` is lower, before counting their
        /// inliers (0.9 is usual).
        pub edge_ratio: Option<f64> = None, SHARE;
        /// Stop once the probability of having missed a better transform is at most `1 - confidence`.
        pub confidence: Option<f64> = None, BELOW_ONE;
    }
}

impl GroupingMethod for Ransac {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("ransac")?;
        let engine = self.engine(correspondences)?;
        // Two inliers of one pose agree in distance up to the sum of their residuals.
        let rule = Rule::bounded(Kind::Residual, engine.tolerance)
            .agreeing(Agreement::difference(2.0 * engine.tolerance));
        let Some(best) = engine.run(source, target, execution)? else {
            return Ok(Grouping::empty(source.len())?.with("iterations", self.iterations as f64).by(rule));
        };
        let (model, mask) = if self.refine {
            refit(&best.model, &engine, source, target)?
        } else {
            (best.model, engine.inlier_mask(&best.model, source, target)?)
        };
        Ok(report(&best, &model, mask, source, target).by(rule))
    }
}

impl Ransac {
    fn engine(&self, correspondences: &Correspondences) -> Result<SampleConsensus> {
        Ok(SampleConsensus {
            iterations: self.iterations,
            tolerance: correspondences.length("tolerance", self.tolerance, 5.0)?,
            seed: self.seed,
            edge_ratio: self.edge_ratio,
            confidence: self.confidence,
        })
    }
}

/// The transform fitted to all inliers and its inliers; the model itself if they do not determine one.
fn refit(
    model: &Rigid,
    engine: &SampleConsensus,
    source: &Points,
    target: &Points,
) -> Result<(Rigid, Vec<bool>)> {
    let inliers = engine.inlier_mask(model, source, target)?;
    let selected =
        |points: &Points| memory::collect((0..points.len()).filter(|&i| inliers[i]).map(|i| points.get(i)));
    let (p, q) = (selected(source)?, selected(target)?);
    if !fixes_rotation(&p, &q) {
        return Ok((*model, inliers));
    }
    let refined = fit_rigid(&p, &q);
    Ok((refined, engine.inlier_mask(&refined, source, target)?))
}

fn report(best: &Consensus, model: &Rigid, mask: Vec<bool>, source: &Points, target: &Points) -> Grouping {
    let model = model.uncentered(source, target).to_matrix();
    Grouping { mask, model: Some(model), ..Grouping::default() }
        .with("iterations", best.iterations as f64)
        .with("best_iteration", best.iteration as f64)
        .with("inliers_before_refit", best.inliers as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_moved_points() -> Result<()> {
        let source: Vec<[f64; 3]> =
            (0..12).map(|i| [f64::from(i % 4), f64::from(i / 4), f64::from(i * i % 5)]).collect();
        let target: Vec<[f64; 3]> = source
            .iter()
            .enumerate()
            .map(|(i, p)| if i < 8 { [-p[1] + 3.0, p[0], p[2]] } else { [50.0 + p[2], 7.0 * p[0], -p[1]] })
            .collect();
        let input = Correspondences::new(&source, &target)?.with_resolution(0.1)?;
        for refine in [false, true] {
            let group = Ransac { refine, ..Ransac::default() }.group(&input, &Execution::default())?;
            assert_eq!(group.mask, (0..12).map(|i| i < 8).collect::<Vec<_>>());
            let model = group.model.unwrap_or_default();
            assert!((model[(0, 1)] + 1.0).abs() < 1e-9 && (model[(0, 3)] - 3.0).abs() < 1e-9);
        }
        Ok(())
    }

    #[test]
    fn needs_a_length_and_three_points() -> Result<()> {
        let rows = [[0.0; 3]; 4];
        let input = Correspondences::new(&rows, &rows)?;
        assert!(Ransac::default().group(&input, &Execution::default()).is_err());
        let input = input.with_resolution(1.0)?;
        assert_eq!(Ransac::default().group(&input, &Execution::default())?.size(), 0);
        Ok(())
    }
}
