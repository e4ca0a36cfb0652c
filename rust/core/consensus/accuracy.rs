//! The choice among hypotheses by how close their inliers lie, as in MAC.
//!
//! Zhang et al., *3D Registration with Maximal Cliques*, CVPR 2023, section 3.4: the sum over the residuals `r < tolerance`
//! of `(tolerance - r) / tolerance`, which the source calls MAE.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::inlier_counter::InlierCounter;
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::points::Points;

/// The pose with the greatest score, ties to the first, and its score; `None` where no pose has an inlier. The poses are
/// between the centred points.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn most_accurate(
    poses: &[Rigid],
    source: &Points,
    target: &Points,
    tolerance: f64,
    execution: &Execution,
) -> Result<Option<(usize, f64)>> {
    let counter = InlierCounter::new(source, target, tolerance);
    // Bits of a score that some pose reaches: those of positive numbers are in the order of the numbers.
    let reached = AtomicU64::new(0);
    let judge = |near: &mut Vec<u16>, (k, pose): (usize, &Rigid)| {
        execution.check()?;
        // No inlier adds more than one: with fewer of them than the score that is reached, a pose can't win.
        let least = f64::from_bits(reached.load(Ordering::Relaxed)).ceil() as usize;
        if counter.count(pose, least, near).is_none() {
            return Ok(None);
        }
        let score = accuracy(pose, source, target, tolerance);
        reached.fetch_max(score.to_bits(), Ordering::Relaxed);
        Ok(Some((k, score)))
    };
    let best = poses
        .par_iter()
        .enumerate()
        .map_init(Vec::new, judge)
        .try_reduce(|| None, |a, b| Ok(better(a, b)))?;
    Ok(best.filter(|&(_, score)| score > 0.0))
}

/// Sum of `1 - r / tolerance` over the residuals below the tolerance.
fn accuracy(pose: &Rigid, source: &Points, target: &Points, tolerance: f64) -> f64 {
    let residual = |i: usize| (pose.apply(&source.get(i)) - target.get(i)).norm();
    (0..source.len()).map(residual).filter(|&r| r < tolerance).map(|r| 1.0 - r / tolerance).sum()
}

fn better(a: Option<(usize, f64)>, b: Option<(usize, f64)>) -> Option<(usize, f64)> {
    match (a, b) {
        (Some((i, x)), Some((j, y))) => Some(if y > x || (y >= x && j < i) { (j, y) } else { (i, x) }),
        (a, b) => a.or(b),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    fn line() -> Result<Points> {
        Points::from_rows(
            "points",
            &(0..20).map(|i| [f64::from(i), 0.3 * f64::from(i * i), 1.0]).collect::<Vec<_>>(),
        )
    }

    fn shift(by: f64) -> Rigid {
        Rigid { rotation: Matrix3::identity(), translation: Vector3::new(by, 0.0, 0.0) }
    }

    #[test]
    fn the_closest_wins_and_the_first_of_equals() -> Result<()> {
        let points = line()?;
        let poses = [shift(0.5), shift(-0.25), shift(0.25), shift(3.0)];
        let best = most_accurate(&poses, &points, &points, 1.0, &Execution::default())?;
        assert_eq!(best.map(|(k, _)| k), Some(1));
        assert!(best.is_some_and(|(_, score)| (score - 15.0).abs() < 1e-9));
        Ok(())
    }

    #[test]
    fn no_inlier_is_no_choice() -> Result<()> {
        let points = line()?;
        let choice = |poses: &[Rigid]| most_accurate(poses, &points, &points, 1.0, &Execution::default());
        assert_eq!((choice(&[shift(40.0)])?, choice(&[])?), (None, None));
        Ok(())
    }
}
