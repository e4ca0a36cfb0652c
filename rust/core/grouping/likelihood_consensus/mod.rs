//! LC: the pose under which the correspondences are likeliest, beside chance.
//!
//! Likelihood consensus, a method of this library. With lengths in units u of a third of the tolerance:
//!
//! 1. The level of a correspondence: `L_i = ln(s n / D_i) + clip(8 (0.87 - ratio_i), -0.8, 3)`, where `s = max(1 / 100, 10 / n)`
//!    is the share that is right where nothing is known, and `D_i` the greater of the sums over k of
//!    `max(0, 1 - d_ik^2 / 25)` around `p_i` and around `p'_i`: how many end there anyway.
//! 2. Correspondences are joined where `|ds - dt| < 3` and both lengths exceed 6, and from each of the 1,000 pairs with
//!    the most common neighbours grows a clique of up to 12 members, whose least-squares motion is a hypothesis.
//!    Of more than 2,500 correspondences only those are joined for which `|ds - dt| < 3` holds with the most others,
//!    ties to the lower index: right ones are among them, be they few or many.
//! 3. The support of a pose: the sum of `max(0, L_i - r_i^2 / (2 2.7^2))` over residuals `r_i` below 6.
//! 4. The best pose is refined by weighted least squares, its supporters are taken out, and so on; then each is
//!    refined among all correspondences, with a deviation that falls from 1.6 times 2.7 to 2.7.
//! 5. Frames, where there are any: whether they count is asked of the poses found so far (`frames.rs`). If they do, stars of
//!    frames propose poses too, each term gets what its frames say and is divided by how many go wrong together
//!    (`frames.rs`), and step 4 is done again.
//! 6. The score of a pose is its support times the share of source points that it lays within 5 of any target; the best wins.
//! 7. The group: residuals of at most 5 under it.
//! 8. The number of false alarms, and further instances (`confidence.rs`).
//!
//! Where no tolerance is given, steps 1 to 8 are done with the likeliest one, and without frames with others, twice as large each,
//! on both ways, until one answer is sure. The noise is estimated under it, and the pose refined by that (`noise.rs`). Where it is
//! more than the tolerance allows for, the poses that were found are judged again with the tolerance that belongs to it.
//! Where a resolution is given, another tolerance only says whether the motion that was found is sure, unless the given one is far
//! too great for the noise. Without one, the fewest false alarms win.
//!
//! Cost O(n^2) tests of pairs, and O(n) a hypothesis.

mod confidence;
mod frames;
mod noise;

use std::rc::Rc;

use nalgebra::{Matrix3, Vector3};

use confidence::{Judge, MOST_FALSE_ALARMS};

use super::GroupingMethod;
use crate::compatibility::agreement::DistanceAgreement;
use crate::compatibility::graph::AgreementGraph;
use crate::consensus::choice::poses_among;
use crate::consensus::cliques::clique_poses;
use crate::consensus::landing::{Landing, landings};
use crate::consensus::likelihood::Likelihood;
use crate::consensus::likelihood::levels::levels;
use crate::consensus::modes::{Mode, displacement, find_modes};
use crate::error::positive;
use crate::geometry::rigid::Rigid;
use crate::grouping_result::{Alternative, mask_of};
use crate::options::method;
use crate::rule::{Agreement, Kind, Rule};
use crate::selection::top_k::largest;
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};

/// Lengths in units of the tolerance: standard deviation of a right match, residuals that count in the score, and in
/// the group, radius of the chance level, least length of an edge.
const DEVIATION: f64 = 0.9;
const REACH: f64 = 2.0;
const GROUP: f64 = 5.0 / 3.0;
const CHANCE: f64 = 5.0 / 3.0;
const SHORTEST: f64 = 2.0;

/// Pairs that cliques grow from.
const SEEDS: usize = 1_000;

/// Resolutions in a tolerance.
const RESOLUTIONS: f64 = 3.0;

/// Powers of two by which other tolerances are tried, where a resolution is given and where none is.
const OCTAVES: (i32, i32) = (2, 4);

/// A tolerance is too small for noise of more than this many times its deviation, and too great for less than one of so many
/// parts of it.
const TOO_SMALL: f64 = 1.5;
const TOO_GREAT: f64 = 6.0;

