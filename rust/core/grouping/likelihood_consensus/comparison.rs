//! Compares the modes of several tolerances.
//!
//! A score with a tolerance is comparable with that of another pose with the same tolerance only: the level
//! and the number of supporters by chance depend on it. The modes of all tolerances are therefore scored with
//! each of them, and the greatest mean score wins.

use super::Problem;
use super::attempts::Attempt;
use crate::consensus::landing::landings;
use crate::geometry::rigid::Rigid;
use crate::selection::top_k::largest;
use crate::{Result, memory};

/// Modes of each tolerance that are compared.
const CANDIDATES: usize = 8;

/// The greatest tolerance that scores modes, in units of the first: with greater ones, most supporters are
/// near by chance.
const GREATEST: f64 = 2.0;

/// Removes and returns the attempt with the best mode, with its modes in the order of their mean scores.
pub fn take_best<'a>(attempts: &mut Vec<Attempt<'a>>) -> Result<Attempt<'a>> {
    let (mut best, mut most) = (0, f64::NEG_INFINITY);
    for (k, attempt) in attempts.iter().enumerate() {
        for score in mean_scores(attempts, &poses_of(attempt, CANDIDATES)?)? {
            if score > most {
                (best, most) = (k, score);
            }
        }
    }
    let poses = poses_of(&attempts[best], usize::MAX)?;
    let scores = mean_scores(attempts, &poses)?;
    let order = largest(&scores, scores.len())?;
    let mut found = attempts.swap_remove(best);
    let ranked = &mut found.answer.ranked;
    ranked.iter_mut().zip(scores).for_each(|(one, score)| one.score = score);
    *ranked = memory::collect(order.into_iter().map(|k| ranked[k]))?;
    Ok(found)
}

fn poses_of(attempt: &Attempt<'_>, most: usize) -> Result<Vec<Rigid>> {
    memory::collect(attempt.answer.ranked.iter().take(most).map(|one| one.mode.pose))
}

/// Mean over the tolerances of the scores of poses.
fn mean_scores(attempts: &[Attempt<'_>], poses: &[Rigid]) -> Result<Vec<f64>> {
    let mut sums = memory::filled(0.0, poses.len())?;
    let greatest = attempts.first().map_or(0.0, |first| GREATEST * first.problem.tolerance);
    let mut count = 0.0;
    for attempt in attempts.iter().filter(|attempt| attempt.problem.tolerance <= greatest) {
        let Problem { source, target, execution, .. } = attempt.problem;
        let landed = landings(poses, source, target, attempt.problem.group_radius(), execution)?;
        for ((sum, pose), landing) in sums.iter_mut().zip(poses).zip(landed) {
            *sum += attempt.likelihood.support(pose).score * landing.coverage;
        }
        count += 1.0;
    }
    sums.iter_mut().for_each(|sum| *sum /= f64::max(count, 1.0));
    Ok(sums)
}
