//! All grouping methods through one function: one arm per method, which reads its options.

use cgroup::consensus::choice::Choice;
use cgroup::geometry::rigid::fit_group;
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
use cgroup::memory;
use cgroup::selection::eigenvector::Eigensolver;
use numpy::PyArray2;
use numpy::ndarray::Ix2;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{self, Fields, PyParts, Reals};
use crate::error::InputError;
use crate::options::Options;
use crate::run::{RunOptions, run, run_inline};

/// Groups by the method of that public name; all its options are given.
#[pyfunction]
pub fn group<'py>(
    py: Python<'py>,
    method: &str,
    fields: Fields<'py>,
    run_options: RunOptions,
    options: &Bound<'py, PyDict>,
) -> PyResult<PyParts<'py>> {
    let mut options = Options::new(method, options);
    let method = method_of(method, &mut options)?;
    options.finish()?;
    let correspondences = fields.to_core()?;
    let result = if method.is_instant(&correspondences) {
        run_inline(py, |execution| method.group(&correspondences, execution))
    } else {
        run(py, &run_options, move |execution| method.group(&correspondences, execution))
    };
    convert::grouping(py, result?)
}

#[allow(clippy::too_many_lines, reason = "one arm per method, one line per option")]
fn method_of(name: &str, options: &mut Options<'_>) -> PyResult<BoxedMethod> {
    Ok(match name {
        "ss" => {
            let bins = options.count("bins", 1)?;
            Box::new(SimilarityScore { threshold: options.threshold_in_bins(bins)? })
        }
        "nnsr" => Box::new(NearestNeighborRatio { max_ratio: options.number("max_ratio")? }),
        "si" => Box::new(SearchOfInliers {
            tolerance: options.optional("tolerance")?,
            neighbors: options.count("neighbors", 1)?,
            min_distance_ratio: options.number("min_distance_ratio")?,
            lowe_ratio: options.number("lowe_ratio")?,
            global_rank: options.choice(
                "global_rank",
                &[("lowe", GlobalRank::Lowe), ("local_score", GlobalRank::LocalScore)],
            )?,
            threshold: options.threshold()?,
        }),
        "cv" => Box::new(ConsistencyVoting {
            distance_scale: options.optional("distance_scale")?,
            angle_scale: options.number("angle_scale")?,
            voters: options.count("voters", 1)?,
            exclude_self: options.flag("exclude_self")?,
            threshold: options.threshold()?,
        }),
        "ransac" => Box::new(Ransac {
            tolerance: options.optional("tolerance")?,
            iterations: options.count("iterations", 1)?,
            seed: options.seed("seed")?,
            refine: options.flag("refine")?,
            edge_ratio: options.optional("edge_ratio")?,
            confidence: options.optional("confidence")?,
        }),
        "st" => Box::new(Spectral {
            min_distance_ratio: options.number("min_distance_ratio")?,
            affinity: options.choice(
                "affinity",
                &[("raw", Affinity::Raw), ("threshold", Affinity::Threshold), ("binary", Affinity::Binary)],
            )?,
            diagonal: options.choice(
                "diagonal",
                &[("zero", Diagonal::Zero), ("one", Diagonal::One), ("score", Diagonal::Score)],
            )?,
            conflict: options.choice(
                "conflict",
                &[
                    ("rigidity", Conflict::Rigidity),
                    ("one_to_one", Conflict::OneToOne),
                    ("both", Conflict::Both),
                ],
            )?,
            eigensolver: options
                .choice("eigensolver", &[("power", Eigensolver::Power), ("dense", Eigensolver::Dense)])?,
            recompute: options.flag("recompute")?,
        }),
        "gc" => Box::new(GeometricConsistency {
            tolerance: options.optional("tolerance")?,
            variant: options
                .choice("variant", &[("star", gc::Variant::Star), ("clique", gc::Variant::Clique)])?,
            ties: options.choice("ties", &[("lowest", Ties::Lowest), ("union", Ties::Union)])?,
            min_cluster_size: options.count("min_cluster_size", 0)?,
            iterations: options.count("iterations", 1)?,
            seed: options.seed("seed")?,
        }),
        "3dhv" => Box::new(HoughVoting {
            variant: options.choice("variant", &[("grid", hv::Variant::Grid), ("pcl", hv::Variant::Pcl)])?,
            bins: options.count("bins", 1)?,
            bin_size: options.optional("bin_size")?,
            neighbors: neighborhood(options.count("neighbors", 0)?)?,
            interpolation: options.flag("interpolation")?,
            distance_weight: options.flag("distance_weight")?,
            vote_threshold: options.number("vote_threshold")?,
            iterations: options.count("iterations", 1)?,
            seed: options.seed("seed")?,
        }),
        "gtm" => Box::new(GameTheory {
            iterations: options.count("iterations", 1)?,
            threshold: options.threshold()?,
            payoff: options.choice(
                "payoff",
                &[
                    ("distance_ratio", Payoff::DistanceRatio),
                    ("distance_difference", Payoff::DistanceDifference),
                ],
            )?,
            tolerance: options.optional("tolerance")?,
            one_to_one: options.flag("one_to_one")?,
            convergence_tolerance: options.optional("convergence_tolerance")?,
            dynamics: options.choice(
                "dynamics",
                &[
                    ("replicator", Dynamics::Replicator),
                    ("infection_immunisation", Dynamics::InfectionImmunisation),
                ],
            )?,
        }),
        "lc" => Box::new(LikelihoodConsensus {
            tolerance: options.optional("tolerance")?,
            modes: options.count("modes", 1)?,
            instances: options.count("instances", 1)?,
        }),
        "mac" => Box::new(MaximalCliques {
            tolerance: options.optional("tolerance")?,
            max_distance_difference: options.optional("max_distance_difference")?,
            min_weight: options.number("min_weight")?,
            min_clique_size: options.count("min_clique_size", 3)?,
            max_cliques: options.count("max_cliques", 1)?,
            max_hypotheses: options.optional_count("max_hypotheses", 1)?,
            refine: options.flag("refine")?,
        }),
        "sc2pcr" => Box::new(Sc2Pcr {
            tolerance: options.optional("tolerance")?,
            max_distance_difference: options.optional("max_distance_difference")?,
            seed_ratio: options.number("seed_ratio")?,
            nms_radius: options.optional("nms_radius")?,
            k1: options.count("k1", 1)?,
            k2: options.count("k2", 1)?,
        }),
        "turboreg" => Box::new(TurboReg {
            tolerance: options.optional("tolerance")?,
            max_distance_difference: options.optional("max_distance_difference")?,
            nms_radius: options.optional("nms_radius")?,
            pivots: options.count("pivots", 1)?,
            cliques_per_pivot: options.count("cliques_per_pivot", 1)?,
            choice: options.choice(
                "choice",
                &[("inliers", Choice::Inliers), ("mae", Choice::Mae), ("mse", Choice::Mse)],
            )?,
        }),
        "teaser" => Box::new(Teaser {
            tolerance: options.optional("tolerance")?,
            max_distance_difference: options.optional("max_distance_difference")?,
            prune: options.choice("prune", &[("core", Prune::Core), ("clique", Prune::Clique)])?,
            freedom: freedom(options.count("dof", 0)?)?,
            scale: options.choice("scale", &[("known", Scale::Known), ("estimate", Scale::Estimate)])?,
            max_steps: options.count("max_steps", 0)?,
        }),
        "clipper" => Box::new(Clipper {
            max_distance_difference: options.optional("max_distance_difference")?,
            deviation: options.optional("deviation")?,
            min_distance: options.number("min_distance")?,
            variant: options.choice(
                "variant",
                &[("densest", clipper::Variant::Densest), ("maximum", clipper::Variant::Maximum)],
            )?,
            seed: options.seed("seed")?,
        }),
        _ => return Err(InputError::new_err(format!("method: got {name:?}, which the core does not have"))),
    })
}

fn freedom(degrees: usize) -> PyResult<Freedom> {
    match degrees {
        4 => Ok(Freedom::Four),
        6 => Ok(Freedom::Six),
        _ => Err(InputError::new_err(format!("dof: got {degrees}; choose 4 or 6"))),
    }
}

fn neighborhood(bins: usize) -> PyResult<Neighborhood> {
    match bins {
        0 => Ok(Neighborhood::None),
        6 => Ok(Neighborhood::Faces),
        26 => Ok(Neighborhood::All),
        _ => Err(InputError::new_err(format!("neighbors: got {bins}; choose 0, 6 or 26"))),
    }
}

/// Least-squares rigid transform (4,4) of all pairs of points.
#[pyfunction]
pub fn rigid_fit<'py>(
    py: Python<'py>,
    source: Reals<'py, Ix2>,
    target: Reals<'py, Ix2>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (source, target) = (source.points("source")?, target.points("target")?);
    let fit = run_inline(py, |_| {
        let all = memory::collect(0..source.len())?;
        fit_group(&source, &target, &all)
    });
    convert::matrix(py, &fit?.to_matrix())
}
