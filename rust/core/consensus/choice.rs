//! Selects the best of many poses, and the group of its inliers.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::inlier_counter::{InlierCounter, is_inlier};
use super::reweighting::reweighted;
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::grouping_result::Grouping;
use crate::memory;
use crate::options::{Value, words};
use crate::points::Points;
use crate::selection::top_k::largest;
use crate::simd::{self, DOUBLES};

/// Most iterations of the last refinement.
const ROUNDS: usize = 20;

/// Poses whose residuals are evaluated before those of all others.
const FIRST: usize = 16;

words! {
    /// The score of a pose; r is a residual, and residuals of at least the tolerance t add nothing.
    pub enum Choice {
        /// Number of inliers: residuals below the tolerance.
        Inliers = Value::Word("inliers"),
        /// The sum of `1 - r / t`.
        Mae = Value::Word("mae"),
        /// The sum of `(1 - r / t)^2`.
        Mse = Value::Word("mse"),
    }
}

/// Calls `find` on some of the correspondences, or on all, and returns poses between the centred points of
/// all.
///
/// # Errors
/// Those of `find`; [`crate::Error::OutOfMemory`].
pub fn poses_among(
    rows: Option<&[usize]>,
    source: &Points,
    target: &Points,
    find: impl FnOnce(&Points, &Points) -> Result<Vec<Rigid>>,
) -> Result<Vec<Rigid>> {
    let Some(rows) = rows else {
        return find(source, target);
    };
    let (p, q) = (source.subset(rows)?, target.subset(rows)?);
    let mut poses = find(&p, &q)?;
    poses.iter_mut().for_each(|pose| *pose = pose.uncentered(&p, &q));
    Ok(poses)
}

/// The best of some poses between the centred points, the first of equal ones; `None` if none has an inlier.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn best_pose(
    poses: &[Rigid],
    source: &Points,
    target: &Points,
    tolerance: f64,
    choice: Choice,
    execution: &Execution,
) -> Result<Option<Rigid>> {
    let inliers = count_inliers(poses, source, target, tolerance, execution)?;
    let inliers = memory::collect(inliers.into_iter().map(|count| count as f64))?;
    let scores = match choice {
        Choice::Inliers => inliers,
        Choice::Mae | Choice::Mse => {
            scores_that_may_win(poses, &inliers, source, target, tolerance, choice, execution)?
        }
    };
    let most = scores.iter().copied().fold(0.0, f64::max);
    let best = scores.iter().position(|&score| most > 0.0 && score >= most);
    Ok(best.map(|best| poses[best]))
}

/// The sums over residuals; 0 for poses whose number of inliers, an upper bound of the sum, is below another
/// pose's sum.
fn scores_that_may_win(
    poses: &[Rigid],
    inliers: &[f64],
    source: &Points,
    target: &Points,
    tolerance: f64,
    choice: Choice,
    execution: &Execution,
) -> Result<Vec<f64>> {
    // Positive numbers and their bits have the same order.
    let greatest = AtomicU64::new(0.0_f64.to_bits());
    let score = |&k: &usize| {
        execution.check()?;
        if inliers[k] < f64::from_bits(greatest.load(Ordering::Relaxed)) {
            return Ok((k, 0.0));
        }
        let score = sum_of_shares(&poses[k], source, target, tolerance, choice == Choice::Mse);
        greatest.fetch_max(score.to_bits(), Ordering::Relaxed);
        Ok((k, score))
    };
    // Poses with the most inliers first, so that most others can be skipped.
    let order = largest(inliers, poses.len())?;
    let first = order.len().min(FIRST);
    let mut scores = memory::filled(0.0, poses.len())?;
    for part in [&order[..first], &order[first..]] {
        let found = memory::par_try_collect(part.par_iter().map(score))?;
        found.into_iter().for_each(|(k, score)| scores[k] = score);
    }
    Ok(scores)
}

/// The number of inliers of each pose between the centred points.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn count_inliers(
    poses: &[Rigid],
    source: &Points,
    target: &Points,
    tolerance: f64,
    execution: &Execution,
) -> Result<Vec<usize>> {
    let counter = InlierCounter::new(source, target, tolerance)?;
    let count = |near: &mut Vec<u16>, pose: &Rigid| {
        execution.check()?;
        Ok(counter.count(pose, 0, near)?.unwrap_or_default())
    };
    memory::par_try_collect(poses.par_iter().map_init(Vec::new, count))
}

