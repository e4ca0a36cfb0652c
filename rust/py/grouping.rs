//! One function per grouping method.

use cgroup::geometry::rigid::fit_group;
use cgroup::grouping::consistency_voting::ConsistencyVoting;
use cgroup::grouping::game_theory::{Dynamics, GameTheory, Payoff};
use cgroup::grouping::geometric_consistency::{self, GeometricConsistency, Ties};
use cgroup::grouping::hough_voting::{self, HoughVoting, Neighborhood};
use cgroup::grouping::nearest_neighbor_ratio::NearestNeighborRatio;
use cgroup::grouping::ransac::Ransac;
use cgroup::grouping::search_of_inliers::{GlobalRank, SearchOfInliers};
use cgroup::grouping::similarity_score::SimilarityScore;
use cgroup::grouping::spectral::{Affinity, Conflict, Diagonal, Spectral};
use cgroup::selection::eigenvector::Eigensolver;
use cgroup::selection::otsu::DEFAULT_BINS;
use cgroup::{Correspondences, GroupingMethod};
use numpy::PyArray2;
use numpy::ndarray::{Ix1, Ix2};
use pyo3::prelude::*;

use crate::convert::{self, Fields, PyGrouping, Reals, ThresholdOption, choose, threshold as to_threshold};
use crate::error::InputError;
use crate::run::{RunOptions, run, run_inline};

fn group<'py>(
    py: Python<'py>,
    fields: &Fields<'py>,
    options: &RunOptions,
    method: impl GroupingMethod + Send + 'static,
) -> PyResult<PyGrouping<'py>> {
    group_on_pool(py, fields.to_core()?, options, method)
}

fn group_on_pool<'py>(
    py: Python<'py>,
    correspondences: Correspondences,
    options: &RunOptions,
    method: impl GroupingMethod + Send + 'static,
) -> PyResult<PyGrouping<'py>> {
    let result = run(py, options, move |execution| method.group(&correspondences, execution))?;
    convert::grouping(py, result)
}

/// SS. Takes microseconds, so it runs on the calling thread.
#[pyfunction]
pub fn ss<'py>(
    py: Python<'py>,
    similarity: Reals<'py, Ix1>,
    threshold: ThresholdOption,
    otsu: &str,
    bins: usize,
) -> PyResult<PyGrouping<'py>> {
    let scores = similarity.vector()?;
    let method = SimilarityScore { threshold: to_threshold(&threshold, otsu, bins)? };
    group_inline(py, Correspondences::without_positions(scores.len()).with_similarity(scores), &method)
}

/// NNSR. Takes microseconds, so it runs on the calling thread.
#[pyfunction]
pub fn nnsr<'py>(py: Python<'py>, ratio: Reals<'py, Ix1>, max_ratio: f64) -> PyResult<PyGrouping<'py>> {
    let ratio = ratio.vector()?;
    let input = Correspondences::without_positions(ratio.len()).with_ratio(ratio);
    group_inline(py, input, &NearestNeighborRatio { max_ratio })
}

fn group_inline<'py>(
    py: Python<'py>,
    correspondences: cgroup::Result<Correspondences>,
    method: &(impl GroupingMethod + Sync),
) -> PyResult<PyGrouping<'py>> {
    let result = run_inline(py, |execution| method.group(&correspondences?, execution))?;
    convert::grouping(py, result)
}

/// SI.
#[pyfunction]
#[pyo3(signature = (fields, run_options, *, tolerance, neighbors, min_distance_ratio, lowe_ratio, global_rank, threshold, otsu))]
#[expect(clippy::too_many_arguments, reason = "one per option of the method")]
pub fn si<'py>(
    py: Python<'py>,
    fields: Fields<'py>,
    run_options: RunOptions,
    tolerance: Option<f64>,
    neighbors: usize,
    min_distance_ratio: f64,
    lowe_ratio: f64,
    global_rank: &str,
    threshold: ThresholdOption,
    otsu: &str,
) -> PyResult<PyGrouping<'py>> {
    let ranks = [("lowe", GlobalRank::Lowe), ("local_score", GlobalRank::LocalScore)];
    let method = SearchOfInliers {
        tolerance,
        neighbors,
        min_distance_ratio,
        lowe_ratio,
        global_rank: choose("global_rank", global_rank, &ranks)?,
        threshold: to_threshold(&threshold, otsu, DEFAULT_BINS)?,
    };
    group(py, &fields, &run_options, method)
}

