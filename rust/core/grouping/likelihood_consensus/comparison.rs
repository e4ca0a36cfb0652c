//! Compares the modes of several tolerances.
//!
//! A score with a tolerance is comparable with that of another pose with the same tolerance only: the level
//! and the number of supporters by chance depend on it. The modes of all tolerances are therefore scored with
//! each of them, and the greatest mean score wins.

use std::ops::Range;

use super::Problem;
use super::attempts::Attempt;
use crate::consensus::landing::landings;
use crate::selection::top_k::largest;
use crate::{Result, memory};

/// Modes of each tolerance that are compared.
const CANDIDATES: usize = 8;

/// The greatest tolerance that scores modes, in units of the first: with greater ones, most supporters are
/// near by chance.
const GREATEST: f64 = 2.0;

/// Removes and returns the attempt with the best mode, with its modes in the order of their mean scores.
pub fn take_best<'a>(attempts: &mut Vec<Attempt<'a>>) -> Result<Attempt<'a>> {
    let (mut best, mut most, mut scores) = (0, f64::NEG_INFINITY, Vec::new());
    for k in 0..attempts.len() {
        let of_attempt = mean_scores(attempts, k, 0..CANDIDATES)?;
        let greatest = of_attempt.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if greatest > most {
            (best, most, scores) = (k, greatest, of_attempt);
        }
    }
    memory::extend(&mut scores, &mean_scores(attempts, best, CANDIDATES..usize::MAX)?)?;
    let order = largest(&scores, scores.len())?;
    let mut found = attempts.swap_remove(best);
    let ranked = &mut found.answer.ranked;
    ranked.iter_mut().zip(scores).for_each(|(one, score)| one.score = score);
    *ranked = memory::collect(order.into_iter().map(|k| ranked[k]))?;
    Ok(found)
}

/// Mean scores over the tolerances of some modes of an attempt.
fn mean_scores(attempts: &[Attempt<'_>], own: usize, modes: Range<usize>) -> Result<Vec<f64>> {
    let ranked = &attempts[own].answer.ranked;
    let ranked = &ranked[modes.start.min(ranked.len())..modes.end.min(ranked.len())];
    let poses = memory::collect(ranked.iter().map(|one| one.mode.pose))?;
    let mut sums = memory::filled(0.0, ranked.len())?;
    let greatest = attempts.first().map_or(0.0, |first| GREATEST * first.problem.tolerance);
    let is_compared = |(_, attempt): &(usize, &Attempt<'_>)| attempt.problem.tolerance <= greatest;
    let mut count = 0.0;
    for (k, attempt) in attempts.iter().enumerate().filter(is_compared) {
        count += 1.0;
        if k == own {
            sums.iter_mut().zip(ranked).for_each(|(sum, one)| *sum += one.score);
            continue;
        }
        let Problem { source, target, execution, .. } = attempt.problem;
        let landed = landings(&poses, source, target, attempt.problem.group_radius(), execution)?;
        for ((sum, pose), landing) in sums.iter_mut().zip(&poses).zip(landed) {
            *sum += attempt.likelihood.support(pose).score * landing.coverage;
        }
    }
    sums.iter_mut().for_each(|sum| *sum /= f64::max(count, 1.0));
    Ok(sums)
}
