//! Reflections that equal a pose.
//!
//! A reflection is not a motion: if the mirror image of one of the best poses has about as many independent
//! supporters as the best, the matches are of mirrored shapes, of one line, or random. A reflection in the
//! plane of the supporters is the same placement and does not count.

use super::confidence::Judge;
use super::{Joined, Ranked};
use crate::consensus::likelihood::Likelihood;
use crate::geometry::rigid::{Rigid, fit_rigid, fixes_rotation};
use crate::selection::top_k::largest;
use crate::{Points, Result, memory};

/// Number of poses whose mirror images are tested, and iterations of their refinement.
const REFLECTIONS: usize = 10;
const ROUNDS: usize = 5;
/// Number of pairs from which cliques of mirrored matches grow.
const MIRRORED_SEEDS: usize = 100;

/// A mirror image has about as many supporters as a pose if it has more than this share of them.
const AS_MANY: f64 = 0.9;

/// Share of supporters with another tolerance that keeps a reflection equal to a pose.
pub const NEARLY_AS_MANY: f64 = 0.8;

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

/// Motions onto the mirrored target, compared with a pose.
pub struct Reflections<'a> {
    judge: &'a Judge<'a>,
    mirrored: Points,
    likelihood: Likelihood,
    /// Squared residuals of the pose.
    squares: Vec<f64>,
    /// Number of its independent supporters.
    count: usize,
}

impl<'a> Reflections<'a> {
    /// Compares with `pose`.
    pub fn of(judge: &'a Judge<'a>, pose: &Rigid) -> Result<Self> {
        let mirrored = judge.problem.target.mirrored()?;
        let likelihood = judge.likelihood.between(judge.problem.source, &mirrored)?;
        let squares = judge.likelihood.squared_residuals(pose)?;
        let count = independent_count(judge, &squares)?;
        Ok(Self { judge, mirrored, likelihood, squares, count })
    }

    /// A reflection that equals the pose: the mirror image of one of the best poses, or the best motion of
    /// mirrored cliques. Cliques are tested if `joined` is given, since one of several tolerances may miss
    /// the best pose's.
    pub fn find(&self, ranked: &[Ranked], joined: Option<&Joined>) -> Result<Option<Rigid>> {
        let Judge { problem, likelihood } = *self.judge;
        for one in ranked.iter().take(REFLECTIONS) {
            problem.execution.check()?;
            let group = problem.group(&likelihood.squared_residuals(&one.mode.pose)?)?;
            let p = memory::collect(group.iter().map(|&i| self.likelihood.points(i).0))?;
            let q = memory::collect(group.iter().map(|&i| self.likelihood.points(i).1))?;
            if fixes_rotation(&p, &q) {
                let image = fit_rigid(&p, &q);
                if self.is_equal(&image)? {
                    return Ok(Some(image));
                }
            }
        }
        let Some(joined) = joined else { return Ok(None) };
        let poses = problem.cliques(joined, &self.mirrored, MIRRORED_SEEDS)?;
        let scores = memory::collect(poses.iter().map(|pose| self.likelihood.support(pose).score))?;
        let Some(&best) = largest(&scores, 1)?.first() else { return Ok(None) };
        Ok(self.is_equal(&poses[best])?.then_some(poses[best]))
    }

    /// Whether a refined reflection has about as many independent supporters as the pose, at another
    /// placement.
    fn is_equal(&self, image: &Rigid) -> Result<bool> {
        let (share, of_image) = self.share(image)?;
        let is_same = self.is_same_placement(&of_image)?;
        Ok(is_same.map_or(share > AS_MANY, |is_same| !is_same))
    }

    /// Number of independent supporters of a refined reflection divided by that of the pose, and the squared
    /// residuals.
    pub fn share(&self, image: &Rigid) -> Result<(f64, Vec<f64>)> {
        let deviation = self.likelihood.deviation();
        let image = self.likelihood.refined(image, std::iter::repeat_n(deviation, ROUNDS))?;
        let squares = self.likelihood.squared_residuals(&image)?;
        Ok((independent_count(self.judge, &squares)? as f64 / self.count.max(1) as f64, squares))
    }

    /// Whether a reflection with the pose's supporters is the same placement: it fits them no better, and
    /// they determine the pose, as coplanar ones do and collinear ones do not; `None` if it has other
    /// supporters.
    fn is_same_placement(&self, of_image: &[f64]) -> Result<Option<bool>> {
        let problem = self.judge.problem;
        let limit = problem.group_radius().powi(2);
        let group = problem.group(&self.squares)?;
        let common = memory::collect(group.iter().copied().filter(|&i| of_image[i] <= limit))?;
        let all = group.len() + of_image.iter().filter(|&&square| square <= limit).count() - common.len();
        let count = common.len() as f64;
        if count <= SAME * all as f64 {
            return Ok(None);
        }
        let rounding = (ROUNDING * problem.tolerance).powi(2);
        let mean = |squares: &[f64]| common.iter().map(|&i| squares[i]).sum::<f64>() / count + rounding;
        let (own, of_image) = (mean(&self.squares), mean(of_image));
        let [_, second, _] = problem.variances(&common);
        let is_same =
            own <= (BETTER + DEVIATIONS / count.sqrt()) * of_image && second > ON_A_LINE.powi(2) * own;
        Ok(Some(is_same))
    }
}

/// Number of independent supporters.
fn independent_count(judge: &Judge<'_>, squares: &[f64]) -> Result<usize> {
    judge.independent(squares, &judge.problem.group(squares)?).map(|found| found.count)
}
