//! `TurboReg`: poses of triangles around the pairs that agree with the same others.
//!
//! Yan, Shi, Zhao, Wang, Cao, Wu, Li, *`TurboReg`: `TurboClique` for Robust and Efficient Point Cloud
//! Registration*, ICCV 2025, section 3:
//!
//! 1. Compatibility: `|ds - dt| < D`, a bound far below the tolerance, and `ds + dt > r`: short edges do not
//!    constrain the rotation.
//! 2. Second order: the weight of a compatible pair is its number of common neighbours. Pairs are ordered, i
//!    < j, so that a triangle has one pair of lowest indices and is found once.
//! 3. Pivots: the 2,000 heaviest pairs.
//! 4. Triangles: for a pivot (i, j), among the k > j that are compatible with both, the two with the greatest
//!    sum of the three weights.
//! 5. The least-squares motion of each triangle; the best by inliers, or by their residuals.
//! 6. The final refinement of SC2-PCR; the group is the inliers.
//!
//! A pivot without any such k has no triangle; the published code uses an arbitrary index there.
//!
//! Cost O(n^2) tests of pairs and O(n^2) words of 64 pairs for the share of compatible pairs; memory n^2 / 8
//! bytes. If that is too much, only the correspondences compatible with the most others are used.

use std::cmp::Reverse;

use rayon::prelude::*;

use super::GroupingMethod;
use crate::compatibility::agreement::DistanceAgreement;
use crate::compatibility::graph::{AgreementGraph, Edge, EdgeLengths, count_common};
use crate::consensus::choice::{Choice, best_pose, group_of, poses_among};
use crate::geometry::rigid::{Rigid, fit_triangle, fixes_rotation};
use crate::options::method;
use crate::rule::{Agreement, Kind, Rule};
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};

/// The published constants relative to the tolerance.
const DISTANCE_DIFFERENCE: f64 = 0.12;
const NMS_RADIUS: f64 = 1.5;

method! {
    /// Parameters of `TurboReg`.
    pub struct TurboReg = "turboreg", ["source", "target"], optional ["resolution"], {
        /// Residuals of inliers are below this length; default `5 * resolution`. Published: 0.1 m in rooms
        /// downsampled to 5 cm (preset "3dmatch"), 0.6 m on streets (preset "kitti").
        pub tolerance: Option<f64> = None;
        /// Bound on `|ds - dt|` of compatible correspondences, a length; default `0.12 * tolerance`.
        pub max_distance_difference: Option<f64> = None;
        /// Least `ds + dt` of compatible correspondences, a length; default `1.5 * tolerance`.
        pub nms_radius: Option<f64> = None;
        /// Number of heaviest pairs around which triangles are searched (K1).
        pub pivots: usize = 2_000;
        /// Triangles per pivot (K2).
        pub cliques_per_pivot: usize = 2;
        /// Score of a pose, with r a residual below the tolerance t: their number, the sum of `1 - r / t`, or
        /// the sum of `(1 - r / t)^2`.
        pub choice: Choice = Choice::default();
    }
}

/// The parameters with all lengths known.
struct Lengths {
    tolerance: f64,
    max_distance_difference: f64,
    nms_radius: f64,
}

impl GroupingMethod for TurboReg {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("turboreg")?;
        let lengths = self.check(correspondences)?;
        let kept = most_compatible(source, target, lengths.max_distance_difference, execution)?;
        let poses =
            poses_among(kept.as_deref(), source, target, |p, q| self.hypotheses(p, q, &lengths, execution))?;
        let best = best_pose(&poses, source, target, lengths.tolerance, self.choice, execution)?; // step 5
        let grouping = group_of(best, source, target, lengths.tolerance)?; // step 6
        let agreement = Agreement {
            least_sum: Some(lengths.nms_radius),
            ..Agreement::difference(lengths.max_distance_difference)
        };
        let rule = Rule::bounded(Kind::Residual, lengths.tolerance).agreeing(agreement);
        let grouping = grouping.by(rule).with("hypotheses", poses.len() as f64);
        Ok(match kept {
            None => grouping,
            Some(kept) => grouping.with("truncated", 1.0).with("vertices", kept.len() as f64),
        })
    }
}

impl TurboReg {
    fn check(&self, correspondences: &Correspondences) -> Result<Lengths> {
        let tolerance = correspondences.length("tolerance", self.tolerance, 5.0)?;
        let given_or = |name, given: Option<f64>, share: f64| {
            correspondences.length(name, Some(given.unwrap_or(share * tolerance)), share)
        };
        Ok(Lengths {
            tolerance,
            max_distance_difference: given_or(
                "max_distance_difference",
                self.max_distance_difference,
                DISTANCE_DIFFERENCE,
            )?,
            nms_radius: given_or("nms_radius", self.nms_radius, NMS_RADIUS)?,
        })
    }

