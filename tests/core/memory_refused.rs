//! No refused block of memory ends the process: every method returns an error, or its undisturbed result.

use crate::common::{methods, problem};
use crate::refusing_allocator::refuse_each_block;
use cgroup::consensus::choice::Choice;
use cgroup::grouping::clipper::{self, Clipper};
use cgroup::grouping::consistency_voting::ConsistencyVoting;
use cgroup::grouping::game_theory::{Dynamics, GameTheory, Payoff};
use cgroup::grouping::geometric_consistency::{self as gc, GeometricConsistency, Ties};
use cgroup::grouping::hough_voting::{self as hough, HoughVoting};
use cgroup::grouping::likelihood_consensus::LikelihoodConsensus;
use cgroup::grouping::mac::MaximalCliques;
use cgroup::grouping::ransac::Ransac;
use cgroup::grouping::sc2pcr::Sc2Pcr;
use cgroup::grouping::search_of_inliers::{GlobalRank, SearchOfInliers};
use cgroup::grouping::similarity_score::SimilarityScore;
use cgroup::grouping::spectral::{Affinity, Diagonal, Spectral};
use cgroup::grouping::teaser::{Prune, Scale, Teaser};
use cgroup::grouping::turboreg::TurboReg;
use cgroup::grouping::{BoxedMethod, GroupingMethod};
use cgroup::selection::eigenvector::Eigensolver;
use cgroup::selection::otsu::{OtsuMode, Threshold};
use cgroup::{Correspondences, Execution, Points, Result};

/// Correspondences of a problem; enough for the matrices of pairs to be stored rounded.
const N: usize = 1_100;

/// Matrices of pairs that need more are recomputed, and graphs that need more have fewer vertices.
const LITTLE_MEMORY: usize = 30_000;

fn input(n: usize) -> Result<Correspondences> {
    problem(7, n, 0.2, 0.5).correspondences()
}

/// Two candidates for each correspondence, the first of them its own match.
fn with_candidates(n: usize) -> Result<Correspondences> {
    let drawn = problem(7, n, 0.2, 0.5);
    let beside = nalgebra::Vector3::new(1.0, -2.0, 0.5);
    let candidates: Vec<[f64; 3]> =
        drawn.target.iter().flat_map(|q| [(*q).into(), (q + beside).into()]).collect();
    drawn.correspondences()?.with_candidates(Points::from_rows("candidates", &candidates)?)
}

/// The same correspondences with positions only.
fn by_position(n: usize) -> Result<Correspondences> {
    let drawn = input(n)?;
    let (source, target) = drawn.positions("lc")?;
    Correspondences::between(source.clone(), target.clone())?.with_resolution(1.0)
}

fn refuse(
    name: &str,
    method: &(impl GroupingMethod + Sync + ?Sized),
    input: &Correspondences,
    max_memory: usize,
) -> Result<()> {
    let group = || method.group(input, &Execution::new(max_memory));
    let blocks = refuse_each_block(name, 1, group)?;
    assert!(blocks > 0, "{name} asked for no block: the test is void");
    Ok(())
}

#[test]
fn methods_with_their_defaults() -> Result<()> {
    let input = input(N)?;
    for (name, method) in methods() {
        refuse(name, method.as_ref(), &input, usize::MAX)?;
    }
    Ok(())
}

#[test]
fn methods_on_two_threads() -> Result<()> {
    let input = input(N)?;
    for (name, method) in methods() {
        refuse_each_block(name, 2, || method.group(&input, &Execution::new(usize::MAX)))?;
    }
    Ok(())
}

#[test]
fn methods_with_little_memory() -> Result<()> {
    let input = input(N)?;
    for (name, method) in methods() {
        if ["lc", "clipper", "teaser"].contains(&name) {
            continue; // they reject so low a memory bound
        }
        refuse(&format!("{name} in little memory"), method.as_ref(), &input, LITTLE_MEMORY)?;
    }
    Ok(())
}

