//! Attempts with one tolerance or several.
//!
//! If no tolerance is given, steps 1 to 8 use the likeliest one. If its answer leaves a doubt, four others
//! follow without frames, in steps of a factor of two in both directions. The best modes of all are compared
//! by their mean score with the same tolerances, since scores of different ones are not comparable. Another
//! tolerance that finds the same motion can make it significant, unless a reflection that equals the motion
//! has nearly as many supporters there. Without a resolution, still others follow until one is significant.
//! The residuals determine the group's radius (`width.rs`) and refine the pose.

use std::rc::Rc;

use nalgebra::Matrix3;

use super::comparison::take_best;
use super::confidence::{Judge, MOST_FALSE_ALARMS};
use super::reflections::{NEARLY_AS_MANY, Reflections};
use super::{
    Answer, DEVIATION, GROUP, Joined, LikelihoodConsensus, MOST_VERTICES, Problem, REACH, SEEDS, Scale,
    frames, noise, width,
};
use crate::consensus::false_alarms::{EQUAL, is_fewer};
use crate::consensus::landing::landings;
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

/// Tolerances whose modes are compared.
const COMPARED: usize = 5;

/// Number of false alarms that makes other tolerances unnecessary.
const CLEAR: f64 = 1e-4;

/// Poses that displace the source points by less than this many tolerances (root mean square) are the same
/// motion.
const NEAR: f64 = 2.0;

/// Iterations of refinement by the group's radius.
const ROUNDS: usize = 6;

