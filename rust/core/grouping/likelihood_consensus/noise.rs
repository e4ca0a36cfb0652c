//! The noise of correct correspondences, from the residuals under a pose.
//!
//! The radius is the one within which the number of supporters is most significant: an a-contrario threshold
//! (Moisan, Moulon, Monasse: Automatic homographic registration of a pair of images, with a contrario
//! elimination of outliers, IPOL 2012). Its ratio to the standard deviation of correct correspondences is
//! that of a group's radius.

use super::confidence::APART;
use super::{DEVIATION, GROUP, Problem};
use crate::consensus::false_alarms::{EQUAL, independent, ln_false_alarms};
use crate::consensus::landing::landings;
use crate::consensus::likelihood::Likelihood;
use crate::consensus::modes::annealed;
use crate::geometry::neighbors::NearestNeighbors;
use crate::geometry::resolution::mean_nearest_distance;
use crate::geometry::rigid::Rigid;
use crate::{Error, Execution, Points, Result, memory};
use rayon::prelude::*;

/// The first tolerance tried, in mean distances of neighbouring points.
const SPACINGS: f64 = 0.8;

/// Points whose neighbours are measured where the exact mean is not needed.
const SAMPLES: usize = 1_000;

/// Radii per factor of two, and most radii tried on both sides of the group's.
const STEPS_PER_OCTAVE: f64 = 2.0;
const MOST_STEPS: i32 = 8;
/// Number of radii on each side of the best that have to be worse.
const WORSE: i32 = 2;

/// Iterations of refinement.
const ROUNDS: usize = 5;

/// A tolerance that suits the spacing of the matches; arbitrary if all points of a side coincide.
pub fn likely_tolerance(source: &Points, target: &Points, execution: &Execution) -> Result<f64> {
    let spacing = spacing(source, execution)?.min(spacing(target, execution)?);
    Ok(if spacing.is_finite() { SPACINGS * spacing } else { 1.0 })
}

/// As [`likely_tolerance`], by the nearest neighbours of points evenly spread over the input.
pub fn sampled_tolerance(source: &Points, target: &Points, execution: &Execution) -> Result<f64> {
    let spacing = sampled_spacing(source, execution)?.min(sampled_spacing(target, execution)?);
    Ok(if spacing.is_finite() { SPACINGS * spacing } else { 1.0 })
}

/// Mean distance of some points to their nearest neighbours elsewhere; infinite without such neighbours.
fn sampled_spacing(points: &Points, execution: &Execution) -> Result<f64> {
    let (n, count) = (points.len(), points.len().min(SAMPLES));
    let rows = memory::collect((0..count).map(|k| k * n / count))?;
    let nearest = NearestNeighbors::new(points, execution)?.of_rows(&rows, 1, execution)?;
    let (mut sum, mut elsewhere) = (0.0, 0.0);
    for (&i, &j) in rows.iter().zip(&nearest) {
        let distance = (points.get(i) - points.get(j as usize)).norm();
        sum += distance;
        elsewhere += f64::from(u8::from(distance > 0.0));
    }
    Ok(if elsewhere > 0.0 { sum / elsewhere } else { f64::INFINITY })
}

/// Mean distance of points to their nearest neighbours; infinite without neighbours.
fn spacing(points: &Points, execution: &Execution) -> Result<f64> {
    match mean_nearest_distance(&NearestNeighbors::new(points, execution)?, true, execution) {
        Err(Error::InvalidInput { .. }) => Ok(f64::INFINITY),
        found => found,
    }
}

/// The pose refined by its noise, and the noise: the standard deviation of correct correspondences.
pub fn refined(problem: &Problem<'_>, likelihood: &Likelihood, pose: &Rigid) -> Result<(Rigid, f64)> {
    let mut tried: Vec<Trial> = Vec::new();
    let mut best = 0;
    loop {
        let is_new = |step: &i32| step.abs() <= MOST_STEPS && tried.iter().all(|trial| trial.step != *step);
        let steps = memory::collect((best - WORSE..=best + WORSE).filter(is_new))?;
        if steps.is_empty() {
            break;
        }
        let look = |step: &i32| Trial::new(problem, likelihood, pose, *step).map(Some);
        let found = memory::par_try_collect(steps.par_iter().map(look))?;
        memory::reserve(&mut tried, found.len())?;
        tried.extend(found.into_iter().flatten());
        // Of equal trials, the one nearest to the given tolerance.
        let rounded = |trial: &Trial| (trial.value / EQUAL).round();
        let order =
            |a: &&Trial, b: &&Trial| rounded(a).total_cmp(&rounded(b)).then(a.step.abs().cmp(&b.step.abs()));
        best = tried.iter().min_by(order).map_or(0, |trial| trial.step);
    }
    let found = tried.into_iter().find(|trial| trial.step == best);
    Ok(found.map_or((*pose, likelihood.deviation()), |trial| (trial.pose, trial.deviation)))
}

/// A deviation, the pose refined by it, and the logarithm of the number of false alarms within its radius.
#[derive(Clone)]
struct Trial {
    step: i32,
    deviation: f64,
    pose: Rigid,
    value: f64,
}

impl Trial {
    fn new(problem: &Problem<'_>, likelihood: &Likelihood, pose: &Rigid, step: i32) -> Result<Self> {
        let Problem { source, target, execution, .. } = *problem;
        execution.check()?;
        let radius = problem.group_radius() * (f64::from(step) / STEPS_PER_OCTAVE).exp2();
        let deviation = radius * DEVIATION / GROUP;
        let pose = likelihood.refined(pose, annealed(deviation, ROUNDS))?;
        let squares = likelihood.squared_residuals(&pose)?;
        let supporters = memory::collect((0..squares.len()).filter(|&i| squares[i] <= radius * radius))?;
        let n = squares.len();
        let landed = landings(&[pose], source, target, radius, execution)?;
        let near = landed.first().map_or(0.0, |landing| landing.chance);
        let chance = near.max(supporters.len() as f64 / n.max(1) as f64);
        let apart = independent(source, target, &squares, &supporters, APART / GROUP * radius)?;
        // Large sets are sampled: the rest lies apart as often.
        let count = (apart.share * supporters.len() as f64).round() as usize;
        let value = ln_false_alarms(n, count, chance * apart.share);
        Ok(Self { step, deviation, pose, value })
    }
}
