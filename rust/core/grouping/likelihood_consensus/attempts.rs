//! Attempts with one tolerance or several.
//!
//! If no tolerance is given, steps 1 to 8 use the likeliest one. Others follow without frames, in steps of a
//! factor of two in both directions, until one answer is significant. The noise under the answer is
//! estimated, and the pose is refined with it (`noise.rs`). If the noise is too large for the tolerance, the
//! poses found are scored again with the tolerance that matches the noise. If a resolution is given, another
//! tolerance only decides whether the motion found is significant, unless the given one is far too large for
//! the noise. Without a resolution, the fewest false alarms win.

use std::rc::Rc;

use nalgebra::Matrix3;

use super::confidence::{Judge, MOST_FALSE_ALARMS};
use super::{
    Answer, DEVIATION, Joined, LikelihoodConsensus, MOST_VERTICES, Problem, SEEDS, Scale, frames, noise,
};
use crate::consensus::false_alarms::is_fewer;
use crate::consensus::likelihood::Likelihood;
use crate::consensus::modes::displacement;
use crate::error::positive;
use crate::geometry::rigid::Rigid;
use crate::rule::{Agreement, Kind, Rule};
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};

/// Default tolerance in resolutions.
const RESOLUTIONS: f64 = 3.0;

/// Range of other tolerances in powers of two, with a given resolution and without one.
const OCTAVES: (i32, i32) = (2, 4);

/// A tolerance is too small if the noise exceeds this multiple of its deviation, and too large if the noise
/// is below its deviation divided by the second number.
const TOO_SMALL: f64 = 1.5;
const TOO_GREAT: f64 = 6.0;

/// Poses that displace the source points by less than this many tolerances (root mean square) are the same
/// motion.
const NEAR: f64 = 2.0;

/// Result of one tolerance.
pub struct Attempt<'a> {
    pub problem: Problem<'a>,
    joined: Rc<Joined>,
    hypotheses: Vec<Rigid>,
    pub likelihood: Likelihood,
    pub answer: Answer,
    pub false_alarms: f64,
}

impl LikelihoodConsensus {
    /// Returns the poses of [`Grouping::alternatives`] for a tolerance, by position alone, the best first.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] for a tolerance that is not positive; [`crate::Error::Interrupted`],
    /// [`crate::Error::OutOfMemory`].
    pub fn propose(
        &self,
        correspondences: &Correspondences,
        tolerance: f64,
        execution: &Execution,
    ) -> Result<Vec<Rigid>> {
        let (source, target) = correspondences.positions("lc")?;
        let tolerance = positive("tolerance", tolerance)?;
        let problem = Problem { source, target, tolerance, modes: self.modes, execution };
        let cliques = problem.cliques(&problem.join(MOST_VERTICES)?, target, SEEDS)?;
        let ranked = problem.rank(&problem.likelihood(correspondences.optional_ratio())?, &cliques)?;
        memory::collect(ranked.iter().map(|one| one.mode.pose.uncentered(source, target)))
    }

    /// Groups with a scale of 1.
    pub(super) fn run_known(
        &self,
        correspondences: &Correspondences,
        execution: &Execution,
    ) -> Result<Grouping> {
        let (source, _) = correspondences.positions("lc")?;
        let tolerances = self.tolerances(correspondences, source, execution)?;
        let rotations = frames::proposed_rotations(correspondences)?;
        let rotations = rotations.as_deref();
        // Each tolerance tried is one more chance of a false alarm.
        let tried = tolerances.len() as f64;
        let is_told = correspondences.resolution().is_some();
        let mut found = self.attempt(correspondences, source, tolerances[0], rotations, execution)?;
        for tolerance in &tolerances[1..] {
            if found.is_sure(tried) {
                break;
            }
            let other = self.attempt(correspondences, source, *tolerance, None, execution)?;
            let is_better = if is_told {
                other.is_sure(tried) && found.is_near(&other)
            } else {
                is_fewer(other.false_alarms, found.false_alarms)
            };
            if is_better && is_told && found.is_narrow()? {
                found.false_alarms = other.false_alarms;
            } else if is_better {
                found = other;
                self.settle(&mut found, rotations)?;
            }
        }
        self.finish(correspondences, found, rotations, tried)
    }

