//! Confidence in a group, and further poses of the same confidence.
//!
//! The number of false alarms of a pose counts the supporters that lie apart from each other, for they speak for it
//! independently, and takes for chance how many targets lie near the source points as the pose lays them: a pose that lays
//! surface on surface has more of both. And no reflection is a motion: where the mirror image of one of the best poses has
//! about as many independent supporters as the best, the matches are of mirrored shapes, of one plane, or of nothing.

use super::{Answer, Joined, Problem, Ranked};
use crate::consensus::false_alarms::{Independent, false_alarms, independent};
use crate::consensus::likelihood::Likelihood;
use crate::geometry::rigid::{Rigid, fit_rigid};
use crate::grouping_result::mask_of;
use crate::selection::top_k::largest;
use crate::{Grouping, Result, memory};

/// A group is sure below this.
pub const MOST_FALSE_ALARMS: f64 = 0.01;

/// Distance, in units of the tolerance, of supporters that count each on their own.
pub const APART: f64 = 7.0 / 3.0;

/// Poses whose mirror images are looked at, and the rounds of their refinement.
const REFLECTIONS: usize = 10;
const ROUNDS: usize = 5;
/// Pairs that cliques of mirrored matches grow from.
const MIRRORED_SEEDS: usize = 100;

/// A mirror image has about as many supporters as a pose with more than this share of them.
const AS_MANY: f64 = 0.9;

/// Greatest share that two instances may have in common, of what is in either.
const MOST_SHARED: f64 = 0.3;

/// What poses are judged by.
pub struct Judge<'a> {
    pub problem: &'a Problem<'a>,
    /// By position alone: frames made the poses that they agree with.
    pub likelihood: &'a Likelihood,
}

impl Judge<'_> {
    /// Number of false alarms of the best pose; infinite without one, or where a reflection equals it.
    /// Reflections of cliques are looked at where they are given, as one of several tolerances may miss the best pose's.
    pub fn expected(&self, ranked: &[Ranked], joined: Option<&Joined>) -> Result<f64> {
        match ranked.first() {
            Some(best) if !self.is_equalled_by_a_reflection(ranked, joined)? => self.false_alarms(best, &[]),
            _ => Ok(f64::INFINITY),
        }
    }

    /// The grouping with its number of false alarms, and the masks of up to `most` motions that are sure.
    pub fn judged(
        &self,
        grouping: Grouping,
        answer: &Answer,
        most: usize,
        expected: f64,
    ) -> Result<Grouping> {
        let ok = expected < MOST_FALSE_ALARMS;
        let masks = if most == 1 {
            None
        } else if ok {
            Some(self.instances(answer, most)?)
        } else {
            Some(Vec::new())
        };
        Ok(Grouping { ok: Some(ok), false_alarms: Some(expected), instances: masks, ..grouping })
    }

    /// The masks of the motions that are sure by the matches that better ones leave.
    fn instances(&self, answer: &Answer, most: usize) -> Result<Vec<Vec<bool>>> {
        let mut masks: Vec<Vec<bool>> = Vec::new();
        let mut taken = memory::filled(false, answer.likelihood.len())?;
        for one in &answer.ranked {
            self.problem.execution.check()?;
            if masks.len() == most {
                break;
            }
            let squares = self.likelihood.squared_residuals(&one.mode.pose)?;
            let mask = mask_of(squares.len(), self.problem.group(&squares)?)?;
            let is_new = masks.iter().all(|other| is_other(&mask, other));
            if is_new && self.false_alarms(one, &taken)? < MOST_FALSE_ALARMS {
                taken.iter_mut().zip(&mask).for_each(|(taken, &here)| *taken |= here);
                memory::push(&mut masks, mask)?;
            }
        }
        Ok(masks)
    }

    /// Number of false alarms of a pose among the matches that are not `taken` (none of them where that is empty).
    pub fn false_alarms(&self, one: &Ranked, taken: &[bool]) -> Result<f64> {
        let pose = &one.mode.pose;
        let squares = self.likelihood.squared_residuals(pose)?;
        let mut supporters = self.problem.group(&squares)?;
        supporters.retain(|&i| taken.get(i) != Some(&true));
        let n = squares.len() - taken.iter().filter(|&&taken| taken).count();
        // Where the source lands is known of a sample; supporters surely land on a target.
        let chance = one.landing.chance.max(supporters.len() as f64 / n.max(1) as f64);
        let Independent { count, share } = self.independent(&squares, &supporters)?;
        Ok(false_alarms(n, count, chance * share))
    }

    fn independent(&self, squares: &[f64], supporters: &[usize]) -> Result<Independent> {
        let Problem { source, target, tolerance, .. } = *self.problem;
        independent(source, target, squares, supporters, APART * tolerance)
    }

    /// Whether a motion onto the mirrored target has about as many independent supporters as the best pose: the mirror image
    /// of one of the best poses, or the best motion of cliques.
    fn is_equalled_by_a_reflection(&self, ranked: &[Ranked], joined: Option<&Joined>) -> Result<bool> {
        let Problem { source, target, execution, .. } = *self.problem;
        let mirrored = target.mirrored()?;
        let likelihood = self.likelihood.between(source, &mirrored)?;
        let count = |squares: &[f64]| {
            self.independent(squares, &self.problem.group(squares)?).map(|found| found.count)
        };
        let mut own = None;
        for one in ranked.iter().take(REFLECTIONS) {
            execution.check()?;
            let squares = self.likelihood.squared_residuals(&one.mode.pose)?;
            let of_best = if let Some(own) = own { own } else { count(&squares)? };
            own = Some(of_best);
            let image = self.reflection(&squares, &likelihood)?;
            if count(&likelihood.squared_residuals(&image)?)? as f64 > AS_MANY * of_best as f64 {
                return Ok(true);
            }
        }
        let Some(joined) = joined else { return Ok(false) };
        let poses = self.problem.cliques(joined, &mirrored, MIRRORED_SEEDS)?;
        let scores = memory::collect(poses.iter().map(|pose| likelihood.support(pose).score))?;
        let Some(&best) = largest(&scores, 1)?.first() else { return Ok(false) };
        let image = likelihood.refined(&poses[best], std::iter::repeat_n(likelihood.deviation(), ROUNDS))?;
        let of_image = count(&likelihood.squared_residuals(&image)?)? as f64;
        Ok(of_image > AS_MANY * own.unwrap_or_default() as f64)
    }

    /// The motion onto the mirrored target that fits the group of a pose, refined.
    fn reflection(&self, squares: &[f64], mirrored: &Likelihood) -> Result<Rigid> {
        let group = self.problem.group(squares)?;
        let p = memory::collect(group.iter().map(|&i| mirrored.points(i).0))?;
        let q = memory::collect(group.iter().map(|&i| mirrored.points(i).1))?;
        mirrored.refined(&fit_rigid(&p, &q), std::iter::repeat_n(mirrored.deviation(), ROUNDS))
    }
}

/// Whether two masks have little in common.
fn is_other(a: &[bool], b: &[bool]) -> bool {
    let count = |counts: fn(bool, bool) -> bool| a.iter().zip(b).filter(|&(&a, &b)| counts(a, b)).count();
    (count(|a, b| a && b) as f64) < MOST_SHARED * count(|a, b| a || b) as f64
}
