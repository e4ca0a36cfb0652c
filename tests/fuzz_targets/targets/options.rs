//! Methods with any options.

use arbitrary::{Result, Unstructured};
use cgroup::consensus::choice::Choice;
use cgroup::grouping::BoxedMethod;
use cgroup::grouping::clipper::{self, Clipper};
use cgroup::grouping::consistency_voting::ConsistencyVoting;
use cgroup::grouping::game_theory::{Dynamics, GameTheory, Payoff};
use cgroup::grouping::geometric_consistency::{self as gc, GeometricConsistency, Ties};
use cgroup::grouping::hough_voting::{self as hv, HoughVoting, Neighborhood};
use cgroup::grouping::likelihood_consensus::LikelihoodConsensus;
use cgroup::grouping::mac::MaximalCliques;
use cgroup::grouping::nearest_neighbor_ratio::NearestNeighborRatio;
use cgroup::grouping::ransac::Ransac;
use cgroup::grouping::sc2pcr::Sc2Pcr;
use cgroup::grouping::search_of_inliers::{GlobalRank, SearchOfInliers};
use cgroup::grouping::similarity_score::SimilarityScore;
use cgroup::grouping::spectral::{Affinity, Conflict, Diagonal, Spectral};
use cgroup::grouping::teaser::{Freedom, Prune, Scale, Teaser};
use cgroup::grouping::turboreg::TurboReg;
use cgroup::selection::eigenvector::Eigensolver;
use cgroup::selection::otsu::{OtsuMode, Threshold};

use super::draw::{count, length, maybe, number};

/// Rounds that stay fast.
const ROUNDS: usize = 100;

pub fn paper_method(u: &mut Unstructured) -> Result<(&'static str, BoxedMethod)> {
    Ok(match u.int_in_range(0..=8)? {
        0 => ("ss", Box::new(SimilarityScore { threshold: threshold(u)? })),
        1 => ("nnsr", Box::new(NearestNeighborRatio { max_ratio: number(u)? })),
        2 => ("si", Box::new(search_of_inliers(u)?)),
        3 => ("cv", Box::new(consistency_voting(u)?)),
        4 => ("ransac", Box::new(ransac(u)?)),
        5 => ("st", Box::new(spectral(u)?)),
        6 => ("gc", Box::new(geometric_consistency(u)?)),
        7 => ("3dhv", Box::new(hough_voting(u)?)),
        _ => ("gtm", Box::new(game_theory(u)?)),
    })
}

pub fn modern_method(u: &mut Unstructured) -> Result<(&'static str, BoxedMethod)> {
    Ok(match u.int_in_range(0..=5)? {
        0 => ("lc", Box::new(likelihood_consensus(u)?)),
        1 => ("mac", Box::new(maximal_cliques(u)?)),
        2 => ("sc2pcr", Box::new(sc2pcr(u)?)),
        3 => ("turboreg", Box::new(turboreg(u)?)),
        4 => ("teaser", Box::new(teaser(u)?)),
        _ => ("clipper", Box::new(clipper(u)?)),
    })
}

fn threshold(u: &mut Unstructured) -> Result<Threshold> {
    let bins = u.int_in_range(0..=512)?;
    Ok(match u.int_in_range(0..=4)? {
        0 => Threshold::Otsu(OtsuMode::MinMax { bins }),
        1 => Threshold::Otsu(OtsuMode::Exact),
        2 => Threshold::Otsu(OtsuMode::Covis),
        3 => Threshold::Otsu(OtsuMode::Legacy { bins }),
        _ => Threshold::Fixed(number(u)?),
    })
}

fn search_of_inliers(u: &mut Unstructured) -> Result<SearchOfInliers> {
    Ok(SearchOfInliers {
        tolerance: maybe(u, length)?,
        neighbors: count(u, 64)?,
        min_distance_ratio: number(u)?,
        lowe_ratio: number(u)?,
        global_rank: *u.choose(&[GlobalRank::Lowe, GlobalRank::LocalScore])?,
        threshold: threshold(u)?,
    })
}

fn consistency_voting(u: &mut Unstructured) -> Result<ConsistencyVoting> {
    Ok(ConsistencyVoting {
        distance_scale: maybe(u, length)?,
        angle_scale: number(u)?,
        voters: count(u, 200)?,
        exclude_self: u.arbitrary()?,
        threshold: threshold(u)?,
    })
}

fn ransac(u: &mut Unstructured) -> Result<Ransac> {
    Ok(Ransac {
        tolerance: maybe(u, length)?,
        iterations: u.int_in_range(0..=ROUNDS)?,
        seed: u.arbitrary()?,
        refine: u.arbitrary()?,
        edge_ratio: maybe(u, number)?,
        confidence: maybe(u, number)?,
    })
}

