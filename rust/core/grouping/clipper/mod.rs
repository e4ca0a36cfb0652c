//! CLIPPER: the densest set of mutually agreeing correspondences, by projected gradient ascent.
//!
//! Lusk, Fathian, How, *CLIPPER: A graph-theoretic framework for robust data association*, ICRA 2021; with a
//! certificate after Fathian, Summers, *CLIPPER+*, RA-L 2024. With `delta = |ds - dt|`:
//!
//! 1. Affinity `M_ij = exp(-delta^2 / (2 sigma^2))` if `delta < epsilon`, both lengths exceed a minimum, and
//!    the value is above 1e-4; else 0. `M_ii = 1`. Two correspondences with `M_ij = 0` exclude each other.
//! 2. Maximize `u' M u` with `u >= 0`, `|u| = 1`, and `u_i u_j = 0` for two that exclude each other: ascent
//!    on `u' (M - d Z) u`, Z the indicator of exclusion, with a penalty d that grows until none of them
//!    remain.
//! 3. The group: the `round(u' M u)` correspondences of the greatest `u_i`.
//! 4. The certificate: the group is a clique, and its size equals the greatest core number plus one or the
//!    number of colours, so no clique is larger.
//!
//! CLIPPER+ maximizes the size of the clique: M is 1 wherever it is not 0; a greedy clique is computed first,
//! and the ascent is restricted to vertices that may be in a larger one. Cost O(n^2) tests of pairs, and
//! O(agreeing pairs) per step.

mod affinity;
mod ascent;
mod dense;

use super::GroupingMethod;
use crate::compatibility::graph::AgreementGraph;
use crate::consensus::coloring::count_colors;
use crate::consensus::cores::Cores;
use crate::consensus::counter_rng::random_words;
use crate::consensus::maximum_clique::greedy_clique;
use crate::error::{Error, Result, positive};
use crate::geometry::rigid::fit_group;
use crate::grouping_result::mask_of;
use crate::options::{self, Value, method, number, words};
use crate::rule::{Agreement, Kind, Rule};
use crate::selection::top_k::largest;
use crate::{Correspondences, Execution, Grouping, Points, memory};
use affinity::Affinity;
use ascent::{Ascent, ascend};

/// Affinities up to this count as none.
const LEAST_AFFINITY: f64 = 1e-4;

/// Greatest random part of an initial vector of ones.
const CHANCE: f64 = 0.01;

/// A length of at least 0.
const NOT_NEGATIVE: options::Kind = number(0.0, f64::MAX, "give a finite length of at least 0");

words! {
    /// Objective of the search.
    pub enum Variant {
        /// The set with the greatest sum of affinities per member (CLIPPER).
        Densest = Value::Word("densest"),
        /// The set with the most members (CLIPPER+).
        Maximum = Value::Word("maximum"),
    }
}

method! {
    /// Parameters of CLIPPER.
    pub struct Clipper = "clipper", ["source", "target"], optional ["resolution"], {
        /// Bound on `|ds - dt|` of agreeing correspondences (epsilon), a length; default `5 * resolution`.
        pub max_distance_difference: Option<f64> = None;
        /// Standard deviation of `ds - dt` (sigma), a length; default `max_distance_difference / 3`.
        pub deviation: Option<f64> = None;
        /// Correspondences at most this length apart on either side exclude each other.
        pub min_distance: f64 = 0.0, NOT_NEGATIVE;
        /// Find the set with the greatest sum of affinities per member (CLIPPER), or the one with the most
        /// members (CLIPPER+: all affinities are 1, and a greedy clique is computed first).
        pub variant: Variant = Variant::default();
        /// Seed of the random numbers at which the ascent starts; each number depends on the seed and its row
        /// alone.
        pub seed: u64 = 0;
    }
}

impl GroupingMethod for Clipper {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("clipper")?;
        let bound = correspondences.length("max_distance_difference", self.max_distance_difference, 5.0)?;
        let deviation = positive("deviation", self.deviation.unwrap_or(bound / 3.0))?;
        // Distance difference at which the affinity falls to the least one.
        let reach = bound.min(deviation * (-2.0 * LEAST_AFFINITY.ln()).sqrt());
        let graph = AgreementGraph::new(source, target, reach, self.min_distance, execution)?;
        let cores = Cores::of(&graph, execution)?;
        let found = match self.variant {
            Variant::Densest => densest(&graph, source, target, deviation, self.seed, execution)?,
            Variant::Maximum => maximum(&graph, &cores, self.seed, execution)?,
        };
        let certified = is_largest(&found.members, &graph, &cores, execution)?;
        let agreement = Agreement { least_each: Some(self.min_distance), ..Agreement::difference(reach) };
        Ok(report(found, certified, source, target)?.by(Rule::new(Kind::Greatest).agreeing(agreement)))
    }
}

/// Result of a search.
struct Found {
    members: Vec<usize>,
    scores: Vec<f64>,
    objective: f64,
    rounds: usize,
    complete: bool,
}

/// The densest clique.
fn densest(
    graph: &AgreementGraph,
    source: &Points,
    target: &Points,
    deviation: f64,
    seed: u64,
    execution: &Execution,
) -> Result<Found> {
    let affinity = Affinity::weighted(graph, source, target, deviation, execution)?;
    let start = memory::collect((0..graph.len()).map(|i| random(seed, i)))?;
    // After one power step random starts hardly differ.
    let all = memory::collect(0..graph.len())?;
    let start = memory::collect(affinity.terms(&start, &all, execution)?.iter().map(|terms| terms[0]))?;
    let Ascent { u, objective, rounds, complete } = ascend(&affinity, start, execution)?;
    let members = largest(&u, objective.round() as usize)?;
    Ok(Found { members, scores: u, objective, rounds, complete })
}

