//! Modes of the likelihood: the best poses, each scored without the matches explained by better poses.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::likelihood::{Likelihood, Support};
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::points::Points;
use crate::selection::top_k::largest;

/// Iterations of refinement before a mode's supporters are removed.
const FIRST_ROUNDS: usize = 4;

/// Iterations of the last refinement.
const LAST_ROUNDS: usize = 10;

/// Initial deviation of annealing, as a multiple of the deviation.
const ANNEALED_FROM: f64 = 1.6;

/// Fewest supporters of a mode.
const LEAST_SUPPORTERS: usize = 3;

/// A pose with its support.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// Between the centred points.
    pub pose: Rigid,
    /// Support among all correspondences.
    pub support: Support,
}

/// A hypothesis with its score after `round` modes were removed.
#[derive(Debug, Clone, PartialEq, Default)]
struct Candidate {
    score: f64,
    index: usize,
    round: usize,
}

impl Eq for Candidate {}

impl Ord for Candidate {
    /// The greater score, then the lower index.
    fn cmp(&self, other: &Self) -> Ordering {
        self.score.total_cmp(&other.score).then(other.index.cmp(&self.index))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// At most `most` modes from the hypotheses and their refinements, the best first; any two of them displace
/// the source points by at least `tolerance` from each other (root mean square).
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn find_modes(
    likelihood: &Likelihood,
    hypotheses: &[Rigid],
    most: usize,
    source: &Points,
    tolerance: f64,
    execution: &Execution,
) -> Result<Vec<Mode>> {
    let poses = peel(likelihood, hypotheses, most, execution)?;
    let deviation = likelihood.deviation();
    let finish = |pose: &Rigid| {
        execution.check()?;
        let pose = likelihood.refined(pose, annealed(deviation, LAST_ROUNDS))?;
        Ok(Some(Mode { pose, support: likelihood.support(&pose) }))
    };
    let modes = memory::par_try_collect(poses.par_iter().map(finish))?;
    let modes = memory::collect(modes.into_iter().flatten())?;
    let order = largest(&memory::collect(modes.iter().map(|mode| mode.support.score))?, modes.len())?;
    distinct(order.into_iter().map(|k| modes[k]), source, tolerance)
}

/// The deviations of `rounds` iterations of refinement, from a multiple of the deviation down to it.
pub fn annealed(deviation: f64, rounds: usize) -> impl Iterator<Item = f64> {
    (0..rounds).map(move |round| {
        let progress = round as f64 / (rounds - 1) as f64;
        deviation * (ANNEALED_FROM + (1.0 - ANNEALED_FROM) * progress)
    })
}

/// Selects and refines the best hypothesis, removes its supporters, and repeats. Scores are updated only when
/// needed: they can only fall.
fn peel(
    likelihood: &Likelihood,
    hypotheses: &[Rigid],
    most: usize,
    execution: &Execution,
) -> Result<Vec<Rigid>> {
    let score = |(index, pose): (usize, &Rigid)| {
        execution.check()?;
        Ok(Candidate { score: likelihood.support(pose).score, index, round: 0 })
    };
    let candidates = memory::par_try_collect(hypotheses.par_iter().enumerate().map(score))?;
    let mut candidates = BinaryHeap::from(candidates);
    let mut left = likelihood.copied()?;
    let (mut modes, mut round) = (Vec::new(), 0);
    while modes.len() < most
        && let Some(best) = candidates.pop()
    {
        execution.check()?;
        let pose = &hypotheses[best.index];
        if best.round < round {
            let score = left.support(pose).score;
            candidates.push(Candidate { score, round, ..best }); // takes the place of the best one
            continue;
        }
        if best.score <= 0.0 {
            break;
        }
        let pose = left.refined(pose, std::iter::repeat_n(left.deviation(), FIRST_ROUNDS))?;
        if left.support(&pose).supporters >= LEAST_SUPPORTERS {
            left = left.without_supporters(&pose)?;
            round += 1;
            memory::push(&mut modes, pose)?;
        }
    }
    Ok(modes)
}

/// Removes modes that differ from a better one by less than the tolerance.
fn distinct(modes: impl Iterator<Item = Mode>, source: &Points, tolerance: f64) -> Result<Vec<Mode>> {
    let scatter = scatter(source);
    let mut kept: Vec<Mode> = Vec::new();
    for mode in modes {
        let is_new = |other: &Mode| mean_square(&mode.pose, &other.pose, &scatter) >= tolerance * tolerance;
        if mode.support.supporters >= LEAST_SUPPORTERS && kept.iter().all(is_new) {
            memory::push(&mut kept, mode)?;
        }
    }
    Ok(kept)
}

/// Root mean square displacement between the points moved by two poses.
pub fn displacement(a: &Rigid, b: &Rigid, source: &Points) -> f64 {
    mean_square(a, b, &scatter(source)).sqrt()
}

/// Mean of `p p^T` over the centred points.
fn scatter(points: &Points) -> Matrix3<f64> {
    let mut sum = Matrix3::zeros();
    for i in 0..points.len() {
        let p: Vector3<f64> = points.get(i).coords;
        sum += p * p.transpose();
    }
    sum / points.len().max(1) as f64
}

/// Mean squared displacement between the centred points moved by two poses.
fn mean_square(a: &Rigid, b: &Rigid, scatter: &Matrix3<f64>) -> f64 {
    let turned = a.rotation - b.rotation;
    (turned * scatter * turned.transpose()).trace() + (a.translation - b.translation).norm_squared()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::consensus::likelihood::levels::levels;
    use crate::geometry::rigid::fit_rigid;

    /// Points of which the first 40 stay, the next 25 move together, and the rest move randomly.
    fn problem() -> Result<(Points, Points)> {
        let place = |i: usize, k: f64| [1.1, 2.3, 3.7].map(|f| 100.0 * (i as f64 * f * k + k).sin());
        let source: Vec<[f64; 3]> = (0..200).map(|i| place(i, 1.0)).collect();
        let moved = |(i, p): (usize, &[f64; 3])| match i {
            0..40 => *p,
            40..65 => [-p[1] + 30.0, p[0], p[2]],
            _ => place(i, 0.7),
        };
        let target: Vec<_> = source.iter().enumerate().map(moved).collect();
        Ok((Points::from_rows("source", &source)?, Points::from_rows("target", &target)?))
    }

    fn motion(source: &Points, target: &Points, rows: std::ops::Range<usize>) -> Rigid {
        let (p, q): (Vec<_>, Vec<_>) = rows.map(|i| (source.get(i), target.get(i))).unzip();
        fit_rigid(&p, &q)
    }

    #[test]
    fn finds_each_motion_once_the_better_supported_first() -> Result<()> {
        let (source, target) = problem()?;
        let execution = Execution::default();
        let levels = levels(&source, &target, None, 5.0, &execution)?;
        let likelihood = Likelihood::new(&source, &target, &levels, 2.0, 6.0)?;
        let (many, few) = (motion(&source, &target, 0..40), motion(&source, &target, 40..65));
        let hypotheses = [few, motion(&source, &target, 42..47), many, motion(&source, &target, 3..9)];
        let modes = find_modes(&likelihood, &hypotheses, 10, &source, 3.0, &execution)?;
        assert_eq!(modes.len(), 2);
        for (mode, (motion, supporters)) in modes.iter().zip([(many, 40), (few, 25)]) {
            assert!(mean_square(&mode.pose, &motion, &scatter(&source)) < 0.1);
            assert!(mode.support.supporters >= supporters);
        }
        let one = find_modes(&likelihood, &hypotheses, 1, &source, 3.0, &execution)?;
        assert_eq!(one, modes[..1]);
        Ok(())
    }

    #[test]
    fn a_pose_with_two_supporters_is_not_a_mode() -> Result<()> {
        let (source, target) = problem()?;
        let (source, target) = (source.subset(&[0, 1, 70, 80])?, target.subset(&[0, 1, 70, 80])?);
        let likelihood = Likelihood::new(&source, &target, &[2.0; 4], 2.0, 6.0)?;
        let hypotheses = [motion(&source, &target, 0..2)];
        assert!(find_modes(&likelihood, &hypotheses, 9, &source, 3.0, &Execution::default())?.is_empty());
        Ok(())
    }

    #[test]
    fn distance_of_poses_is_the_mean_over_the_points() -> Result<()> {
        let (source, target) = problem()?;
        let (a, b) = (motion(&source, &target, 0..40), motion(&source, &target, 70..90));
        let plain: f64 = (0..source.len())
            .map(|i| (a.apply(&source.get(i)) - b.apply(&source.get(i))).norm_squared())
            .sum();
        let mean = mean_square(&a, &b, &scatter(&source));
        assert!((mean - plain / source.len() as f64).abs() < 1e-9 * mean);
        Ok(())
    }
}
