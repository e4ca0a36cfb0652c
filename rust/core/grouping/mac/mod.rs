//! MAC: the best of the motions proposed by maximal cliques of agreeing correspondences.
//!
//! Zhang et al., *3D Registration with Maximal Cliques*, CVPR 2023; Yang et al., TPAMI 2024.
//!
//! 1. The weight of a pair, `w_ij = 1 - (1 - w_min) (d_ij / d_max)^2` with `d_ij = |ds - dt|`, if
//!    `d_ij <= d_max`, else 0: the original's `1 - d_ij^2 / d_cmp^2`, cut at `w_min`.
//! 2. Its second order, `W_ij = w_ij sum_k w_ik w_jk`: agreement of the common neighbours with both.
//! 3. A dense graph is reduced to the vertices whose neighbours agree best with each other.
//! 4. All maximal cliques; the weight of a clique is the sum of W over its pairs, and each vertex keeps its
//!    heaviest.
//! 5. The least-squares motion of each kept clique is a hypothesis; the best has the greatest sum of
//!    `1 - r_i / tolerance` over residuals `r_i` below the tolerance. It is refined.
//!
//! Memory 14 bytes for each direction of an agreeing pair. Cost O(n^2) tests of pairs, the sum of squared
//! degrees for W, and the search for cliques, which is bounded by their number.

mod graph;
mod neighborhood;
mod reduction;
mod search;
mod walk;

use std::borrow::Cow;

use rayon::prelude::*;

use super::GroupingMethod;
use crate::compatibility::agreement::DistanceAgreement;
use crate::consensus::choice::{Choice, best_pose, group_of, inliers_of};
use crate::error::positive;
use crate::geometry::rigid::{Rigid, fit_rows};
use crate::memory;
use crate::options::{BELOW_ONE, ROUNDS, at_least, method};
use crate::rule::{Agreement, Kind, Rule};
use crate::selection::top_k::largest;
use crate::{Correspondences, Execution, Grouping, Points, Result};
use graph::{BYTES_PER_NEIGHBOR, Kernel, SecondOrderGraph};
use search::Search;
use walk::Clique;

/// Most paths of two edges, and so most steps of computing W. If there are more, the vertices of the least
/// degree are removed.
const MOST_PATHS: f64 = (1_u64 << 30) as f64;

method! {
    /// Parameters of MAC.
    pub struct MaximalCliques = "mac", ["source", "target"], optional ["resolution"], {
        /// Residuals below this length belong to the group; default `5 * resolution`.
        pub tolerance: Option<f64> = None;
        /// Greatest distance difference of agreeing correspondences, a length; default `tolerance / 5`.
        pub max_distance_difference: Option<f64> = None;
        /// Weight of correspondences that differ by `max_distance_difference`, less than 1.
        pub min_weight: f64 = 0.99, BELOW_ONE;
        /// Least number of members of a clique, 3 or more.
        pub min_clique_size: usize = 3, at_least(3);
        /// Most results of the search: maximal cliques and dead ends. Every start vertex gets an equal share
        /// of those left by the vertices before it, at least one.
        pub max_cliques: usize = 1_000_000, ROUNDS;
        /// Number of heaviest cliques that propose a motion; by default all.
        pub max_hypotheses: Option<usize> = None;
        /// Refine the best motion by weighted least squares over the group, up to 20 times.
        pub refine: bool = true;
    }
}

impl GroupingMethod for MaximalCliques {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("mac")?;
        let tolerance = correspondences.length("tolerance", self.tolerance, 5.0)?;
        let search = Search { min_size: self.min_clique_size, max_ends: self.max_cliques };
        let kernel = self.kernel(tolerance)?;
        let agreement = Agreement::difference(kernel.bound).or_equal();
        let rule = Rule::bounded(Kind::Residual, tolerance).agreeing(agreement);
        let vertices = affordable(source, target, kernel.bound, execution)?;
        let (p, q) = (only(source, &vertices)?, only(target, &vertices)?);
        let graph = SecondOrderGraph::new(&p, &q, kernel, execution)?; // w, then W = w o (w w)
        let dense = reduction::dense_part(&graph, execution)?; // clustering coefficients
        let found = search.heaviest_cliques(&graph, &dense, execution)?; // node-guided selection
        let cliques = found.distinct(self.max_hypotheses.unwrap_or(usize::MAX))?;
        let poses = cliques.par_iter().map(|clique| pose_of(clique, &vertices, source, target)); // SVD
        let poses = memory::collect(memory::par_try_collect(poses)?.into_iter().flatten())?;
        let best = best_pose(&poses, source, target, tolerance, Choice::Mae, execution)?;
        let mut grouping = if self.refine { group_of } else { inliers_of }(best, source, target, tolerance)?;
        let mut scores = memory::filled(0.0, source.len())?;
        vertices.iter().zip(found.weights()).for_each(|(&i, weight)| scores[i] = weight);
        grouping.scores = Some(scores);
        grouping = grouping.by(rule);
        if vertices.len() < source.len() || found.cut_short {
            grouping = grouping.with("truncated", 1.0);
        }
        Ok(grouping
            .with("vertices", vertices.len() as f64)
            .with("reduced_vertices", dense.len() as f64)
            .with("cliques", found.cliques as f64)
            .with("hypotheses", poses.len() as f64))
    }
}

