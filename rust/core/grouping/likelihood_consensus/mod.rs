//! LC: the pose of greatest likelihood ratio of the correspondences versus chance.
//!
//! Likelihood consensus, a method of this library. With lengths in units u of a third of the tolerance:
//!
//! 1. The level of a correspondence: `L_i = ln(s n / D_i) + clip(8 (0.87 - ratio_i), -0.8, 3)`, where
//!    `s = max(1 / 100, 10 / n)` is the prior share of correct correspondences, and `D_i` the greater of the
//!    sums over k of `max(0, 1 - d_ik^2 / 25)` around `p_i` and around `p'_i`: the number that end there by
//!    chance.
//! 2. Correspondences are connected if `|ds - dt| < 3` and both lengths exceed 6. From each of the 1,000
//!    pairs with the most common neighbours grows a clique of up to 12 members, whose least-squares motion is
//!    a hypothesis. Of more than 2,500 correspondences only those with the most agreements `|ds - dt| < 3`
//!    are connected, ties to the lower index: correct ones are among them, whether few or many.
//! 3. The support of a pose: the sum of `max(0, L_i - r_i^2 / (2 2.7^2))` over residuals `r_i` below 6.
//! 4. The best pose is refined by weighted least squares, its supporters are removed, and so on; then each
//!    pose is refined among all correspondences, with a deviation that falls from 1.6 times 2.7 to 2.7.
//! 5. Frames, if any: the poses found so far decide whether they are used (`frames.rs`). If so, stars of
//!    frames also propose poses, each term is increased by the evidence of its frames and divided by the
//!    number of matches that are wrong together (`frames.rs`), and step 4 is repeated.
//! 6. The score of a pose is its support times the share of source points that it moves to within 5 of any
//!    target; the best wins.
//! 7. The group: residuals of at most 5 under it.
//! 8. The number of false alarms, and further instances (`confidence.rs`).
//!
//! If no tolerance is given, several are tried (`attempts.rs`, `comparison.rs`), and the residuals refine the
//! pose and determine the radius of the group (`noise.rs`, `width.rs`).
//! If the scale is unknown, this is done at the likeliest scales (`scale.rs`).
//!
//! Cost O(n^2) tests of pairs, and O(n) per hypothesis.

mod attempts;
mod comparison;
mod confidence;
mod frames;
mod noise;
mod precision;
mod reflections;
mod scale;
mod width;

use nalgebra::{Matrix3, Vector3};

pub(crate) use noise::likely_tolerance;
pub use scale::Scale;

use super::GroupingMethod;
use crate::compatibility::agreement::DistanceAgreement;
use crate::compatibility::graph::AgreementGraph;
use crate::consensus::choice::poses_among;
use crate::consensus::cliques::clique_poses;
use crate::consensus::landing::{Landing, landings};
use crate::consensus::likelihood::Likelihood;
use crate::consensus::likelihood::levels::levels;
use crate::consensus::modes::{Mode, find_modes};
use crate::geometry::rigid::Rigid;
use crate::grouping_result::{Alternative, mask_of};
use crate::options::method;
use crate::selection::top_k::largest;
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};

/// Lengths in units of the tolerance: standard deviation of a correct match, bound of residuals in the score
/// and in the group, radius of the chance level, least length of an edge.
const DEVIATION: f64 = 0.9;
const REACH: f64 = 2.0;
const GROUP: f64 = 5.0 / 3.0;
const CHANCE: f64 = 5.0 / 3.0;
const SHORTEST: f64 = 2.0;

/// Number of pairs that cliques grow from.
const SEEDS: usize = 1_000;

/// Most correspondences in the search for cliques.
const MOST_VERTICES: usize = 2_500;

method! {
    /// Parameters of likelihood consensus.
    pub struct LikelihoodConsensus = "lc", ["source", "target"],
        optional ["ratio", "source_lrf", "target_lrf", "resolution"], {
        /// Greatest distance difference of agreeing correspondences, a length; default `3 * resolution`, or
        /// without a resolution 0.8 times the distance of neighbouring points. If that leaves a doubt, other
        /// powers of 2 times that are tried, and the residuals determine the radius of the group and refine
        /// the pose. For dense matches of clouds downsampled to voxels of side v, give `1.2 * v`.
        pub tolerance: Option<f64> = None;
        /// Most poses in `Grouping.alternatives`, the best among them.
        pub modes: usize = 40;
        /// Most groups in `Grouping.instances`, which is None for 1. The groups follow different rigid
        /// motions, each is significant among the matches left by better ones, and any two have an
        /// intersection over union below 0.3. Row 0 is the mask; there are no rows if the best is not
        /// `Grouping.ok`.
        pub instances: usize = 1;
        /// Estimate the scale: the length of the source's unit in the target's unit. True tries scales at
        /// which both sides have about the same size, to a factor of 3; two bounds only narrow that. All
        /// lengths (`resolution`, `tolerance`, `Grouping.noise`) are in the target's unit.
        pub scale: Scale = Scale::default();
    }
}