/// Pseudo-random number in 0..1 for a row.
fn random(seed: u64, i: usize) -> f64 {
    (random_words(seed, i as u64)[0] >> 11) as f64 / (1_u64 << 53) as f64
}

/// The largest clique: the greedy one, or that of the ascent over vertices that may be in a larger one.
fn maximum(graph: &AgreementGraph, cores: &Cores, seed: u64, execution: &Execution) -> Result<Found> {
    let greedy = greedy_clique(graph, &cores.from_last(0)?)?;
    let kept = cores.from_last(greedy.len() as u32)?;
    let mut found = of_clique(graph.len(), memory::collect(greedy.iter().map(|&i| i as usize))?)?;
    if kept.is_empty() {
        return Ok(found);
    }
    let inner = graph.induced(&kept, execution)?;
    // Starts away from the greedy clique; a random part breaks the tie of equivalent correspondences that
    // exclude each other.
    let entry = |(k, i): (usize, &u32)| f64::from(!greedy.contains(i)) + CHANCE * random(seed, k);
    let start = memory::collect((0..).zip(&kept).map(entry))?;
    let Ascent { u, objective, rounds, complete } = ascend(&Affinity::binary(&inner), start, execution)?;
    let members = largest(&u, objective.round() as usize)?;
    if is_clique(&members, &inner) && members.len() > found.members.len() {
        found = of_clique(graph.len(), memory::collect(members.iter().map(|&k| kept[k] as usize))?)?;
    }
    Ok(Found { rounds, complete, ..found })
}

/// A clique, with equal entries of u for its members.
fn of_clique(n: usize, members: Vec<usize>) -> Result<Found> {
    let share = 1.0 / (members.len().max(1) as f64).sqrt();
    let mut scores = memory::filled(0.0, n)?;
    members.iter().for_each(|&member| scores[member] = share);
    Ok(Found { objective: members.len() as f64, members, scores, rounds: 0, complete: true })
}

fn is_clique(members: &[usize], graph: &AgreementGraph) -> bool {
    let joined_before = |k: usize| members[..k].iter().all(|&i| graph.joined(i, members[k]));
    (0..members.len()).all(joined_before)
}

/// Whether the members are a clique that is certified to be a largest one (CLIPPER+, section IV).
fn is_largest(
    members: &[usize],
    graph: &AgreementGraph,
    cores: &Cores,
    execution: &Execution,
) -> Result<bool> {
    if members.is_empty() || !is_clique(members, graph) {
        return Ok(false);
    }
    if members.len() == cores.greatest() as usize + 1 {
        return Ok(true);
    }
    // Any larger clique is among these.
    let kept = graph.induced(&cores.from_last(members.len() as u32)?, execution)?;
    Ok(count_colors(&kept, execution)? as usize <= members.len())
}

fn report(found: Found, certified: bool, source: &Points, target: &Points) -> Result<Grouping> {
    let n = source.len();
    let mut members = found.members;
    members.sort_unstable();
    // Fewer than three, or collinear ones, are not a group.
    let pose = match fit_group(source, target, &members) {
        Ok(pose) => Some(pose),
        Err(Error::NoConsensus { .. }) => None,
        Err(error) => return Err(error),
    };
    let mask = mask_of(n, if pose.is_some() { members } else { Vec::new() })?;
    let model = pose.map(|pose| pose.to_matrix());
    let grouping = Grouping { mask, scores: Some(found.scores), model, ..Grouping::default() }
        .with("objective", found.objective)
        .with("rounds", found.rounds as f64)
        .with("certified", f64::from(certified));
    Ok(if found.complete { grouping } else { grouping.with("truncated", 1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grouping::test_problem::problem;

    #[test]
    fn finds_and_certifies_the_moved_points() -> Result<()> {
        for variant in [Variant::Densest, Variant::Maximum] {
            let method = Clipper { variant, max_distance_difference: Some(1.0), ..Clipper::default() };
            let group = method.group(&problem(300, 60)?, &Execution::default())?;
            let expected: Vec<usize> = (0..60).collect();
            let selected: Vec<usize> = (0..300).filter(|&i| group.mask[i]).collect();
            assert_eq!(selected, expected, "{variant:?}");
            assert_eq!(group.diagnostics.get("certified"), Some(&1.0), "{variant:?}");
            let model = group.model.unwrap_or_default();
            assert!((model[(0, 1)] + 1.0).abs() < 1e-9 && (model[(0, 3)] - 7.0).abs() < 1e-9, "{model}");
        }
        Ok(())
    }

    #[test]
    fn too_few_or_coincident_points_give_no_group() -> Result<()> {
        for variant in [Variant::Densest, Variant::Maximum] {
            let method = Clipper { variant, ..Clipper::default() };
            for n in 0..3 {
                let group = method.group(&problem(n, n)?, &Execution::default())?;
                assert_eq!((group.size(), group.model), (0, None));
            }
            let rows = [[1.0; 3]; 50];
            let input = Correspondences::new(&rows, &rows)?.with_resolution(1.0)?;
            assert_eq!(method.group(&input, &Execution::default())?.size(), 0);
        }
        Ok(())
    }

    #[test]
    fn options_are_checked() -> Result<()> {
        for min_distance in [-1.0, f64::NAN, f64::INFINITY] {
            let method = Clipper { min_distance, ..Clipper::default() };
            assert!(method.group(&problem(9, 9)?, &Execution::default()).is_err());
        }
        let method = Clipper { deviation: Some(0.0), ..Clipper::default() };
        assert!(method.group(&problem(9, 9)?, &Execution::default()).is_err());
        Ok(())
    }
}