/// Poses that lay the source points less than this many tolerances apart (root mean square) are the same motion.
const NEAR: f64 = 2.0;

/// Correspondences whose cliques are sought.
const MOST_VERTICES: usize = 2_500;

method! {
    /// Parameters of likelihood consensus.
    pub struct LikelihoodConsensus = "lc", ["source", "target"],
        optional ["ratio", "source_lrf", "target_lrf", "resolution"], {
        /// Greatest distance difference of two that agree, a length, from which all others follow. By default 3
        /// resolutions, and where these leave no sure answer, other powers of 2 times that; without a resolution from 0.8
        /// times the distance of neighbouring points.
        pub tolerance: Option<f64> = None;
        /// Most poses that are returned, the best among them.
        pub modes: usize = 40;
        /// Most rigid motions whose groups are returned.
        pub instances: usize = 1;
    }
}

/// Matched points and what all steps share.
#[derive(Clone, Copy)]
struct Problem<'a> {
    source: &'a Points,
    target: &'a Points,
    tolerance: f64,
    modes: usize,
    execution: &'a Execution,
}

/// A mode, how it lays the source, and its score.
#[derive(Debug, Clone, Copy)]
struct Ranked {
    mode: Mode,
    landing: Landing,
    score: f64,
}

/// What the matches say, with frames or without.
struct Answer {
    likelihood: Likelihood,
    /// The modes, the best first.
    ranked: Vec<Ranked>,
    /// Whether frames count in it.
    by_frames: bool,
}

/// What was found with one tolerance.
struct Attempt<'a> {
    problem: Problem<'a>,
    joined: Rc<Joined>,
    hypotheses: Vec<Rigid>,
    likelihood: Likelihood,
    answer: Answer,
    false_alarms: f64,
}

impl GroupingMethod for LikelihoodConsensus {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let tolerances = self.tolerances(correspondences, execution)?;
        let rotations = frames::proposed_rotations(correspondences)?;
        let rotations = rotations.as_deref();
        // Each of several tolerances could have found by chance what one did.
        let tried = tolerances.len() as f64;
        let is_told = correspondences.resolution().is_some();
        let mut found = self.attempt(correspondences, tolerances[0], execution)?;
        self.count_frames(&mut found, rotations)?;
        for tolerance in &tolerances[1..] {
            if found.is_sure(tried) {
                break;
            }
            let other = self.attempt(correspondences, *tolerance, execution)?;
            let is_better = if is_told {
                other.is_sure(tried) && found.is_near(&other)?
            } else {
                other.false_alarms < found.false_alarms
            };
            if is_better && is_told && found.is_narrow()? {
                found.false_alarms = other.false_alarms;
            } else if is_better {
                found = other;
                self.count_frames(&mut found, rotations)?;
            }
        }
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
}