    /// Reports the result, adapted to the noise unless a tolerance is given.
    pub(super) fn finish(
        &self,
        correspondences: &Correspondences,
        mut found: Attempt<'_>,
        rotations: Option<&[Option<Matrix3<f64>>]>,
        tried: f64,
    ) -> Result<Grouping> {
        let mut noise = None;
        if self.tolerance.is_none() {
            noise = found.refine_by_noise(tried)?;
            if let Some(wider) = self.suited(correspondences, &found, rotations, tried, noise)? {
                found = wider;
                noise = found.refine_by_noise(tried)?;
            }
        }
        found.false_alarms *= tried;
        Ok(Grouping { noise, ..found.report(self.instances)? })
    }

    /// The tolerances to try, the likeliest first, for a source in the target's unit.
    pub(super) fn tolerances(
        &self,
        correspondences: &Correspondences,
        source: &Points,
        execution: &Execution,
    ) -> Result<Vec<f64>> {
        if let Some(given) = self.tolerance {
            return Ok(vec![positive("tolerance", given)?]);
        }
        let (first, reach) = match correspondences.resolution() {
            Some(resolution) => (RESOLUTIONS * resolution, OCTAVES.0),
            None => {
                (noise::likely_tolerance(source, correspondences.positions("lc")?.1, execution)?, OCTAVES.1)
            }
        };
        let both = (1..=reach).flat_map(|octave| [octave, -octave]);
        Ok(std::iter::once(0).chain(both).map(|octave| first * 2.0_f64.powi(octave)).collect())
    }

    /// Result of a tolerance, by position alone unless rotations are given.
    pub(super) fn attempt<'a>(
        &self,
        correspondences: &'a Correspondences,
        source: &'a Points,
        tolerance: f64,
        rotations: Option<&[Option<Matrix3<f64>>]>,
        execution: &'a Execution,
    ) -> Result<Attempt<'a>> {
        let (_, target) = correspondences.positions("lc")?;
        let problem = Problem { source, target, tolerance, modes: self.modes, execution };
        let joined = Rc::new(problem.join(MOST_VERTICES)?);
        let cliques = problem.cliques(&joined, target, SEEDS)?;
        self.judge(correspondences, problem, joined, cliques, rotations)
    }

    /// Scores hypotheses with a problem's tolerance.
    fn judge<'a>(
        &self,
        correspondences: &Correspondences,
        problem: Problem<'a>,
        joined: Rc<Joined>,
        hypotheses: Vec<Rigid>,
        rotations: Option<&[Option<Matrix3<f64>>]>,
    ) -> Result<Attempt<'a>> {
        let likelihood = problem.likelihood(correspondences.optional_ratio())?;
        let ranked = problem.rank(&likelihood, &hypotheses)?;
        let answer = Answer { likelihood: likelihood.copied()?, ranked, by_frames: false };
        let false_alarms = f64::INFINITY;
        let mut found = Attempt { problem, joined, hypotheses, likelihood, answer, false_alarms };
        self.settle(&mut found, rotations)?;
        Ok(found)
    }

    /// Applies frames if there are any, and computes the number of false alarms of the answer.
    fn settle(&self, found: &mut Attempt<'_>, rotations: Option<&[Option<Matrix3<f64>>]>) -> Result<()> {
        if let Some(rotations) = rotations {
            let (judge, by_position) = (found.judge(), &found.answer);
            let counted =
                frames::with_frames(&judge, by_position, rotations, &found.joined, &found.hypotheses)?;
            if let Some(answer) = counted {
                found.answer = answer;
            }
        }
        let joined = self.tolerance.is_none().then_some(&*found.joined);
        let is_rigid = self.scale == Scale::Known;
        found.false_alarms = found.judge().expected(&found.answer.ranked, joined, is_rigid)?;
        Ok(())
    }

    /// The result rescored with the tolerance that matches the noise, if the current one is too small and the
    /// new result is significant.
    fn suited<'a>(
        &self,
        correspondences: &Correspondences,
        found: &Attempt<'a>,
        rotations: Option<&[Option<Matrix3<f64>>]>,
        tried: f64,
        noise: Option<f64>,
    ) -> Result<Option<Attempt<'a>>> {
        let Some(noise) = noise.filter(|noise| *noise > TOO_SMALL * DEVIATION * found.problem.tolerance)
        else {
            return Ok(None);
        };
        let poses = memory::collect(found.answer.ranked.iter().map(|one| one.mode.pose))?;
        let problem = Problem { tolerance: noise / DEVIATION, ..found.problem };
        let wider = self.judge(correspondences, problem, Rc::clone(&found.joined), poses, rotations)?;
        Ok(wider.is_sure(tried).then_some(wider))
    }
}

