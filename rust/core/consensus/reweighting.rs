//! Final refinement of the modern methods: iteratively reweighted least squares over the inliers, until their
//! number is constant.
//!
//! Chen et al., SC2-PCR, CVPR 2022, whose published code MAC and `TurboReg` share.

use crate::error::Result;
use crate::geometry::rigid::{Rigid, fit_weighted, fixes_rotation};
use crate::memory;
use crate::points::Points;

/// Refines the pose by at most `rounds` iterations of weighted least squares over the correspondences with a
/// residual r below the tolerance, with the weight `1 / (1 + (r / tolerance)^2)`. Ends if their number does
/// not change, or if they do not determine the rotation.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn reweighted(
    pose: &Rigid,
    source: &Points,
    target: &Points,
    tolerance: f64,
    rounds: usize,
) -> Result<Rigid> {
    let mut pose = *pose;
    let mut count = 0;
    for _ in 0..rounds {
        let (mut p, mut q, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..source.len() {
            let (start, end) = (source.get(i), target.get(i));
            let residual = (pose.apply(&start) - end).norm();
            if residual < tolerance {
                memory::push(&mut p, start)?;
                memory::push(&mut q, end)?;
                memory::push(&mut weights, 1.0 / (1.0 + (residual / tolerance).powi(2)))?;
            }
        }
        if p.len() == count || !fixes_rotation(&p, &q) {
            break;
        }
        count = p.len();
        pose = fit_weighted(&p, &q, &weights);
    }
    Ok(pose)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Result;
    use crate::geometry::rigid::fit_rigid;

    /// Points of which the first 30 move by (1, 2, 3) with some noise, and the rest move randomly.
    fn problem() -> Result<(Points, Points)> {
        let place = |i: usize, k: f64| [1.1, 2.3, 3.7].map(|f| 10.0 * (i as f64 * f * k + k).sin());
        let source: Vec<[f64; 3]> = (0..60).map(|i| place(i, 1.0)).collect();
        let noise = |i: usize| 0.05 * (i as f64 * 12.9).sin();
        let moved = |(i, p): (usize, &[f64; 3])| match i {
            0..30 => [p[0] + 1.0 + noise(i), p[1] + 2.0 - noise(i + 7), p[2] + 3.0 + noise(i + 3)],
            _ => place(i, 0.7),
        };
        let target: Vec<_> = source.iter().enumerate().map(moved).collect();
        Ok((Points::from_rows("source", &source)?, Points::from_rows("target", &target)?))
    }

    fn pose_of(source: &Points, target: &Points, rows: std::ops::Range<usize>) -> Rigid {
        let (p, q): (Vec<_>, Vec<_>) = rows.map(|i| (source.get(i), target.get(i))).unzip();
        fit_rigid(&p, &q)
    }

    #[test]
    fn a_pose_of_few_inliers_is_refined_to_that_of_all() -> Result<()> {
        let (source, target) = problem()?;
        let (few, all) = (pose_of(&source, &target, 0..4), pose_of(&source, &target, 0..30));
        let refined = reweighted(&few, &source, &target, 0.5, 20)?;
        assert!((refined.rotation - all.rotation).norm() < (few.rotation - all.rotation).norm() / 4.0);
        assert!((refined.rotation - all.rotation).norm() < 2e-3);
        Ok(())
    }

    #[test]
    fn without_iterations_or_inliers_the_pose_is_kept() -> Result<()> {
        let (source, target) = problem()?;
        let pose = pose_of(&source, &target, 0..4);
        assert_eq!(reweighted(&pose, &source, &target, 0.5, 0)?, pose);
        assert_eq!(reweighted(&pose, &source, &target, 1e-9, 20)?, pose);
        Ok(())
    }
}
