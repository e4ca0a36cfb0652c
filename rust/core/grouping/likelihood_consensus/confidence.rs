//! Confidence in a group, and further poses with the same confidence.
//!
//! The number of false alarms of a pose counts the supporters that lie apart from each other, since these are
//! independent evidence. The chance level is the number of targets near the source points under the pose: a
//! pose that aligns surfaces has more of both. If that does not suffice, smaller radii are tried
//! (`precision.rs`). A pose that a reflection equals is not significant (`reflections.rs`).

use super::{Answer, Problem, Ranked, precision};
use crate::consensus::false_alarms::{Independent, false_alarms, independent};
use crate::consensus::likelihood::Likelihood;
use crate::grouping_result::mask_of;
use crate::{Grouping, Result, memory};

/// Bound on the number of false alarms of a significant group.
pub const MOST_FALSE_ALARMS: f64 = 0.01;

/// Least distance between independent supporters, in units of the tolerance.
pub const APART: f64 = 7.0 / 3.0;

/// Number of false alarms, relative to the bound, that is significant for any number of tolerances.
const SURELY: f64 = 0.1;

/// Greatest intersection over union of two instances.
const MOST_SHARED: f64 = 0.3;

/// Evaluates the significance of poses.
pub struct Judge<'a> {
    pub problem: &'a Problem<'a>,
    /// By position alone: poses from frames agree with them by construction.
    pub likelihood: &'a Likelihood,
}

impl Judge<'_> {
    /// Number of false alarms of the best pose, if no reflection equals it; infinite without a pose. Smaller
    /// radii are tried for rigid motions only: an estimated scale adapts to few exact matches.
    pub fn expected(&self, ranked: &[Ranked], is_rigid: bool) -> Result<f64> {
        let Some(best) = ranked.first() else { return Ok(f64::INFINITY) };
        let expected = self.false_alarms(best, &[])?;
        if !is_rigid || expected < SURELY * MOST_FALSE_ALARMS {
            return Ok(expected);
        }
        Ok(precision::false_alarms(self.problem, self.likelihood, &best.mode.pose)?.min(expected))
    }

    /// Adds the number of false alarms to a grouping, and the masks of up to `most` significant motions.
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

    /// The masks of the motions that are significant among the matches left by better ones.
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
            // The best is significant by this radius or a smaller one.
            let is_sure = masks.is_empty() || self.false_alarms(one, &taken)? < MOST_FALSE_ALARMS;
            if is_new && is_sure {
                taken.iter_mut().zip(&mask).for_each(|(taken, &here)| *taken |= here);
                memory::push(&mut masks, mask)?;
            }
        }
        Ok(masks)
    }

    /// Number of false alarms of a pose among the matches that are not `taken` (empty: none are).
    pub fn false_alarms(&self, one: &Ranked, taken: &[bool]) -> Result<f64> {
        let pose = &one.mode.pose;
        let squares = self.likelihood.squared_residuals(pose)?;
        let mut supporters = self.problem.group(&squares)?;
        supporters.retain(|&i| taken.get(i) != Some(&true));
        let n = squares.len() - taken.iter().filter(|&&taken| taken).count();
        // The landing is measured on a sample; each supporter lies near a target by definition.
        let chance = one.landing.chance.max(supporters.len() as f64 / n.max(1) as f64);
        let Independent { count, share } = self.independent(&squares, &supporters)?;
        Ok(false_alarms(n, count, chance * share))
    }

    pub(super) fn independent(&self, squares: &[f64], supporters: &[usize]) -> Result<Independent> {
        let Problem { source, target, tolerance, .. } = *self.problem;
        independent(source, target, squares, supporters, APART * tolerance)
    }
}

/// Whether two masks have a small intersection over union.
fn is_other(a: &[bool], b: &[bool]) -> bool {
    let count = |counts: fn(bool, bool) -> bool| a.iter().zip(b).filter(|&(&a, &b)| counts(a, b)).count();
    (count(|a, b| a && b) as f64) < MOST_SHARED * count(|a, b| a || b) as f64
}