/// The sum of `max(0, 1 - r / tolerance)`, or of its squares.
fn sum_of_shares(pose: &Rigid, source: &Points, target: &Points, tolerance: f64, squared: bool) -> f64 {
    let (r, t, inverse) = (&pose.rotation, &pose.translation, 1.0 / tolerance);
    let rows = [0, 1, 2].map(|row| [r[(row, 0)], r[(row, 1)], r[(row, 2)], t[row]]);
    simd::run(
        #[inline(always)]
        || {
            let axes = [&source.x, &source.y, &source.z, &target.x, &target.y, &target.z];
            let [(x, xs), (y, ys), (z, zs), (u, us), (v, vs), (w, ws)] = axes.map(
                #[inline(always)]
                |axis| axis.as_chunks::<DOUBLES>(),
            );
            let mut sums = [0.0; DOUBLES];
            for (((((x, y), z), u), v), w) in x.iter().zip(y).zip(z).zip(u).zip(v).zip(w) {
                for lane in 0..DOUBLES {
                    let (p, q) = ([x[lane], y[lane], z[lane]], [u[lane], v[lane], w[lane]]);
                    let share = share(&rows, p, q, inverse);
                    sums[lane] += if squared { share * share } else { share };
                }
            }
            for i in 0..xs.len() {
                let share = share(&rows, [xs[i], ys[i], zs[i]], [us[i], vs[i], ws[i]], inverse);
                sums[i] += if squared { share * share } else { share };
            }
            sums.iter().sum()
        },
    )
}

/// `max(0, 1 - r / tolerance)` of one pair, for the rows of a rotation and a translation.
#[inline(always)]
fn share(rows: &[[f64; 4]; 3], p: [f64; 3], q: [f64; 3], inverse: f64) -> f64 {
    let (a, b, c) = (offset(rows[0], p, q[0]), offset(rows[1], p, q[1]), offset(rows[2], p, q[2]));
    let share = 1.0 - (a * a + b * b + c * c).sqrt() * inverse;
    if share > 0.0 { share } else { 0.0 }
}

/// A coordinate of the moved point minus that of its match.
#[inline(always)]
fn offset(row: [f64; 4], p: [f64; 3], partner: f64) -> f64 {
    row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3] - partner
}

/// The inliers of the pose after its last refinement, with the pose as their model; empty without a pose.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn group_of(pose: Option<Rigid>, source: &Points, target: &Points, tolerance: f64) -> Result<Grouping> {
    let refined = pose.map(|pose| reweighted(&pose, source, target, tolerance, ROUNDS)).transpose()?;
    inliers_of(refined, source, target, tolerance)
}

/// As [`group_of`], without the refinement.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn inliers_of(pose: Option<Rigid>, source: &Points, target: &Points, tolerance: f64) -> Result<Grouping> {
    let Some(pose) = pose else {
        return Grouping::empty(source.len());
    };
    let mask = memory::collect((0..source.len()).map(|i| is_inlier(&pose, source, target, i, tolerance)))?;
    Ok(Grouping { mask, model: Some(pose.uncentered(source, target).to_matrix()), ..Grouping::default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    /// Collinear points, of which the first `n` stay and the others move far away.
    fn problem(n: usize) -> Result<(Points, Points)> {
        let source: Vec<[f64; 3]> = (0..40).map(|i| [f64::from(i), f64::from(i * i % 7), 0.0]).collect();
        let target: Vec<[f64; 3]> = source
            .iter()
            .enumerate()
            .map(|(i, p)| if i < n { *p } else { [-p[0], 99.0 - p[1], 5.0] })
            .collect();
        Ok((Points::from_rows("source", &source)?, Points::from_rows("target", &target)?))
    }

    /// The pose that translates points of the data by x along the first axis.
    fn shift(x: f64, source: &Points, target: &Points) -> Rigid {
        let translation = Vector3::new(x, 0.0, 0.0) + source.center() - target.center();
        Rigid { rotation: Matrix3::identity(), translation }
    }

    #[test]
    fn each_choice_selects_its_best_pose() -> Result<()> {
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
        assert_eq!(group_of(best, &source, &target, 0.1)?, Grouping::empty(40)?);
        Ok(())
    }

    #[test]
    fn the_group_is_the_inliers() -> Result<()> {
        let (source, target) = problem(25)?;
        let group = group_of(Some(shift(0.2, &source, &target)), &source, &target, 0.5)?;
        assert_eq!(group.mask, (0..40).map(|i| i < 25).collect::<Vec<_>>());
        assert!(group.model.is_some_and(|model| model[(0, 3)].abs() < 1e-9));
        Ok(())
    }
}