impl MaximalCliques {
    fn kernel(&self, tolerance: f64) -> Result<Kernel> {
        let bound = self.max_distance_difference.unwrap_or(tolerance / 5.0);
        Ok(Kernel { bound: positive("max_distance_difference", bound)?, min_weight: self.min_weight })
    }
}

/// The vertices of the highest degrees, ties to the lowest index, limited by time and memory; ascending.
fn affordable(source: &Points, target: &Points, bound: f64, execution: &Execution) -> Result<Vec<usize>> {
    let degrees = DistanceAgreement::new(source, target, bound.next_up())?.counts(execution)?;
    let degrees = memory::collect(degrees.into_iter().map(f64::from))?;
    let mut vertices = largest(&degrees, degrees.len())?;
    let fits = |&most: &usize| {
        // No degree in the subset is greater.
        let left = vertices[..most].iter().map(|&i| degrees[i].min(most as f64));
        let (neighbors, paths) = left.fold((0.0, 0.0), |(sum, squares), d| (sum + d, squares + d * d));
        paths <= MOST_PATHS && neighbors * BYTES_PER_NEIGHBOR <= execution.max_memory as f64
    };
    let sizes = memory::collect(1..=vertices.len())?;
    let most = sizes.partition_point(fits);
    vertices.truncate(most);
    vertices.sort_unstable();
    Ok(vertices)
}

/// The points of the vertices; unchanged if these are all.
fn only<'a>(points: &'a Points, vertices: &[usize]) -> Result<Cow<'a, Points>> {
    if vertices.len() == points.len() {
        return Ok(Cow::Borrowed(points));
    }
    points.subset(vertices).map(Cow::Owned)
}

/// The motion of a clique; `None` if the points do not determine the rotation.
fn pose_of(clique: &Clique, vertices: &[usize], source: &Points, target: &Points) -> Result<Option<Rigid>> {
    fit_rows(source, target, clique.members.iter().map(|&i| vertices[i as usize]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grouping::test_problem::problem;

    #[test]
    fn finds_the_moved_points() -> Result<()> {
        let group = MaximalCliques::default().group(&problem(400, 30)?, &Execution::default())?;
        assert!(group.mask[..30].iter().all(|&selected| selected) && group.size() < 35);
        assert!(group.model.is_some_and(|model| (model[(0, 3)] - 7.0).abs() < 1e-6));
        assert!(!group.diagnostics.contains_key("truncated"));
        Ok(())
    }

    #[test]
    fn little_memory_keeps_the_highest_degrees_and_is_reported() -> Result<()> {
        let group = MaximalCliques::default().group(&problem(400, 30)?, &Execution::new(8_000))?;
        assert!(group.diagnostics["vertices"] < 40.0 && group.diagnostics["truncated"] > 0.0);
        assert!(group.mask[..30].iter().all(|&selected| selected) && group.size() < 35);
        Ok(())
    }

    #[test]
    fn many_agreeing_matches_are_limited_by_time() -> Result<()> {
        let group = MaximalCliques::default().group(&problem(1_500, 1_500)?, &Execution::default())?;
        assert!(group.diagnostics["vertices"] < 1_100.0 && group.diagnostics["truncated"] > 0.0);
        assert_eq!(group.size(), 1_500);
        Ok(())
    }

    #[test]
    fn options_out_of_range_are_refused() -> Result<()> {
        let input = problem(20, 20)?;
        let default = MaximalCliques::default();
        for method in [
            MaximalCliques { min_weight: 1.0, ..default },
            MaximalCliques { min_weight: f64::NAN, ..default },
            MaximalCliques { min_clique_size: 2, ..default },
            MaximalCliques { max_cliques: 0, ..default },
            MaximalCliques { max_hypotheses: Some(0), ..default },
            MaximalCliques { max_distance_difference: Some(0.0), ..default },
        ] {
            let refused = method.group(&input, &Execution::default());
            assert!(matches!(refused, Err(crate::Error::InvalidInput { .. })), "{method:?}");
        }
        Ok(())
    }
}