/// CV.
#[pyfunction]
#[pyo3(signature = (fields, run_options, *, distance_scale, angle_scale, voters, exclude_self, threshold, otsu))]
#[expect(clippy::too_many_arguments, reason = "one per option of the method")]
pub fn cv<'py>(
    py: Python<'py>,
    fields: Fields<'py>,
    run_options: RunOptions,
    distance_scale: Option<f64>,
    angle_scale: f64,
    voters: usize,
    exclude_self: bool,
    threshold: ThresholdOption,
    otsu: &str,
) -> PyResult<PyGrouping<'py>> {
    let threshold = to_threshold(&threshold, otsu, DEFAULT_BINS)?;
    let method = ConsistencyVoting { distance_scale, angle_scale, voters, exclude_self, threshold };
    group(py, &fields, &run_options, method)
}

/// RANSAC.
#[pyfunction]
#[pyo3(signature = (fields, run_options, *, tolerance, iterations, seed, refine, edge_ratio, confidence))]
#[expect(clippy::too_many_arguments, reason = "one per option of the method")]
pub fn ransac<'py>(
    py: Python<'py>,
    fields: Fields<'py>,
    run_options: RunOptions,
    tolerance: Option<f64>,
    iterations: usize,
    seed: u64,
    refine: bool,
    edge_ratio: Option<f64>,
    confidence: Option<f64>,
) -> PyResult<PyGrouping<'py>> {
    let method = Ransac { tolerance, iterations, seed, refine, edge_ratio, confidence };
    group(py, &fields, &run_options, method)
}

/// ST.
#[pyfunction]
#[pyo3(signature = (fields, run_options, *, min_distance_ratio, affinity, diagonal, conflict, eigensolver, recompute))]
#[expect(clippy::too_many_arguments, reason = "one per option of the method")]
pub fn st<'py>(
    py: Python<'py>,
    fields: Fields<'py>,
    run_options: RunOptions,
    min_distance_ratio: f64,
    affinity: &str,
    diagonal: &str,
    conflict: &str,
    eigensolver: &str,
    recompute: bool,
) -> PyResult<PyGrouping<'py>> {
    let affinities =
        [("raw", Affinity::Raw), ("threshold", Affinity::Threshold), ("binary", Affinity::Binary)];
    let diagonals = [("zero", Diagonal::Zero), ("one", Diagonal::One), ("score", Diagonal::Score)];
    let conflicts =
        [("rigidity", Conflict::Rigidity), ("one_to_one", Conflict::OneToOne), ("both", Conflict::Both)];
    let eigensolvers = [("power", Eigensolver::Power), ("dense", Eigensolver::Dense)];
    let method = Spectral {
        min_distance_ratio,
        affinity: choose("affinity", affinity, &affinities)?,
        diagonal: choose("diagonal", diagonal, &diagonals)?,
        conflict: choose("conflict", conflict, &conflicts)?,
        eigensolver: choose("eigensolver", eigensolver, &eigensolvers)?,
        recompute,
    };
    group(py, &fields, &run_options, method)
}