impl LikelihoodConsensus {
    /// The tolerances to try, the likeliest first.
    fn tolerances(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Vec<f64>> {
        if let Some(given) = self.tolerance {
            return Ok(vec![positive("tolerance", given)?]);
        }
        let (first, reach) = match correspondences.resolution() {
            Some(resolution) => (RESOLUTIONS * resolution, OCTAVES.0),
            None => (noise::likely_tolerance(correspondences, execution)?, OCTAVES.1),
        };
        let both = (1..=reach).flat_map(|octave| [octave, -octave]);
        Ok(std::iter::once(0).chain(both).map(|octave| first * 2.0_f64.powi(octave)).collect())
    }

    /// What position alone finds with a tolerance.
    fn attempt<'a>(
        &self,
        correspondences: &'a Correspondences,
        tolerance: f64,
        execution: &'a Execution,
    ) -> Result<Attempt<'a>> {
        let (source, target) = correspondences.positions("lc")?;
        let problem = Problem { source, target, tolerance, modes: self.modes, execution };
        let joined = Rc::new(problem.join()?);
        let cliques = problem.cliques(&joined, target, SEEDS)?;
        self.judge(correspondences, problem, joined, cliques)
    }

    /// Hypotheses by position, by the measure of a problem's tolerance.
    fn judge<'a>(
        &self,
        correspondences: &Correspondences,
        problem: Problem<'a>,
        joined: Rc<Joined>,
        hypotheses: Vec<Rigid>,
    ) -> Result<Attempt<'a>> {
        let Problem { source, target, tolerance, execution, .. } = problem;
        let levels = levels(source, target, correspondences.optional_ratio(), CHANCE * tolerance, execution)?;
        let likelihood = Likelihood::new(source, target, &levels, DEVIATION * tolerance, REACH * tolerance)?;
        let ranked = problem.rank(&likelihood, &hypotheses)?;
        let answer = Answer { likelihood: likelihood.copied()?, ranked, by_frames: false };
        let false_alarms = f64::INFINITY;
        let mut found = Attempt { problem, joined, hypotheses, likelihood, answer, false_alarms };
        found.false_alarms = self.expected(&found)?;
        Ok(found)
    }

    /// Number of false alarms with one tolerance.
    fn expected(&self, found: &Attempt<'_>) -> Result<f64> {
        found.judge().expected(&found.answer.ranked, self.tolerance.is_none().then_some(&*found.joined))
    }

    /// Lets frames count where there are any.
    fn count_frames(
        &self,
        found: &mut Attempt<'_>,
        rotations: Option<&[Option<Matrix3<f64>>]>,
    ) -> Result<()> {
        let Some(rotations) = rotations else { return Ok(()) };
        let (judge, by_position) = (found.judge(), &found.answer);
        let counted = frames::with_frames(&judge, by_position, rotations, &found.joined, &found.hypotheses)?;
        if let Some(answer) = counted {
            found.answer = answer;
            found.false_alarms = self.expected(found)?;
        }
        Ok(())
    }

    /// What was found, judged anew with the tolerance that suits the noise, where its own is too small and this is sure.
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
        let mut wider = self.judge(correspondences, problem, Rc::clone(&found.joined), poses)?;
        self.count_frames(&mut wider, rotations)?;
        Ok(wider.is_sure(tried).then_some(wider))
    }
}

impl Attempt<'_> {
    fn judge(&self) -> Judge<'_> {
        Judge { problem: &self.problem, likelihood: &self.likelihood }
    }

    /// Whether the best pose is no chance, of as many tolerances as were tried.
    fn is_sure(&self, tried: f64) -> bool {
        self.false_alarms * tried < MOST_FALSE_ALARMS
    }

    fn best_pose(&self) -> Option<&Rigid> {
        self.answer.ranked.first().map(|best| &best.mode.pose)
    }

    /// Whether the best poses of two attempts are the same motion, or here is none.
    fn is_near(&self, other: &Self) -> Result<bool> {
        let (Some(pose), Some(of_other)) = (self.best_pose(), other.best_pose()) else {
            return Ok(self.best_pose().is_none());
        };
        let tolerance = self.problem.tolerance.max(other.problem.tolerance);
        Ok(displacement(pose, of_other, self.problem.source) < NEAR * tolerance)
    }

    /// Whether the tolerance is not far greater than the noise under the best pose asks for.
    fn is_narrow(&self) -> Result<bool> {
        let Some(pose) = self.best_pose() else { return Ok(false) };
        let (_, noise) = noise::refined(&self.problem, &self.answer.likelihood, pose)?;
        Ok(TOO_GREAT * noise > DEVIATION * self.problem.tolerance)
    }

    /// Refines the best pose, if it is sure, by the noise under it, and returns that.
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