    /// The motions of the triangles, between the centred points: first each pivot's best, then each one's
    /// second, ...
    fn hypotheses(
        &self,
        source: &Points,
        target: &Points,
        lengths: &Lengths,
        execution: &Execution,
    ) -> Result<Vec<Rigid>> {
        let edges = EdgeLengths::SumAbove(lengths.nms_radius);
        let limit = lengths.max_distance_difference;
        let graph = AgreementGraph::with_edges(source, target, limit, edges, execution)?; // steps 1, 2
        let pivots = graph.heaviest_edges(self.pivots, execution)?; // step 3
        execution.report(0, pivots.len())?;
        let poses = |pivot: &Edge| {
            execution.advance()?;
            let thirds = best_thirds(&graph, pivot, self.cliques_per_pivot)?; // step 4
            let triangle = |k: u32| [pivot.i, pivot.j, k].map(|index| index as usize);
            memory::collect(thirds.into_iter().map(|k| pose_of(triangle(k), source, target)))
        };
        let poses = memory::par_try_collect(pivots.par_iter().map(poses))?;
        let most = poses.iter().map(Vec::len).max().unwrap_or_default();
        let ranked = (0..most).flat_map(|rank| poses.iter().filter_map(move |of| of.get(rank).copied()?));
        memory::collect(ranked)
    }
}

/// The most compatible correspondences whose graph fits into memory, ascending; `None` if all do.
fn most_compatible(
    source: &Points,
    target: &Points,
    max_distance_difference: f64,
    execution: &Execution,
) -> Result<Option<Vec<usize>>> {
    let most = AgreementGraph::most_vertices(execution.max_memory);
    if source.len() <= most {
        return Ok(None);
    }
    DistanceAgreement::new(source, target, max_distance_difference)?.most_agreeing(most, execution).map(Some)
}

/// The third corners of a pivot's heaviest triangles, the heaviest first, ties to the lowest index.
fn best_thirds(graph: &AgreementGraph, pivot: &Edge, most: usize) -> Result<Vec<u32>> {
    let (i, j) = (pivot.i as usize, pivot.j as usize);
    let weight = |k: u32| {
        let third = graph.row(k as usize);
        count_common(graph.row(i), third) + count_common(graph.row(j), third)
    };
    let candidates = graph.common_neighbors(i, j, usize::MAX)?.into_iter().filter(|&k| k > pivot.j);
    let mut ranked = memory::collect(candidates.map(|k| (Reverse(weight(k)), k)))?;
    ranked.sort_unstable();
    memory::collect(ranked.into_iter().take(most).map(|(_, k)| k))
}

/// The motion of a triangle; `None` if its points are collinear.
fn pose_of(triangle: [usize; 3], source: &Points, target: &Points) -> Option<Rigid> {
    let (p, q) = (triangle.map(|i| source.get(i)), triangle.map(|i| target.get(i)));
    fixes_rotation(&p, &q).then(|| fit_triangle(&p, &q))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grouping::test_problem::problem;

    #[test]
    fn finds_the_moved_points() -> Result<()> {
        for choice in [Choice::Inliers, Choice::Mae, Choice::Mse] {
            let method = TurboReg { choice, ..TurboReg::default() };
            let group = method.group(&problem(400, 30)?, &Execution::default())?;
            assert!(group.mask[..30].iter().all(|&selected| selected) && group.size() < 35);
            let model = group.model.unwrap_or_default();
            assert!((model[(0, 1)] + 1.0).abs() < 1e-9 && (model[(0, 3)] - 7.0).abs() < 1e-6, "{model}");
        }
        Ok(())
    }

    #[test]
    fn too_few_or_coincident_points_give_no_group() -> Result<()> {
        let empty = |input: &Correspondences| -> Result<()> {
            let group = TurboReg::default().group(input, &Execution::default())?;
            assert_eq!((group.size(), group.model), (0, None));
            Ok(())
        };
        for n in 0..3 {
            empty(&problem(n, n)?)?;
        }
        let line: Vec<[f64; 3]> = (0..50).map(|i| [f64::from(i), 2.0 * f64::from(i), 0.0]).collect();
        for rows in [vec![[1.0; 3]; 50], line] {
            empty(&Correspondences::new(&rows, &rows)?.with_resolution(1.0)?)?;
        }
        Ok(())
    }

    #[test]
    fn a_graph_that_does_not_fit_has_fewer_vertices() -> Result<()> {
        let input = problem(400, 30)?;
        let bytes = 8 * 128 * 2;
        let group = TurboReg::default().group(&input, &Execution::new(bytes))?;
        assert!(group.mask[..30].iter().all(|&selected| selected));
        assert_eq!(group.diagnostics.get("truncated"), Some(&1.0));
        assert_eq!(group.diagnostics.get("vertices"), Some(&128.0));
        assert_eq!(TurboReg::default().group(&input, &Execution::new(0))?.size(), 0);
        Ok(())
    }

    #[test]
    fn needs_a_length_and_pivots() -> Result<()> {
        let without = Correspondences::new(&[[0.0; 3]; 4], &[[0.0; 3]; 4])?;
        assert!(TurboReg::default().group(&without, &Execution::default()).is_err());
        let none = TurboReg { pivots: 0, ..TurboReg::default() };
        assert!(none.group(&problem(9, 9)?, &Execution::default()).is_err());
        Ok(())
    }
}