/// Matched points and parameters of all steps.
#[derive(Clone, Copy)]
struct Problem<'a> {
    source: &'a Points,
    target: &'a Points,
    tolerance: f64,
    modes: usize,
    execution: &'a Execution,
}

/// A mode, its landing, and its score.
#[derive(Debug, Clone, Copy)]
struct Ranked {
    mode: Mode,
    landing: Landing,
    score: f64,
}

/// The poses supported by the matches, with frames or without.
struct Answer {
    likelihood: Likelihood,
    /// The modes, the best first.
    ranked: Vec<Ranked>,
    /// Whether frames are used.
    by_frames: bool,
}

impl GroupingMethod for LikelihoodConsensus {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        match self.scale {
            Scale::Known => self.run_known(correspondences, execution),
            Scale::Between(low, high) => self.run_scaled(correspondences, (low, high), execution),
        }
    }
}

impl Problem<'_> {
    /// The likelihood of poses, by position alone.
    fn likelihood(&self, ratios: Option<&[f64]>) -> Result<Likelihood> {
        let Problem { source, target, tolerance, execution, .. } = *self;
        let levels = levels(source, target, ratios, CHANCE * tolerance, execution)?;
        Likelihood::new(source, target, &levels, DEVIATION * tolerance, REACH * tolerance)
    }

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

    /// Number of directions in which the group's source points spread by more than twice the allowed noise: 3
    /// for a body, 2 for a plane, 1 for a line.
    fn dimensions(&self, mask: &[bool]) -> Result<usize> {
        let rows = memory::collect((0..mask.len()).filter(|&i| mask[i]))?;
        let least = (2.0 * DEVIATION * self.tolerance).powi(2);
        Ok(self.variances(&rows).iter().filter(|&&variance| variance > least).count())
    }

    /// Variances of some source points along their principal axes, the greatest first.
    fn variances(&self, rows: &[usize]) -> [f64; 3] {
        let source = self.source;
        let count = rows.len().max(1) as f64;
        let mean = rows.iter().map(|&i| source.get(i).coords).sum::<Vector3<f64>>() / count;
        let scatter = |&i: &usize| {
            let offset = source.get(i).coords - mean;
            offset * offset.transpose()
        };
        let covariance = rows.iter().map(scatter).sum::<Matrix3<f64>>() / count;
        let mut variances: [f64; 3] = covariance.symmetric_eigenvalues().into();
        variances.sort_unstable_by(|a, b| b.total_cmp(a));
        variances
    }

    /// Greatest residual in a group.
    fn group_radius(&self) -> f64 {
        GROUP * self.tolerance
    }

    /// The rows with residuals of the group.
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

/// The graph of correspondences that agree in distance, and their rows.
struct Joined {
    vertices: Vec<usize>,
    graph: AgreementGraph,
}

impl Problem<'_> {
    /// Connects all correspondences, or at most `most` of those with the most agreements.
    fn join(&self, most: usize) -> Result<Joined> {
        let Problem { source, target, tolerance, execution, .. } = *self;
        let shortest = SHORTEST * tolerance;
        if source.len() <= most {
            let graph = AgreementGraph::new(source, target, tolerance, shortest, execution)?;
            return Ok(Joined { vertices: memory::collect(0..source.len())?, graph });
        }
        let vertices = DistanceAgreement::new(source, target, tolerance)?.most_agreeing(most, execution)?;
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
    fn too_many_matches_for_the_graph_are_reduced_and_reported() -> Result<()> {
        let group = LikelihoodConsensus::default().group(&problem(3_000, 100)?, &Execution::default())?;
        assert!(group.mask[..100].iter().all(|&selected| selected));
        assert_eq!(group.diagnostics.get("vertices"), Some(&2_500.0));
        Ok(())
    }

    #[test]
    fn many_inliers_are_significant_and_none_are_not() -> Result<()> {
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
    fn no_resolution_or_a_wrong_one_finds_the_same_group_and_noise() -> Result<()> {
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
    fn mirrored_points_give_no_motion() -> Result<()> {
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
    fn needs_no_length_but_one_mode() -> Result<()> {
        let without = Correspondences::new(&[[0.0; 3]; 4], &[[0.0; 3]; 4])?;
        assert_eq!(LikelihoodConsensus::default().group(&without, &Execution::default())?.size(), 0);
        let none = LikelihoodConsensus { modes: 0, ..LikelihoodConsensus::default() };
        assert!(none.group(&problem(9, 9)?, &Execution::default()).is_err());
        Ok(())
    }
}