impl Problem<'_> {
    /// The modes among hypotheses, the best first.
    fn rank(&self, likelihood: &Likelihood, hypotheses: &[Rigid]) -> Result<Vec<Ranked>> {
        let modes =
            find_modes(likelihood, hypotheses, self.modes, self.source, self.tolerance, self.execution)?;
        let poses = memory::collect(modes.iter().map(|mode| mode.pose))?;
        let landings = landings(&poses, self.source, self.target, self.group_radius(), self.execution)?;
        let rank = |(mode, landing): (Mode, Landing)| Ranked {
            mode,
            landing,
            score: mode.support.score * landing.coverage,
        };
        let ranked = memory::collect(modes.into_iter().zip(landings).map(rank))?;
        let order = largest(&memory::collect(ranked.iter().map(|one| one.score))?, ranked.len())?;
        memory::collect(order.into_iter().map(|k| ranked[k]))
    }

    /// Directions in which the group's source points spread by more than twice the noise that is allowed for: 3 for a body,
    /// 2 for one plane, 1 for one line.
    fn dimensions(&self, mask: &[bool]) -> Result<usize> {
        let source = self.source;
        let rows = memory::collect((0..mask.len()).filter(|&i| mask[i]))?;
        let count = rows.len().max(1) as f64;
        let mean = rows.iter().map(|&i| source.get(i).coords).sum::<Vector3<f64>>() / count;
        let scatter = |&i: &usize| {
            let offset = source.get(i).coords - mean;
            offset * offset.transpose()
        };
        let covariance = rows.iter().map(scatter).sum::<Matrix3<f64>>() / count;
        let least = (2.0 * DEVIATION * self.tolerance).powi(2);
        Ok(covariance.symmetric_eigenvalues().iter().filter(|&&variance| variance > least).count())
    }

    /// Greatest residual in a group.
    fn group_radius(&self) -> f64 {
        GROUP * self.tolerance
    }

    /// The rows with a residual in the group.
    fn group(&self, squares: &[f64]) -> Result<Vec<usize>> {
        let limit = self.group_radius().powi(2);
        memory::collect((0..squares.len()).filter(|&i| squares[i] <= limit))
    }

    fn report(&self, answer: &Answer) -> Result<Grouping> {
        let n = self.source.len();
        let alternative = |one: &Ranked| Alternative {
            model: one.mode.pose.uncentered(self.source, self.target).to_matrix(),
            score: one.score,
        };
        let alternatives = memory::collect(answer.ranked.iter().map(alternative))?;
        let Some(best) = answer.ranked.first() else {
            let scores = Some(memory::filled(0.0, n)?);
            return Ok(Grouping { scores, alternatives: Some(alternatives), ..Grouping::empty(n)? });
        };
        let pose = &best.mode.pose;
        let grouping = Grouping {
            mask: mask_of(n, self.group(&answer.likelihood.squared_residuals(pose)?)?)?,
            scores: Some(answer.likelihood.posteriors(pose)?),
            model: alternatives.first().map(|best| best.model),
            alternatives: Some(alternatives),
            ..Grouping::default()
        };
        let supporters = best.mode.support.supporters as f64;
        Ok(grouping.with("score", best.score).with("supporters", supporters))
    }
}

/// The graph of those that keep their distances, and the rows that it is made of.
struct Joined {
    vertices: Vec<usize>,
    graph: AgreementGraph,
}