/// GC.
#[pyfunction]
#[pyo3(signature = (fields, run_options, *, tolerance, variant, ties, min_cluster_size, iterations, seed))]
#[expect(clippy::too_many_arguments, reason = "one per option of the method")]
pub fn gc<'py>(
    py: Python<'py>,
    fields: Fields<'py>,
    run_options: RunOptions,
    tolerance: Option<f64>,
    variant: &str,
    ties: &str,
    min_cluster_size: usize,
    iterations: usize,
    seed: u64,
) -> PyResult<PyGrouping<'py>> {
    let variants =
        [("star", geometric_consistency::Variant::Star), ("clique", geometric_consistency::Variant::Clique)];
    let method = GeometricConsistency {
        tolerance,
        variant: choose("variant", variant, &variants)?,
        ties: choose("ties", ties, &[("lowest", Ties::Lowest), ("union", Ties::Union)])?,
        min_cluster_size,
        iterations,
        seed,
    };
    group(py, &fields, &run_options, method)
}

/// 3DHV.
#[pyfunction]
#[pyo3(signature = (fields, run_options, *, variant, bins, bin_size, neighbors, interpolation, distance_weight, vote_threshold, iterations, seed))]
#[expect(clippy::too_many_arguments, reason = "one per option of the method")]
pub fn hough3d<'py>(
    py: Python<'py>,
    fields: Fields<'py>,
    run_options: RunOptions,
    variant: &str,
    bins: usize,
    bin_size: Option<f64>,
    neighbors: u32,
    interpolation: bool,
    distance_weight: bool,
    vote_threshold: f64,
    iterations: usize,
    seed: u64,
) -> PyResult<PyGrouping<'py>> {
    let variants = [("grid", hough_voting::Variant::Grid), ("pcl", hough_voting::Variant::Pcl)];
    let method = HoughVoting {
        variant: choose("variant", variant, &variants)?,
        bins,
        bin_size,
        neighbors: match neighbors {
            0 => Neighborhood::None,
            6 => Neighborhood::Faces,
            26 => Neighborhood::All,
            other => return Err(InputError::new_err(format!("neighbors: got {other}; choose 0, 6 or 26"))),
        },
        interpolation,
        distance_weight,
        vote_threshold,
        iterations,
        seed,
    };
    let correspondences = fields.to_core()?;
    if method.is_instant(&correspondences) {
        return group_inline(py, Ok(correspondences), &method);
    }
    group_on_pool(py, correspondences, &run_options, method)
}

/// GTM.
#[pyfunction]
#[pyo3(signature = (fields, run_options, *, iterations, threshold, otsu, payoff, tolerance, one_to_one, convergence_tolerance, dynamics))]
#[expect(clippy::too_many_arguments, reason = "one per option of the method")]
pub fn gtm<'py>(
    py: Python<'py>,
    fields: Fields<'py>,
    run_options: RunOptions,
    iterations: usize,
    threshold: ThresholdOption,
    otsu: &str,
    payoff: &str,
    tolerance: Option<f64>,
    one_to_one: bool,
    convergence_tolerance: Option<f64>,
    dynamics: &str,
) -> PyResult<PyGrouping<'py>> {
    let payoffs =
        [("distance_ratio", Payoff::DistanceRatio), ("distance_difference", Payoff::DistanceDifference)];
    let all_dynamics =
        [("replicator", Dynamics::Replicator), ("infection_immunisation", Dynamics::InfectionImmunisation)];
    let method = GameTheory {
        iterations,
        threshold: to_threshold(&threshold, otsu, DEFAULT_BINS)?,
        payoff: choose("payoff", payoff, &payoffs)?,
        tolerance,
        one_to_one,
        convergence_tolerance,
        dynamics: choose("dynamics", dynamics, &all_dynamics)?,
    };
    group(py, &fields, &run_options, method)
}

/// Least-squares rigid transform (4,4) of the selected correspondences.
#[pyfunction]
pub fn rigid_fit<'py>(
    py: Python<'py>,
    source: Reals<'py, Ix2>,
    target: Reals<'py, Ix2>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (source, target) = (source.points("source")?, target.points("target")?);
    let fit = run_inline(py, |_| {
        let all: Vec<usize> = (0..source.len()).collect();
        fit_group(&source, &target, &all)
    });
    Ok(convert::matrix(py, &fit?.to_matrix()))
}