fn spectral(u: &mut Unstructured) -> Result<Spectral> {
    Ok(Spectral {
        min_distance_ratio: number(u)?,
        affinity: *u.choose(&[Affinity::Raw, Affinity::Threshold, Affinity::Binary])?,
        diagonal: *u.choose(&[Diagonal::Zero, Diagonal::One, Diagonal::Score])?,
        conflict: *u.choose(&[Conflict::Rigidity, Conflict::OneToOne, Conflict::Both])?,
        eigensolver: *u.choose(&[Eigensolver::Power, Eigensolver::Dense])?,
        recompute: u.arbitrary()?,
    })
}

fn geometric_consistency(u: &mut Unstructured) -> Result<GeometricConsistency> {
    Ok(GeometricConsistency {
        tolerance: maybe(u, length)?,
        variant: *u.choose(&[gc::Variant::Star, gc::Variant::Clique])?,
        ties: *u.choose(&[Ties::Lowest, Ties::Union])?,
        min_cluster_size: count(u, 10)?,
        iterations: u.int_in_range(0..=ROUNDS)?,
        seed: u.arbitrary()?,
    })
}

fn hough_voting(u: &mut Unstructured) -> Result<HoughVoting> {
    Ok(HoughVoting {
        variant: *u.choose(&[hv::Variant::Grid, hv::Variant::Pcl])?,
        bins: count(u, 40)?,
        bin_size: maybe(u, length)?,
        neighbors: *u.choose(&[Neighborhood::None, Neighborhood::Faces, Neighborhood::All])?,
        interpolation: u.arbitrary()?,
        distance_weight: u.arbitrary()?,
        vote_threshold: number(u)?,
        iterations: u.int_in_range(0..=ROUNDS)?,
        seed: u.arbitrary()?,
    })
}

fn game_theory(u: &mut Unstructured) -> Result<GameTheory> {
    Ok(GameTheory {
        iterations: u.int_in_range(0..=ROUNDS)?,
        threshold: threshold(u)?,
        payoff: *u.choose(&[Payoff::DistanceRatio, Payoff::DistanceDifference])?,
        tolerance: maybe(u, length)?,
        one_to_one: u.arbitrary()?,
        convergence_tolerance: maybe(u, number)?,
        dynamics: *u.choose(&[Dynamics::Replicator, Dynamics::InfectionImmunisation])?,
    })
}

fn likelihood_consensus(u: &mut Unstructured) -> Result<LikelihoodConsensus> {
    Ok(LikelihoodConsensus { tolerance: maybe(u, length)?, modes: count(u, 64)?, instances: count(u, 5)? })
}

fn maximal_cliques(u: &mut Unstructured) -> Result<MaximalCliques> {
    Ok(MaximalCliques {
        tolerance: maybe(u, length)?,
        max_distance_difference: maybe(u, length)?,
        min_weight: number(u)?,
        min_clique_size: count(u, 8)?,
        max_cliques: u.int_in_range(0..=2000)?,
        max_hypotheses: maybe(u, |u| count(u, 100))?,
        refine: u.arbitrary()?,
    })
}

fn sc2pcr(u: &mut Unstructured) -> Result<Sc2Pcr> {
    Ok(Sc2Pcr {
        tolerance: maybe(u, length)?,
        max_distance_difference: maybe(u, length)?,
        seed_ratio: number(u)?,
        nms_radius: maybe(u, length)?,
        k1: count(u, 40)?,
        k2: count(u, 40)?,
    })
}

fn turboreg(u: &mut Unstructured) -> Result<TurboReg> {
    Ok(TurboReg {
        tolerance: maybe(u, length)?,
        max_distance_difference: maybe(u, length)?,
        nms_radius: maybe(u, length)?,
        pivots: count(u, 200)?,
        cliques_per_pivot: count(u, 5)?,
        choice: *u.choose(&[Choice::Inliers, Choice::Mae, Choice::Mse])?,
    })
}

fn teaser(u: &mut Unstructured) -> Result<Teaser> {
    Ok(Teaser {
        tolerance: maybe(u, length)?,
        max_distance_difference: maybe(u, length)?,
        prune: *u.choose(&[Prune::Clique, Prune::Core])?,
        freedom: *u.choose(&[Freedom::Six, Freedom::Four])?,
        scale: *u.choose(&[Scale::Known, Scale::Estimate])?,
        max_steps: u.int_in_range(0..=ROUNDS * 100)?,
    })
}

fn clipper(u: &mut Unstructured) -> Result<Clipper> {
    Ok(Clipper {
        max_distance_difference: maybe(u, length)?,
        deviation: maybe(u, length)?,
        min_distance: number(u)?,
        variant: *u.choose(&[clipper::Variant::Densest, clipper::Variant::Maximum])?,
        seed: u.arbitrary()?,
    })
}