impl Problem<'_> {
    /// Joins all, or those that agree with the most others.
    fn join(&self) -> Result<Joined> {
        let Problem { source, target, tolerance, execution, .. } = *self;
        let shortest = SHORTEST * tolerance;
        if source.len() <= MOST_VERTICES {
            let graph = AgreementGraph::new(source, target, tolerance, shortest, execution)?;
            return Ok(Joined { vertices: memory::collect(0..source.len())?, graph });
        }
        let vertices =
            DistanceAgreement::new(source, target, tolerance)?.most_agreeing(MOST_VERTICES, execution)?;
        let (p, q) = (source.subset(&vertices)?, target.subset(&vertices)?);
        let graph = AgreementGraph::new(&p, &q, tolerance, shortest, execution)?;
        Ok(Joined { vertices, graph })
    }

    /// The motions of cliques onto the target, or its mirror image, between the centred points.
    fn cliques(&self, joined: &Joined, target: &Points, seeds: usize) -> Result<Vec<Rigid>> {
        let Problem { source, execution, .. } = *self;
        let some = (joined.vertices.len() < source.len()).then_some(joined.vertices.as_slice());
        poses_among(some, source, target, |p, q| clique_poses(&joined.graph, p, q, seeds, execution))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grouping::test_problem::problem;

    #[test]
    fn finds_the_moved_points() -> Result<()> {
        let group = LikelihoodConsensus::default().group(&problem(400, 30)?, &Execution::default())?;
        assert!(group.mask[..30].iter().all(|&selected| selected) && group.size() < 35);
        let model = group.model.unwrap_or_default();
        assert!((model[(0, 1)] + 1.0).abs() < 1e-3 && (model[(0, 3)] - 7.0).abs() < 0.1, "{model}");
        let alternatives = group.alternatives.unwrap_or_default();
        assert_eq!(alternatives.first().map(|best| best.model), Some(model));
        assert!(alternatives.is_sorted_by(|a, b| a.score >= b.score) && alternatives.len() > 1);
        let scores = group.scores.unwrap_or_default();
        assert!(scores[..30].iter().all(|&score| score > 0.5));
        Ok(())
    }

    #[test]
    fn too_few_or_coincident_points_give_no_group() -> Result<()> {
        for n in 0..3 {
            let group = LikelihoodConsensus::default().group(&problem(n, n)?, &Execution::default())?;
            assert_eq!((group.size(), group.alternatives, group.model), (0, Some(Vec::new()), None));
        }
        let rows = [[1.0; 3]; 50];
        let input = Correspondences::new(&rows, &rows)?.with_resolution(1.0)?;
        assert_eq!(LikelihoodConsensus::default().group(&input, &Execution::default())?.size(), 0);
        Ok(())
    }

    #[test]
    fn more_than_the_graph_takes_are_thinned_and_said_to_be() -> Result<()> {
        let group = LikelihoodConsensus::default().group(&problem(3_000, 100)?, &Execution::default())?;
        assert!(group.mask[..100].iter().all(|&selected| selected));
        assert_eq!(group.diagnostics.get("vertices"), Some(&2_500.0));
        Ok(())
    }

    #[test]
    fn many_right_ones_are_no_false_alarm_and_none_are() -> Result<()> {
        let lc = LikelihoodConsensus { instances: 3, ..LikelihoodConsensus::default() };
        let sure = lc.group(&problem(400, 30)?, &Execution::default())?;
        assert!(sure.ok == Some(true) && sure.false_alarms < Some(1e-6));
        assert_eq!(sure.instances, Some(vec![sure.mask]));
        assert_eq!(sure.diagnostics.get("dimensions"), Some(&3.0));
        let chance = lc.group(&problem(400, 0)?, &Execution::default())?;
        assert!(chance.ok == Some(false) && chance.false_alarms > Some(1.0));
        assert_eq!(chance.instances, Some(Vec::new()));
        Ok(())
    }

    #[test]
    fn no_unit_or_a_wrong_one_finds_the_same_and_its_noise() -> Result<()> {
        let given = problem(400, 40)?;
        for scale in [0.25, 1.0, 4.0] {
            let other = given.clone().with_resolution(scale)?;
            let group = LikelihoodConsensus::default().group(&other, &Execution::default())?;
            assert!(group.ok == Some(true) && group.mask[..40].iter().all(|&selected| selected));
            assert!(group.noise < Some(1.0), "{:?}", group.noise);
        }
        let (source, target) = given.positions("lc")?;
        let rows = |points: &Points| points.rows().collect::<Vec<_>>();
        let bare = Correspondences::new(&rows(source), &rows(target))?;
        let group = LikelihoodConsensus::default().group(&bare, &Execution::default())?;
        assert!(group.ok == Some(true) && group.mask[..40].iter().all(|&selected| selected));
        Ok(())
    }

    #[test]
    fn mirrored_points_are_no_motion() -> Result<()> {
        let rows: Vec<[f64; 3]> =
            (0..300).map(|i| [1.1, 2.3, 3.7].map(|f| 40.0 * (f64::from(i) * f).sin())).collect();
        let flat: Vec<[f64; 3]> = rows.iter().map(|&[x, y, z]| [x, y, 0.1 * z]).collect();
        let mirror: Vec<[f64; 3]> = flat.iter().map(|&[x, y, z]| [-x, y, z]).collect();
        let input = Correspondences::new(&flat, &mirror)?.with_resolution(1.0)?;
        let group = LikelihoodConsensus::default().group(&input, &Execution::default())?;
        assert!(group.size() > 100 && group.ok == Some(false));
        Ok(())
    }

    #[test]
    fn needs_no_length_but_a_mode() -> Result<()> {
        let without = Correspondences::new(&[[0.0; 3]; 4], &[[0.0; 3]; 4])?;
        assert_eq!(LikelihoodConsensus::default().group(&without, &Execution::default())?.size(), 0);
        let none = LikelihoodConsensus { modes: 0, ..LikelihoodConsensus::default() };
        assert!(none.group(&problem(9, 9)?, &Execution::default()).is_err());
        Ok(())
    }
}
