//! Likelihood ratio of correspondences under a pose versus chance.
//!
//! A wrong match ends near a given place as often as others do. A correct match ends at its place under the
//! pose, up to noise, and its frames rotate with the pose. The score of a pose is the sum of the
//! log-likelihood ratios, each cut off at 0.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]
#![expect(clippy::needless_bitwise_bool, reason = "without branches all lanes are computed at once")]

mod groups;
pub mod levels;

use nalgebra::{Matrix3, Point3};

use crate::error::Result;
use crate::geometry::rigid::{Rigid, fit_posed, fixes_rotation};
use crate::memory;
use crate::points::Points;
use crate::simd::{self, DOUBLES};
use groups::{Detail, Group, by_rows, cosines, details_in_groups, in_groups, squared_residuals};

/// Residuals beyond this many deviations do not affect a pose.
const REFINED: f64 = 3.0;

/// Evidence of a correspondence's frames: `max(loss, gain - 2 (1 - cos a) / (2 deviation^2))` for the angle a
/// between the pose and the rotation that they propose; zero without frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameTerm {
    /// Log-likelihood ratio of frames that agree exactly.
    pub gain: f64,
    /// Log-likelihood ratio, at most 0, of frames that disagree.
    pub loss: f64,
    /// Standard deviation of the angle between correct frames, in radians.
    pub deviation: f64,
}

impl FrameTerm {
    /// Frames that add no evidence.
    pub const SILENT: Self = Self { gain: 0.0, loss: 0.0, deviation: 1.0 };

    /// Gain over the loss of frames that propose the pose, and its slope in `1 - cos a`.
    fn bonus(&self) -> (f64, f64) {
        (self.gain - self.loss, 1.0 / (self.deviation * self.deviation))
    }
}

/// The likelihood of a set of correspondences; scores poses.
#[derive(Debug)]
pub struct Likelihood {
    groups: Vec<Group>,
    /// One per group if correspondences have weights or frames, else empty.
    details: Vec<Detail>,
    frame_term: FrameTerm,
    len: usize,
    /// Standard deviation of a correct match, a length.
    deviation: f64,
    /// Residuals of at least this length add nothing.
    reach: f64,
}

/// The score of a pose, and its number of supporters.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Support {
    /// Sum of the log-likelihood ratios.
    pub score: f64,
    /// Number of correspondences that add to the score.
    pub supporters: usize,
}

