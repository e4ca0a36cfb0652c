//! LC: the pose under which the correspondences are likeliest, beside chance.
//!
//! Likelihood consensus by position, a method of this library. With lengths in units of a third of the tolerance:
//!
//! 1. The level of a correspondence: `L_i = ln(s n / D_i) + clip(8 (0.87 - ratio_i), -0.8, 3)`, where `s = max(1 / 100, 10 / n)`
//!    is the share that is right where nothing is known, and `D_i` the greater of the sums over k of
//!    `max(0, 1 - d_ik^2 / 25)` around `p_i` and around `p'_i`: how many end there anyway.
//! 2. Correspondences are joined where `|ds - dt| < 3` and both lengths exceed 6, and from each of the 1,000 pairs with
//!    the most common neighbours grows a clique of up to 12 members, whose least-squares motion is a hypothesis.
//!    Of more than 2,500 correspondences only those are joined for which `|ds - dt| < 3` holds with the most others,
//!    ties to the lower index: right ones are among them, be they few or many.
//! 3. The score of a pose: the sum of `max(0, L_i - r_i^2 / (2 2.7^2))` over residuals `r_i` below 6.
//! 4. The best pose is refined by weighted least squares, its supporters are taken out, and so on; then each is
//!    refined among all correspondences, with a deviation that falls from 1.6 times 2.7 to 2.7.
//! 5. The group: residuals of at most 5 under the best.
//!
//! Cost O(n^2) tests of pairs, and O(n) a hypothesis.

use super::GroupingMethod;
use crate::compatibility::agreement::DistanceAgreement;
use crate::compatibility::graph::AgreementGraph;
use crate::consensus::cliques::clique_poses;
use crate::consensus::likelihood::{Likelihood, levels};
use crate::consensus::modes::{Mode, find_modes};
use crate::error::at_least_one;
use crate::geometry::rigid::Rigid;
use crate::grouping_result::Alternative;
use crate::selection::top_k::largest;
use crate::{Correspondences, Execution, Grouping, Points, Result};

/// Lengths in units of the tolerance: standard deviation of a right match, residuals that count in the score, and in
/// the group, radius of the chance level, least length of an edge.
const DEVIATION: f64 = 0.9;
const REACH: f64 = 2.0;
const GROUP: f64 = 5.0 / 3.0;
const CHANCE: f64 = 5.0 / 3.0;
const SHORTEST: f64 = 2.0;

/// Pairs that cliques grow from.
const SEEDS: usize = 1_000;

/// Correspondences whose cliques are sought.
const MOST_VERTICES: usize = 2_500;

/// Parameters of likelihood consensus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LikelihoodConsensus {
    /// Greatest distance difference of two that agree, a length; default 3 resolutions. All other lengths follow.
    pub tolerance: Option<f64>,
    /// Most poses that are returned, the best among them.
    pub modes: usize,
}

impl Default for LikelihoodConsensus {
    fn default() -> Self {
        Self { tolerance: None, modes: 40 }
    }
}

impl GroupingMethod for LikelihoodConsensus {
    fn group(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("lc")?;
        let tolerance = correspondences.length("tolerance", self.tolerance, 3.0)?;
        let most = at_least_one("modes", self.modes)?;
        let levels = levels(source, target, correspondences.optional_ratio(), CHANCE * tolerance, execution)?;
        let likelihood = Likelihood::new(source, target, &levels, DEVIATION * tolerance, REACH * tolerance);
        let vertices = vertices(source, target, tolerance, execution)?;
        let hypotheses = hypotheses(&vertices, source, target, tolerance, execution)?;
        let modes = find_modes(&likelihood, &hypotheses, most, source, tolerance, execution)?;
        let grouping = report(&modes, &likelihood, source, target, GROUP * tolerance);
        let grouping = grouping.with("hypotheses", hypotheses.len() as f64);
        Ok(grouping.with("vertices", vertices.len() as f64))
    }
}

/// Those that the graph is made of: all, or those that agree with the most others.
fn vertices(source: &Points, target: &Points, tolerance: f64, execution: &Execution) -> Result<Vec<usize>> {
    if source.len() <= MOST_VERTICES {
        return Ok((0..source.len()).collect());
    }
    let degrees = DistanceAgreement::new(source, target, tolerance).counts(execution)?;
    let degrees: Vec<f64> = degrees.into_iter().map(f64::from).collect();
    let mut vertices = largest(&degrees, MOST_VERTICES);
    vertices.sort_unstable();
    Ok(vertices)
}

/// The motions of cliques among the vertices, between the centred points.
fn hypotheses(
    vertices: &[usize],
    source: &Points,
    target: &Points,
    tolerance: f64,
    execution: &Execution,
) -> Result<Vec<Rigid>> {
    if vertices.len() == source.len() {
        let graph = AgreementGraph::new(source, target, tolerance, SHORTEST * tolerance, execution)?;
        return clique_poses(&graph, source, target, SEEDS, execution);
    }
    let (p, q) = (source.subset(vertices), target.subset(vertices));
    let graph = AgreementGraph::new(&p, &q, tolerance, SHORTEST * tolerance, execution)?;
    let poses = clique_poses(&graph, &p, &q, SEEDS, execution)?;
    Ok(poses.iter().map(|pose| pose.uncentered(&p, &q)).collect())
}

fn report(
    modes: &[Mode],
    likelihood: &Likelihood,
    source: &Points,
    target: &Points,
    within: f64,
) -> Grouping {
    let alternative = |mode: &Mode| Alternative {
        model: mode.pose.uncentered(source, target).to_matrix(),
        score: mode.support.score,
    };
    let alternatives = modes.iter().map(alternative).collect();
    let Some(best) = modes.first() else {
        let scores = Some(vec![0.0; source.len()]);
        return Grouping { scores, alternatives: Some(alternatives), ..Grouping::empty(source.len()) };
    };
    let limit = within * within;
    Grouping {
        mask: likelihood.squared_residuals(&best.pose).into_iter().map(|square| square <= limit).collect(),
        scores: Some(likelihood.posteriors(&best.pose)),
        model: Some(best.pose.uncentered(source, target).to_matrix()),
        alternatives: Some(alternatives),
        ..Grouping::default()
    }
    .with("score", best.support.score)
    .with("supporters", best.support.supporters as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `right` points moved rigidly, then others that go anywhere.
    fn problem(n: usize, right: usize) -> Result<Correspondences> {
        let place = |i: usize, k: f64| [1.1, 2.3, 3.7].map(|f| 100.0 * (i as f64 * f * k + k).sin());
        let source: Vec<[f64; 3]> = (0..n).map(|i| place(i, 1.0)).collect();
        let moved = |i: usize, p: &[f64; 3]| if i < right { [7.0 - p[1], p[0], p[2]] } else { place(i, 0.7) };
        let target: Vec<_> = source.iter().enumerate().map(|(i, p)| moved(i, p)).collect();
        Correspondences::new(&source, &target)?.with_resolution(1.0)
    }

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
    fn needs_a_length_and_a_mode() -> Result<()> {
        let without = Correspondences::new(&[[0.0; 3]; 4], &[[0.0; 3]; 4])?;
        assert!(LikelihoodConsensus::default().group(&without, &Execution::default()).is_err());
        let none = LikelihoodConsensus { modes: 0, ..LikelihoodConsensus::default() };
        assert!(none.group(&problem(9, 9)?, &Execution::default()).is_err());
        Ok(())
    }
}
