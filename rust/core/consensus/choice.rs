//! Which of many poses the correspondences speak for, and the group that it has.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::inlier_counter::{InlierCounter, is_inlier};
use super::reweighting::reweighted;
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::grouping_result::Grouping;
use crate::points::Points;
use crate::simd::{self, DOUBLES};

/// Most rounds of the last refinement.
const ROUNDS: usize = 20;

/// What the best pose has most of; r is a residual, and those of at least the tolerance t count nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Choice {
    /// Inliers: residuals below the tolerance.
    #[default]
    Inliers,
    /// The sum of `1 - r / t`.
    Mae,
    /// The sum of `(1 - r / t)^2`.
    Mse,
}

/// The best of some poses between the centred points, the first of equal ones; `None` where none has an inlier.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn best_pose(
    poses: &[Rigid],
    source: &Points,
    target: &Points,
    tolerance: f64,
    choice: Choice,
    execution: &Execution,
) -> Result<Option<Rigid>> {
    let counter = InlierCounter::new(source, target, tolerance);
    // Bits of positive numbers are in the numbers' order.
    let greatest = AtomicU64::new(0.0_f64.to_bits());
    let score = |near: &mut Vec<u16>, pose: &Rigid| {
        execution.check()?;
        // No residual adds more than 1, so whoever has fewer inliers than another's score can't win.
        let least = f64::from_bits(greatest.load(Ordering::Relaxed)).ceil() as usize;
        let Some(inliers) = counter.count(pose, least, near) else { return Ok(0.0) };
        let score = match choice {
            Choice::Inliers => inliers as f64,
            Choice::Mae => sum_of_shares(pose, source, target, tolerance, false),
            Choice::Mse => sum_of_shares(pose, source, target, tolerance, true),
        };
        greatest.fetch_max(score.to_bits(), Ordering::Relaxed);
        Ok(score)
    };
    let scores: Vec<f64> = poses.par_iter().map_init(Vec::new, score).collect::<Result<_>>()?;
    let most = scores.iter().copied().fold(0.0, f64::max);
    let best = scores.iter().position(|&score| most > 0.0 && score >= most);
    Ok(best.map(|best| poses[best]))
}

/// The number of inliers of each pose between the centred points.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn count_inliers(
    poses: &[Rigid],
    source: &Points,
    target: &Points,
    tolerance: f64,
    execution: &Execution,
) -> Result<Vec<usize>> {
    let counter = InlierCounter::new(source, target, tolerance);
    let count = |near: &mut Vec<u16>, pose: &Rigid| {
        execution.check().map(|()| counter.count(pose, 0, near).unwrap_or_default())
    };
    poses.par_iter().map_init(Vec::new, count).collect()
}

/// The sum of `max(0, 1 - r / tolerance)`, or of its squares.
fn sum_of_shares(pose: &Rigid, source: &Points, target: &Points, tolerance: f64, squared: bool) -> f64 {
    let (r, t) = (&pose.rotation, &pose.translation);
    let rows = [0, 1, 2].map(|row| [r[(row, 0)], r[(row, 1)], r[(row, 2)], t[row]]);
    let mut sums = [0.0; DOUBLES];
    simd::run(
        #[inline(always)]
        || {
            let n = source.len();
            let (x, y, z) = (&source.x[..n], &source.y[..n], &source.z[..n]);
            let (u, v, w) = (&target.x[..n], &target.y[..n], &target.z[..n]);
            for first in (0..n).step_by(DOUBLES) {
                for (sum, i) in sums.iter_mut().zip(first..n) {
                    let p = [x[i], y[i], z[i]];
                    let (a, b, c) =
                        (offset(rows[0], p, u[i]), offset(rows[1], p, v[i]), offset(rows[2], p, w[i]));
                    let share = 1.0 - (a * a + b * b + c * c).sqrt() / tolerance;
                    let share = if share > 0.0 { share } else { 0.0 };
                    *sum += if squared { share * share } else { share };
                }
            }
        },
    );
    sums.iter().sum()
}

/// A coordinate of the moved point, less that of its partner.
#[inline(always)]
fn offset(row: [f64; 4], p: [f64; 3], partner: f64) -> f64 {
    row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3] - partner
}

/// The inliers of the pose after its last refinement, and the pose as their model; nothing without a pose.
#[must_use]
pub fn group_of(pose: Option<Rigid>, source: &Points, target: &Points, tolerance: f64) -> Grouping {
    inliers_of(
        pose.map(|pose| reweighted(&pose, source, target, tolerance, ROUNDS)),
        source,
        target,
        tolerance,
    )
}

/// The same of the pose as it is.
#[must_use]
pub fn inliers_of(pose: Option<Rigid>, source: &Points, target: &Points, tolerance: f64) -> Grouping {
    let Some(pose) = pose else {
        return Grouping::empty(source.len());
    };
    let mask = (0..source.len()).map(|i| is_inlier(&pose, source, target, i, tolerance)).collect();
    Grouping { mask, model: Some(pose.uncentered(source, target).to_matrix()), ..Grouping::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    /// Points on a line, of which the first `n` stay and the others go far away.
    fn problem(n: usize) -> Result<(Points, Points)> {
        let source: Vec<[f64; 3]> = (0..40).map(|i| [f64::from(i), f64::from(i * i % 7), 0.0]).collect();
        let target: Vec<[f64; 3]> = source
            .iter()
            .enumerate()
            .map(|(i, p)| if i < n { *p } else { [-p[0], 99.0 - p[1], 5.0] })
            .collect();
        Ok((Points::from_rows("source", &source)?, Points::from_rows("target", &target)?))
    }

    /// The pose that moves points of the data by x along the first axis.
    fn shift(x: f64, source: &Points, target: &Points) -> Rigid {
        let translation = Vector3::new(x, 0.0, 0.0) + source.center() - target.center();
        Rigid { rotation: Matrix3::identity(), translation }
    }

    #[test]
    fn each_choice_takes_its_best() -> Result<()> {
        let (source, target) = problem(25)?;
        let poses = [0.99, 3.0, 0.5, 0.5, -0.9].map(|x| shift(x, &source, &target));
        let best = |choice| best_pose(&poses, &source, &target, 1.0, choice, &Execution::default());
        assert_eq!(best(Choice::Inliers)?, Some(poses[0]));
        assert_eq!(best(Choice::Mae)?, Some(poses[2]));
        assert_eq!(best(Choice::Mse)?, Some(poses[2]));
        let sum = sum_of_shares(&poses[2], &source, &target, 1.0, true);
        assert!((sum - 25.0 * 0.25).abs() < 1e-9, "{sum}");
        Ok(())
    }

    #[test]
    fn without_inliers_there_is_no_pose_and_no_group() -> Result<()> {
        let (source, target) = problem(25)?;
        let poses = [shift(50.5, &source, &target)];
        let best = best_pose(&poses, &source, &target, 0.1, Choice::Inliers, &Execution::default())?;
        assert_eq!(best, None);
        assert_eq!(group_of(best, &source, &target, 0.1), Grouping::empty(40));
        Ok(())
    }

    #[test]
    fn the_group_are_the_inliers() -> Result<()> {
        let (source, target) = problem(25)?;
        let group = group_of(Some(shift(0.2, &source, &target)), &source, &target, 0.5);
        assert_eq!(group.mask, (0..40).map(|i| i < 25).collect::<Vec<_>>());
        assert!(group.model.is_some_and(|model| model[(0, 3)].abs() < 1e-9));
        Ok(())
    }
}
