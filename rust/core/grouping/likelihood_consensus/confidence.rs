//! Confidence in a group, and further poses with the same confidence.
//!
//! The number of false alarms of a pose counts the supporters that lie apart from each other, since these are
//! independent evidence. The chance level is the number of targets near the source points under the pose: a
//! pose that aligns surfaces has more of both. If that does not suffice, smaller radii are tried
//! (`precision.rs`). A reflection is not a motion: if the mirror image of one of the best poses has about as
//! many independent supporters as the best, the matches are of mirrored shapes, of one line, or random. A
//! reflection in the plane of the supporters is the same placement and does not count.

use super::{Answer, Joined, Problem, Ranked, precision};
use crate::consensus::false_alarms::{Independent, false_alarms, independent};
use crate::consensus::likelihood::Likelihood;
use crate::geometry::rigid::{Rigid, fit_rigid, fixes_rotation};
use crate::grouping_result::mask_of;
use crate::selection::top_k::largest;
use crate::{Grouping, Result, memory};

/// Bound on the number of false alarms of a significant group.
pub const MOST_FALSE_ALARMS: f64 = 0.01;

/// Least distance between independent supporters, in units of the tolerance.
pub const APART: f64 = 7.0 / 3.0;

/// Number of poses whose mirror images are tested, and iterations of their refinement.
const REFLECTIONS: usize = 10;
const ROUNDS: usize = 5;
/// Number of pairs from which cliques of mirrored matches grow.
const MIRRORED_SEEDS: usize = 100;

/// A mirror image has about as many supporters as a pose if it has more than this share of them.
const AS_MANY: f64 = 0.9;

/// Least intersection over union of the supporters of a pose and of the same placement, mirrored in their
/// plane.
const SAME: f64 = 0.8;

/// A placement fits better than another if its sum of squares is smaller by this factor, and by this many
/// standard deviations (both fits have noise along the plane's normal).
const BETTER: f64 = 1.1;
const DEVIATIONS: f64 = 3.0;

/// Supporters are collinear if their second spread is at most this many residuals.
const ON_A_LINE: f64 = 2.0;

/// Rounding of a residual, relative to the tolerance.
const ROUNDING: f64 = 1e-6;

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
    /// Number of false alarms of the best pose; infinite without a pose, or if a reflection equals it.
    /// Reflections of cliques are tested if `joined` is given, since one of several tolerances may miss the
    /// best pose's. Smaller radii are tried for rigid motions only: an estimated scale adapts to few exact
    /// matches.
    pub fn expected(&self, ranked: &[Ranked], joined: Option<&Joined>, is_rigid: bool) -> Result<f64> {
        let Some(best) = ranked.first() else { return Ok(f64::INFINITY) };
        if self.is_equalled_by_a_reflection(ranked, joined)? {
            return Ok(f64::INFINITY);
        }
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

    fn independent(&self, squares: &[f64], supporters: &[usize]) -> Result<Independent> {
        let Problem { source, target, tolerance, .. } = *self.problem;
        independent(source, target, squares, supporters, APART * tolerance)
    }

    /// Whether a motion onto the mirrored target has about as many independent supporters as the best pose,
    /// at another placement: the mirror image of one of the best poses, or the best motion of cliques.
    fn is_equalled_by_a_reflection(&self, ranked: &[Ranked], joined: Option<&Joined>) -> Result<bool> {
        let Problem { source, target, execution, .. } = *self.problem;
        let Some(best) = ranked.first() else { return Ok(false) };
        let mirrored = target.mirrored()?;
        let likelihood = self.likelihood.between(source, &mirrored)?;
        let own = self.likelihood.squared_residuals(&best.mode.pose)?;
        let count = |squares: &[f64]| {
            self.independent(squares, &self.problem.group(squares)?).map(|found| found.count)
        };
        let least = AS_MANY * count(&own)? as f64;
        let is_rival = |image: &Rigid| {
            let image = likelihood.refined(image, std::iter::repeat_n(likelihood.deviation(), ROUNDS))?;
            let squares = likelihood.squared_residuals(&image)?;
            match self.is_same_placement(&own, &squares)? {
                Some(is_same) => Ok(!is_same),
                None => Ok(count(&squares)? as f64 > least),
            }
        };
        for one in ranked.iter().take(REFLECTIONS) {
            execution.check()?;
            let group = self.problem.group(&self.likelihood.squared_residuals(&one.mode.pose)?)?;
            let p = memory::collect(group.iter().map(|&i| likelihood.points(i).0))?;
            let q = memory::collect(group.iter().map(|&i| likelihood.points(i).1))?;
            if fixes_rotation(&p, &q) && is_rival(&fit_rigid(&p, &q))? {
                return Ok(true);
            }
        }
        let Some(joined) = joined else { return Ok(false) };
        let poses = self.problem.cliques(joined, &mirrored, MIRRORED_SEEDS)?;
        let scores = memory::collect(poses.iter().map(|pose| likelihood.support(pose).score))?;
        largest(&scores, 1)?.first().map_or(Ok(false), |&best| is_rival(&poses[best]))
    }

    /// Whether a reflection with the pose's supporters is the same placement: it fits them no better, and
    /// they determine the pose, as coplanar ones do and collinear ones do not; `None` if it has other
    /// supporters.
    fn is_same_placement(&self, squares: &[f64], of_image: &[f64]) -> Result<Option<bool>> {
        let limit = self.problem.group_radius().powi(2);
        let group = self.problem.group(squares)?;
        let common = memory::collect(group.iter().copied().filter(|&i| of_image[i] <= limit))?;
        let all = group.len() + of_image.iter().filter(|&&square| square <= limit).count() - common.len();
        let count = common.len() as f64;
        if count <= SAME * all as f64 {
            return Ok(None);
        }
        let rounding = (ROUNDING * self.problem.tolerance).powi(2);
        let mean = |squares: &[f64]| common.iter().map(|&i| squares[i]).sum::<f64>() / count + rounding;
        let (own, of_image) = (mean(squares), mean(of_image));
        let [_, second, _] = self.problem.variances(&common);
        let is_same =
            own <= (BETTER + DEVIATIONS / count.sqrt()) * of_image && second > ON_A_LINE.powi(2) * own;
        Ok(Some(is_same))
    }
}

/// Whether two masks have a small intersection over union.
fn is_other(a: &[bool], b: &[bool]) -> bool {
    let count = |counts: fn(bool, bool) -> bool| a.iter().zip(b).filter(|&(&a, &b)| counts(a, b)).count();
    (count(|a, b| a && b) as f64) < MOST_SHARED * count(|a, b| a || b) as f64
}