impl Attempt<'_> {
    fn judge(&self) -> Judge<'_> {
        Judge { problem: &self.problem, likelihood: &self.likelihood }
    }

    /// Whether the best pose is significant, given the number of tolerances tried.
    fn is_sure(&self, tried: f64) -> bool {
        self.false_alarms * tried < MOST_FALSE_ALARMS
    }

    fn best_pose(&self) -> Option<&Rigid> {
        self.answer.ranked.first().map(|best| &best.mode.pose)
    }

    /// Whether the best poses of two attempts are the same motion, or this one has none.
    fn is_near(&self, other: &Self) -> bool {
        let (Some(pose), Some(of_other)) = (self.best_pose(), other.best_pose()) else {
            return self.best_pose().is_none();
        };
        let tolerance = self.problem.tolerance.max(other.problem.tolerance);
        displacement(pose, of_other, self.problem.source) < NEAR * tolerance
    }

    /// Whether the tolerance is not far larger than the noise under the best pose requires.
    fn is_narrow(&self) -> Result<bool> {
        let Some(pose) = self.best_pose() else { return Ok(false) };
        let (_, noise) = noise::refined(&self.problem, &self.answer.likelihood, pose)?;
        Ok(TOO_GREAT * noise > DEVIATION * self.problem.tolerance)
    }

    /// Returns the noise under the best pose, and refines the pose by it if it is significant.
    fn refine_by_noise(&mut self, tried: f64) -> Result<Option<f64>> {
        let is_sure = self.is_sure(tried);
        let Some(best) = self.answer.ranked.first_mut() else { return Ok(None) };
        let (pose, noise) = noise::refined(&self.problem, &self.answer.likelihood, &best.mode.pose)?;
        if is_sure {
            best.mode.pose = pose;
        }
        Ok(Some(noise))
    }

    fn report(&self, instances: usize) -> Result<Grouping> {
        let Self { problem, answer, false_alarms, .. } = self;
        let grouping = self.judge().judged(problem.report(answer)?, answer, instances, *false_alarms)?;
        let rule = Rule::bounded(Kind::Residual, problem.group_radius()).or_equal();
        let grouping = grouping.by(rule.agreeing(Agreement::difference(problem.tolerance)));
        let grouping = grouping.with("resolution", problem.tolerance / RESOLUTIONS);
        let dimensions = problem.dimensions(&grouping.mask)?;
        let grouping = grouping.with("dimensions", dimensions as f64);
        let grouping = grouping.with("hypotheses", self.hypotheses.len() as f64);
        let grouping = grouping.with("by_frames", f64::from(u8::from(answer.by_frames)));
        Ok(grouping.with("vertices", self.joined.vertices.len() as f64))
    }
}