/// Result of one tolerance.
pub struct Attempt<'a> {
    pub problem: Problem<'a>,
    joined: Rc<Joined>,
    hypotheses: Vec<Rigid>,
    pub likelihood: Likelihood,
    pub answer: Answer,
    pub false_alarms: f64,
    /// A reflection that equals the best pose.
    reflection: Option<Rigid>,
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
        let mut found = self.attempt(correspondences, source, tolerances[0], None, execution)?;
        let is_clear = tolerances.len() == 1 || found.false_alarms * tried < CLEAR;
        if !is_clear {
            if let Some(framed) = self.framed(correspondences, &found, rotations, tried)? {
                return self.finish(correspondences, framed, tried);
            }
            found = self.compared(correspondences, found, &tolerances, tried)?;
        }
        if rotations.is_some() {
            let by_position = found.false_alarms;
            self.settle(&mut found, rotations)?;
            if !found.answer.by_frames {
                found.false_alarms = by_position; // of another tolerance, if fewer
            }
        }
        self.finish(correspondences, found, tried)
    }

    /// The answer of frames, if it is significant.
    fn framed<'a>(
        &self,
        correspondences: &Correspondences,
        found: &Attempt<'a>,
        rotations: Option<&[Option<Matrix3<f64>>]>,
        tried: f64,
    ) -> Result<Option<Attempt<'a>>> {
        let Some(rotations) = rotations else { return Ok(None) };
        let hypotheses = memory::copied(&found.hypotheses)?;
        let joined = Rc::clone(&found.joined);
        let framed = self.judge(correspondences, found.problem, joined, hypotheses, Some(rotations))?;
        Ok(Some(framed).filter(|framed| framed.answer.by_frames && framed.is_sure(tried)))
    }

    /// The attempt with the best mode of several tolerances.
    fn compared<'a>(
        &self,
        correspondences: &'a Correspondences,
        first: Attempt<'a>,
        tolerances: &[f64],
        tried: f64,
    ) -> Result<Attempt<'a>> {
        let Problem { source, execution, .. } = first.problem;
        let more = |tolerance: &f64| self.attempt(correspondences, source, *tolerance, None, execution);
        let (compared, others) = tolerances.split_at(tolerances.len().min(COMPARED));
        let mut attempts = Vec::new();
        memory::push(&mut attempts, first)?;
        for tolerance in &compared[1..] {
            memory::push(&mut attempts, more(tolerance)?)?;
        }
        let mut found = take_best(&mut attempts)?;
        self.settle(&mut found, None)?;
        for other in attempts.iter().filter(|other| other.is_sure(tried)) {
            let is_surer = found.is_near(other) && is_fewer(other.false_alarms, found.false_alarms);
            if is_surer && !other.is_doubted(&found)? {
                found.false_alarms = other.false_alarms;
            }
        }
        if correspondences.resolution().is_none() {
            for tolerance in others {
                if found.is_sure(tried) {
                    break;
                }
                let other = more(tolerance)?;
                if is_fewer(other.false_alarms, found.false_alarms) {
                    found = other;
                }
            }
        }
        Ok(found)
    }

    /// Reports the result, adapted to the noise unless a tolerance is given.
    pub(super) fn finish(
        &self,
        correspondences: &Correspondences,
        mut found: Attempt<'_>,
        tried: f64,
    ) -> Result<Grouping> {
        let mut noise = None;
        if self.tolerance.is_none() {
            noise = found.adapt(correspondences, tried, self.instances > 1)?;
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
        let (false_alarms, reflection) = (f64::INFINITY, None);
        let mut found = Attempt { problem, joined, hypotheses, likelihood, answer, false_alarms, reflection };
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
        found.reflection = match found.best_pose() {
            Some(pose) => Reflections::of(&found.judge(), pose)?.find(&found.answer.ranked, joined)?,
            None => None,
        };
        found.false_alarms = match found.reflection {
            Some(_) => f64::INFINITY,
            None => found.judge().expected(&found.answer.ranked, is_rigid)?,
        };
        Ok(())
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

    /// Whether a reflection that equals the best pose of `found` has nearly as many supporters as that pose
    /// with this tolerance.
    fn is_doubted(&self, found: &Self) -> Result<bool> {
        let (Some(image), Some(pose)) = (&found.reflection, found.best_pose()) else { return Ok(false) };
        Ok(Reflections::of(&self.judge(), pose)?.share(image)?.0 > NEARLY_AS_MANY)
    }

    /// Whether the best poses of two attempts are the same motion, or this one has none.
    fn is_near(&self, other: &Self) -> bool {
        let (Some(pose), Some(of_other)) = (self.best_pose(), other.best_pose()) else {
            return self.best_pose().is_none();
        };
        let tolerance = self.problem.tolerance.max(other.problem.tolerance);
        displacement(pose, of_other, self.problem.source) < NEAR * tolerance
    }

    /// Returns the noise under the best pose, takes the radius of the group from the residuals, and refines
    /// the pose by the lesser of both. `is_landed`: counts the targets near all poses anew, for instances.
    fn adapt(
        &mut self,
        correspondences: &Correspondences,
        tried: f64,
        is_landed: bool,
    ) -> Result<Option<f64>> {
        let Some(pose) = self.best_pose().copied() else { return Ok(None) };
        let Problem { source, target, execution, .. } = self.problem;
        let (exact, noise) = noise::refined(&self.problem, &self.answer.likelihood, &pose)?;
        let likely = noise::sampled_tolerance(source, target, execution)?;
        let given = correspondences.resolution().map(|resolution| GROUP * RESOLUTIONS * resolution);
        let squares = self.answer.likelihood.squared_residuals(&pose)?;
        let radius = width::radius(&squares, likely, given, GROUP / DEVIATION * noise)?;
        let tolerance = radius / GROUP;
        let deviation = DEVIATION * tolerance;
        self.problem = Problem { tolerance, ..self.problem };
        for likelihood in [&mut self.likelihood, &mut self.answer.likelihood] {
            likelihood.set_lengths(deviation, REACH * tolerance);
        }
        let refined = if noise < (1.0 - EQUAL) * deviation && self.is_sure(tried) {
            exact
        } else {
            self.answer.likelihood.refined(&pose, std::iter::repeat_n(deviation, ROUNDS))?
        };
        self.answer.ranked.iter_mut().take(1).for_each(|one| one.mode.pose = refined);
        if is_landed {
            self.land()?;
        }
        Ok(Some(noise))
    }

    /// Counts the targets within the group's radius of the moved source points.
    fn land(&mut self) -> Result<()> {
        let Problem { source, target, execution, .. } = self.problem;
        let ranked = &mut self.answer.ranked;
        let poses = memory::collect(ranked.iter().map(|one| one.mode.pose))?;
        let landed = landings(&poses, source, target, self.problem.group_radius(), execution)?;
        ranked.iter_mut().zip(landed).for_each(|(one, landing)| one.landing = landing);
        Ok(())
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