impl Likelihood {
    /// Likelihood of matched points with their levels.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(source: &Points, target: &Points, levels: &[f64], deviation: f64, reach: f64) -> Result<Self> {
        let terms = |i: usize| {
            let (p, q) = (source.get(i), target.get(i));
            [p.x, p.y, p.z, q.x, q.y, q.z, levels[i]]
        };
        let groups = in_groups((0..levels.len()).map(terms))?;
        let (details, frame_term) = (Vec::new(), FrameTerm::SILENT);
        Ok(Self { groups, details, frame_term, len: levels.len(), deviation, reach })
    }

    /// Copies the likelihood.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn copied(&self) -> Result<Self> {
        let (groups, details) = (memory::copied(&self.groups)?, memory::copied(&self.details)?);
        Ok(Self { groups, details, ..*self })
    }

    /// Adds weights and the rotations proposed by frames, if any.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn with_frames(
        mut self,
        rotations: &[Option<Matrix3<f64>>],
        weights: &[f64],
        term: FrameTerm,
    ) -> Result<Self> {
        for (i, _) in rotations.iter().enumerate().filter(|(_, rotation)| rotation.is_some()) {
            self.groups[i / DOUBLES][6][i % DOUBLES] += term.loss;
        }
        self.details = details_in_groups(rotations, weights)?;
        self.frame_term = term;
        Ok(self)
    }

    /// As this likelihood, between other points and without frames or weights.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn between(&self, source: &Points, target: &Points) -> Result<Self> {
        let levels = memory::collect((0..self.len).map(|i| groups::terms(&self.groups, i)[6]))?;
        Self::new(source, target, &levels, self.deviation, self.reach)
    }

    /// Number of correspondences.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The points of a correspondence.
    pub fn points(&self, i: usize) -> (Point3<f64>, Point3<f64>) {
        let [x, y, z, u, v, w, _] = groups::terms(&self.groups, i);
        (Point3::new(x, y, z), Point3::new(u, v, w))
    }

    /// Standard deviation of a correct match.
    pub fn deviation(&self) -> f64 {
        self.deviation
    }

    /// Replaces the standard deviation of a correct match, and the bound of residuals.
    pub fn set_lengths(&mut self, deviation: f64, reach: f64) {
        (self.deviation, self.reach) = (deviation, reach);
    }

    /// Removes the correspondences whose residual under a pose is below the reach.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn without_supporters(&self, pose: &Rigid) -> Result<Self> {
        let squares = self.squared_residuals(pose)?;
        let limit = self.reach * self.reach;
        let kept = memory::collect((0..self.len).filter(|&i| squares[i] >= limit))?;
        let groups = groups::take(&self.groups, &kept, f64::NEG_INFINITY)?;
        let details =
            if self.details.is_empty() { Vec::new() } else { groups::take(&self.details, &kept, 0.0)? };
        Ok(Self { groups, details, len: kept.len(), ..*self })
    }

    /// The score of a pose: sum of `max(0, level - r^2 / (2 deviation^2))` over residuals r below the reach.
    /// The evidence of frames, if any, is added to the level, and each term is weighted.
    pub fn support(&self, pose: &Rigid) -> Support {
        let (limit, factor) = (self.reach * self.reach, 0.5 / (self.deviation * self.deviation));
        let transform = by_rows(pose);
        let (most, slope) = self.frame_term.bonus();
        let (sums, counts) = simd::run(
            #[inline(always)]
            || {
                let (mut sums, mut counts) = ([0.0; DOUBLES], [0.0; DOUBLES]);
                if self.details.is_empty() {
                    for group in &self.groups {
                        let squares = squared_residuals(&transform, group);
                        for lane in 0..DOUBLES {
                            let term = group[6][lane] - factor * squares[lane];
                            let counts_here = (squares[lane] < limit) & (term > 0.0);
                            sums[lane] += if counts_here { term } else { 0.0 };
                            counts[lane] += if counts_here { 1.0 } else { 0.0 };
                        }
                    }
                }
                for (group, detail) in self.groups.iter().zip(&self.details) {
                    let squares = squared_residuals(&transform, group);
                    if squares.iter().all(|&square| square >= limit) {
                        continue;
                    }
                    let cosines = cosines(&transform, detail);
                    for lane in 0..DOUBLES {
                        let bonus = (most - slope * (1.0 - cosines[lane])).max(0.0);
                        let term = group[6][lane] + bonus - factor * squares[lane];
                        let counts_here = (squares[lane] < limit) & (term > 0.0);
                        sums[lane] += if counts_here { detail[0][lane] * term } else { 0.0 };
                        counts[lane] += if counts_here { 1.0 } else { 0.0 };
                    }
                }
                (sums, counts)
            },
        );
        Support { score: sums.iter().sum(), supporters: counts.iter().sum::<f64>() as usize }
    }

    /// The probability that each correspondence is correct, given the pose.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn posteriors(&self, pose: &Rigid) -> Result<Vec<f64>> {
        let factor = 0.5 / (self.deviation * self.deviation);
        let (transform, squares) = (by_rows(pose), self.squared_residuals(pose)?);
        let log_odds = |(i, square): (usize, &f64)| self.level_under(i, &transform) - factor * square;
        memory::collect(squares.iter().enumerate().map(log_odds).map(posterior))
    }

    /// The level of a correspondence, with the evidence of its frames for the pose.
    fn level_under(&self, i: usize, transform: &[f64; 12]) -> f64 {
        let level = self.groups[i / DOUBLES][6][i % DOUBLES];
        let Some(detail) = self.details.get(i / DOUBLES) else { return level };
        let (most, slope) = self.frame_term.bonus();
        level + (most - slope * (1.0 - cosines(transform, detail)[i % DOUBLES])).max(0.0)
    }

    fn weight(&self, i: usize) -> f64 {
        self.details.get(i / DOUBLES).map_or(1.0, |detail| detail[0][i % DOUBLES])
    }

    /// Refines the pose by one iteration of weighted least squares for each of the given deviations, in turn;
    /// returns the previous pose if the fitted points do not determine the rotation.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn refined(&self, pose: &Rigid, deviations: impl Iterator<Item = f64>) -> Result<Rigid> {
        let mut pose = *pose;
        for deviation in deviations {
            let Some(next) = self.refit(&pose, deviation)? else { break };
            pose = next;
        }
        Ok(pose)
    }

    /// Weighted fit; frames that agree with the pose attract its rotation to the one that they propose.
    fn refit(&self, pose: &Rigid, deviation: f64) -> Result<Option<Rigid>> {
        let (limit, factor) = ((REFINED * deviation).powi(2), 0.5 / (deviation * deviation));
        let (mut p, mut q, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        let mut turns = Matrix3::zeros();
        let transform = by_rows(pose);
        for (i, square) in self.squared_residuals(pose)?.into_iter().enumerate() {
            if square < limit {
                let (start, end) = self.points(i);
                let weight = self.weight(i) * posterior(self.level_under(i, &transform) - factor * square);
                memory::push(&mut p, start)?;
                memory::push(&mut q, end)?;
                memory::push(&mut weights, weight)?;
                if let Some(rotation) = self.agreeing_frames(i, pose) {
                    turns += rotation * weight;
                }
            }
        }
        turns *= 0.5 * (deviation / self.frame_term.deviation).powi(2);
        Ok(fixes_rotation(&p, &q).then(|| fit_posed(&p, &q, &weights, &turns)))
    }

    /// The rotation proposed by the frames of a correspondence, if their evidence exceeds that of wrong
    /// frames.
    fn agreeing_frames(&self, i: usize, pose: &Rigid) -> Option<Matrix3<f64>> {
        if self.details.is_empty() {
            return None;
        }
        let detail = groups::terms(&self.details, i);
        let rotation = Matrix3::from_row_slice(&detail[1..]);
        let (most, slope) = self.frame_term.bonus();
        let cosine = 0.5 * (rotation.dot(&pose.rotation) - 1.0);
        (most > slope * (1.0 - cosine)).then_some(rotation)
    }

    /// `|R p + t - q|^2` of each correspondence.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn squared_residuals(&self, pose: &Rigid) -> Result<Vec<f64>> {
        let transform = by_rows(pose);
        let mut squares = memory::filled([0.0; DOUBLES], self.groups.len())?;
        simd::run(
            #[inline(always)]
            || {
                for (group, squares) in self.groups.iter().zip(&mut squares) {
                    *squares = squared_residuals(&transform, group);
                }
            },
        );
        let mut squares = squares.into_flattened();
        squares.truncate(self.len);
        Ok(squares)
    }
}