/// The paper's methods with options that use other code paths.
fn variants() -> Vec<(&'static str, BoxedMethod)> {
    let similarity = |otsu| SimilarityScore { otsu, ..SimilarityScore::default() };
    vec![
        ("ss, exact", Box::new(similarity(OtsuMode::Exact))),
        ("ss, covis", Box::new(similarity(OtsuMode::Covis))),
        ("ss, many bins", Box::new(SimilarityScore { bins: 9_000, ..similarity(OtsuMode::Legacy) })),
        (
            "ss, fixed",
            Box::new(SimilarityScore { threshold: Threshold::Fixed(0.5), ..SimilarityScore::default() }),
        ),
        (
            "si, local score",
            Box::new(SearchOfInliers { global_rank: GlobalRank::LocalScore, ..SearchOfInliers::default() }),
        ),
        ("cv, exact", Box::new(ConsistencyVoting { otsu: OtsuMode::Exact, ..ConsistencyVoting::default() })),
        ("ransac, refined", Box::new(Ransac { iterations: 300, refine: true, ..Ransac::default() })),
        (
            "ransac, confidence",
            Box::new(Ransac { confidence: Some(0.99), edge_ratio: Some(0.9), ..Ransac::default() }),
        ),
        ("st, score", Box::new(Spectral { diagonal: Diagonal::Score, ..Spectral::default() })),
        (
            "st, binary",
            Box::new(Spectral { affinity: Affinity::Binary, diagonal: Diagonal::One, ..Spectral::default() }),
        ),
        (
            "gc, union",
            Box::new(GeometricConsistency { ties: Ties::Union, ..GeometricConsistency::default() }),
        ),
        ("3dhv, pcl", Box::new(pcl(false))),
        ("3dhv, interpolated", Box::new(pcl(true))),
        (
            "gtm, difference",
            Box::new(GameTheory { payoff: Payoff::DistanceDifference, ..GameTheory::default() }),
        ),
        (
            "gtm, infection",
            Box::new(GameTheory { dynamics: Dynamics::InfectionImmunisation, ..GameTheory::default() }),
        ),
    ]
}

fn pcl(interpolation: bool) -> HoughVoting {
    HoughVoting {
        variant: hough::Variant::Pcl,
        bin_size: Some(9.0),
        iterations: 300,
        interpolation,
        distance_weight: interpolation,
        ..HoughVoting::default()
    }
}

/// The other methods with such options.
fn modern_variants() -> Vec<(&'static str, BoxedMethod)> {
    vec![
        ("lc, instances", Box::new(LikelihoodConsensus { instances: 3, ..LikelihoodConsensus::default() })),
        (
            "mac, some hypotheses",
            Box::new(MaximalCliques {
                max_hypotheses: Some(100),
                refine: false,
                ..MaximalCliques::default()
            }),
        ),
        ("turboreg, mae", Box::new(TurboReg { choice: Choice::Mae, ..TurboReg::default() })),
        ("teaser, core", Box::new(Teaser { prune: Prune::Core, ..Teaser::default() })),
        (
            "teaser, scale",
            Box::new(Teaser { scale: Scale::Estimate, prune: Prune::Core, ..Teaser::default() }),
        ),
        ("clipper, maximum", Box::new(Clipper { variant: clipper::Variant::Maximum, ..Clipper::default() })),
    ]
}

#[test]
fn variants_of_the_papers_methods() -> Result<()> {
    let input = input(N)?;
    for (name, method) in variants() {
        refuse(name, method.as_ref(), &input, usize::MAX)?;
    }
    let clique = GeometricConsistency {
        variant: gc::Variant::Clique,
        iterations: 300,
        ..GeometricConsistency::default()
    };
    refuse("gc, clique", &clique, &input, usize::MAX)?;
    refuse("gc, clique in little memory", &clique, &input, LITTLE_MEMORY)
}

#[test]
fn variants_of_the_other_methods() -> Result<()> {
    let input = input(N)?;
    for (name, method) in modern_variants() {
        refuse(name, method.as_ref(), &input, usize::MAX)?;
    }
    refuse("lc, by position", &LikelihoodConsensus::default(), &by_position(N)?, usize::MAX)?;
    refuse("sc2pcr, candidates", &Sc2Pcr::default(), &with_candidates(N)?, usize::MAX)?;
    let clipper = Clipper::default();
    refuse("clipper, weights computed", &clipper, &input, 10 * N * N.div_ceil(64))
}

#[test]
fn st_with_its_slow_options() -> Result<()> {
    let input = input(400)?;
    let dense = Spectral { eigensolver: Eigensolver::Dense, ..Spectral::default() };
    refuse("st, dense", &dense, &input, usize::MAX)?;
    refuse("st, recompute", &Spectral { recompute: true, ..Spectral::default() }, &input, usize::MAX)
}