/// The probability with these log-odds.
fn posterior(log_odds: f64) -> f64 {
    1.0 / (1.0 + (-log_odds).exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::rigid::fit_rigid;
    use nalgebra::{Rotation3, Vector3};

    const STILL: fn() -> Rigid = || Rigid { rotation: Matrix3::identity(), translation: Vector3::zeros() };

    fn points(n: usize) -> Result<Points> {
        let place = |i: usize| [1.1, 2.3, 3.7].map(|f| 50.0 * (i as f64 * f).sin());
        Points::from_rows("points", &(0..n).map(place).collect::<Vec<_>>())
    }

    /// Target points with growing displacements.
    fn shifted(points: &Points) -> Result<Points> {
        let rows = points.rows().enumerate();
        let rows: Vec<[f64; 3]> = rows.map(|(i, [x, y, z])| [x, y + 0.1 * i as f64, z]).collect();
        Points::from_rows("target", &rows)
    }

    #[test]
    fn support_is_the_plain_sum() -> Result<()> {
        for n in [0, 1, 7, 8, 9, 100] {
            let source = points(n)?;
            let target = shifted(&source)?;
            let levels: Vec<f64> = (0..n).map(|i| 3.0 * (i as f64).sin()).collect();
            let likelihood = Likelihood::new(&source, &target, &levels, 1.5, 3.0)?;
            let squares = likelihood.squared_residuals(&STILL())?;
            let plain = |i: usize| (source.get(i) - target.get(i)).norm_squared();
            assert!((0..n).all(|i| (squares[i] - plain(i)).abs() < 1e-9));
            let terms = (0..n).map(|i| if squares[i] < 9.0 { levels[i] - squares[i] / 4.5 } else { 0.0 });
            let terms: Vec<f64> = terms.filter(|&term| term > 0.0).collect();
            let support = likelihood.support(&STILL());
            assert_eq!(support.supporters, terms.len());
            assert!((support.score - terms.iter().sum::<f64>()).abs() < 1e-9);
            let rest = likelihood.without_supporters(&STILL())?;
            assert_eq!(rest.len, squares.iter().filter(|&&square| square >= 9.0).count());
            assert_eq!(rest.support(&STILL()), Support::default());
        }
        Ok(())
    }

    #[test]
    fn frames_add_evidence_by_angle_and_weights_scale_it() -> Result<()> {
        let source = points(30)?;
        let term = FrameTerm { gain: 3.0, loss: -0.7, deviation: 0.2 };
        let turn =
            |i: usize| (i % 3 != 2).then(|| Rotation3::new(Vector3::x() * 0.1 * i as f64).into_inner());
        let rotations: Vec<_> = (0..30).map(turn).collect();
        let weights: Vec<f64> = (1..=30).map(|i| 1.0 / f64::from(i)).collect();
        let plain = Likelihood::new(&source, &source, &[1.0; 30], 1.5, 3.0)?;
        let framed = plain.with_frames(&rotations, &weights, term)?;
        let said = |i: usize| {
            let angle = 0.1 * i as f64;
            if i % 3 == 2 { 0.0 } else { (3.0 - (1.0 - angle.cos()) / 0.04).max(-0.7) }
        };
        let expected: f64 = (0..30).map(|i| weights[i] * (1.0 + said(i))).sum();
        assert!((framed.support(&STILL()).score - expected).abs() < 1e-9);
        assert_eq!(framed.support(&STILL()).supporters, 30);
        let posteriors = framed.posteriors(&STILL())?;
        assert!((0..30).all(|i| (posteriors[i] - posterior(1.0 + said(i))).abs() < 1e-12));
        assert_eq!(framed.between(&source, &source)?.len(), 30);
        assert!(framed.without_supporters(&STILL())?.is_empty());
        Ok(())
    }

    #[test]
    fn agreeing_frames_attract_the_fitted_rotation() -> Result<()> {
        let source = points(40)?;
        let turned = |angle: f64| Rotation3::new(Vector3::z() * angle);
        let moved: Vec<[f64; 3]> = (0..40).map(|i| (turned(0.02) * source.get(i)).into()).collect();
        let target = Points::from_rows("target", &moved)?;
        let term = FrameTerm { gain: 3.0, loss: -0.7, deviation: 0.02 };
        let refined = |frames: f64| {
            let plain = Likelihood::new(&source, &target, &[5.0; 40], 1.0, 3.0)?;
            let framed = plain.with_frames(&[Some(turned(frames).into_inner()); 40], &[1.0; 40], term)?;
            framed.refined(&STILL(), [1.0; 10].into_iter())
        };
        let turn = |pose: &Rigid| pose.rotation[(1, 0)].asin();
        assert!((turn(&refined(0.02)?) - 0.02).abs() < 1e-9);
        // Points 50 from the axis and frames are about equally certain of the angle.
        assert!((turn(&refined(0.0)?) - 0.01).abs() < 1e-3);
        assert!((turn(&refined(1.0)?) - 0.02).abs() < 1e-9);
        Ok(())
    }

    #[test]
    fn refinement_fits_near_matches_and_keeps_an_undetermined_pose() -> Result<()> {
        let source = points(40)?;
        let rows = source.rows().enumerate();
        let moved: Vec<[f64; 3]> =
            rows.map(|(i, [x, y, z])| if i < 30 { [x, y, z] } else { [x + 900.0, y, -z] }).collect();
        let target = Points::from_rows("target", &moved)?;
        let likelihood = Likelihood::new(&source, &target, &[5.0; 40], 1.0, 3.0)?;
        let (p, q): (Vec<_>, Vec<_>) = (0..30).map(|i| (source.get(i), target.get(i))).unzip();
        let mut start = fit_rigid(&p, &q);
        start.translation.x += 0.5;
        let refined = likelihood.refined(&start, [1.0; 5].into_iter())?;
        assert!(likelihood.squared_residuals(&refined)?[..30].iter().all(|&square| square < 1e-12));
        let far = Rigid { translation: Vector3::new(0.0, 0.0, 1e6), ..STILL() };
        assert_eq!(likelihood.refined(&far, [1.0; 5].into_iter())?, far);
        assert!(likelihood.posteriors(&refined)?[0] > 0.99 && likelihood.posteriors(&refined)?[35] < 1e-6);
        Ok(())
    }
}
