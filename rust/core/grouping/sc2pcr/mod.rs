//! SC2-PCR: correspondences that agree with the same others follow the same motion.
//!
//! Chen, Sun, Yang, Tao, *SC^2-PCR: A Second Order Spatial Compatibility for Efficient and Robust Point Cloud
//! Registration*, CVPR 2022, section 3. With `d = |ds - dt|` of two correspondences and D the bound on it:
//!
//! 1. First-order compatibility: soft, `max(0, 1 - d^2 / D^2)`; hard, `d < D`; tight, `d < D / 2`.
//! 2. Confidence: the principal eigenvector of the soft matrix, by ten power steps from equal entries.
//! 3. Seeds: a share of the correspondences, first the most confident ones within a radius in the source,
//!    then the others, each by confidence.
//! 4. Second-order compatibility of a seed with those that it is hard-compatible with: the number of
//!    correspondences that are tight-compatible with both. Each is compatible with itself.
//! 5. Consensus set of a seed, in two stages: itself and the best of these, `k1` in all; then of them the
//!    `k2` best by the number of the `k1` that are hard-compatible with both the seed and it.
//! 6. Pose of the set: weighted least squares, weighted by the principal eigenvector of its soft matrix with
//!    zeros on the diagonal.
//! 7. The pose with the most inliers wins, and is refined; the group is its inliers.
//!
//! With candidates, which are alternative target points of the source points, step 7 is that of SC2-PCR++
//! (`candidates.rs`).
//!
//! A set has hard-compatible members only; if they are fewer than `k1`, the published code pads it with
//! arbitrary others.
//!
//! Cost O(n^2) per power step, and O(n^2) words of 64 pairs for a share of the pairs in step 4. Memory: the
//! soft matrix uses n^2 bytes, or none if that is too much; the tight graph uses n^2 / 8, and if that is too
//! much only the most confident correspondences are used.

mod candidates;
mod consensus_set;
mod seeds;

use rayon::prelude::*;

use self::candidates::Candidates;
use self::consensus_set::ConsensusSets;
use self::seeds::{confidence, seeds};
use super::GroupingMethod;
use crate::compatibility::graph::AgreementGraph;
use crate::consensus::choice::{Choice, best_pose, group_of, poses_among};
use crate::geometry::rigid::Rigid;
use crate::options::{SHARE, method};
use crate::rule::{Agreement, Kind, Rule};
use crate::selection::top_k::largest_in_order;
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};

method! {
    /// Parameters of SC2-PCR.
    pub struct Sc2Pcr = "sc2pcr", ["source", "target"], optional ["candidates", "resolution"], {
        /// Residuals of inliers are below this length; default `5 * resolution`. Published: 0.1 m in rooms
        /// downsampled to 5 cm, 0.6 m on streets downsampled to 30 cm (presets "3dmatch" and "kitti").
        pub tolerance: Option<f64> = None;
        /// Bound on `|ds - dt|` of compatible correspondences, a length; default `tolerance`.
        pub max_distance_difference: Option<f64> = None;
        /// Share of the correspondences that are seeds; at least one.
        pub seed_ratio: f64 = 0.2, SHARE;
        /// Seeds are first the most confident correspondences within this length in the source, then the
        /// others by confidence; default `tolerance`.
        pub nms_radius: Option<f64> = None;
        /// Members of a consensus set after its first stage.
        pub k1: usize = 30;
        /// Members of a consensus set after its second stage.
        pub k2: usize = 20;
    }
}

/// The parameters with all lengths known.
struct Lengths {
    tolerance: f64,
    max_distance_difference: f64,
    nms_radius: f64,
}

impl GroupingMethod for Sc2Pcr {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("sc2pcr")?;
        let lengths = self.check(correspondences)?;
        let confidence = confidence(source, target, lengths.max_distance_difference, execution)?; // steps 1, 2
        let kept = most_confident(&confidence, AgreementGraph::most_vertices(execution.max_memory))?;
        let among = |kept: &Vec<usize>| memory::collect(kept.iter().map(|&i| confidence[i]));
        let of_kept = kept.as_ref().map(among).transpose()?;
        let poses = poses_among(kept.as_deref(), source, target, |p, q| {
            self.hypotheses(p, q, of_kept.as_ref().unwrap_or(&confidence), &lengths, execution)
        })?;
        let best = match correspondences.candidates() {
            None => best_pose(&poses, source, target, lengths.tolerance, Choice::Inliers, execution)?, // step 7
            Some(points) => {
                let Lengths { tolerance, max_distance_difference, .. } = lengths;
                let max_distance_difference = max_distance_difference / 2.0;
                let candidates = Candidates { source, target, points, tolerance, max_distance_difference };
                candidates.best_pose(&poses, execution)? // as SC2-PCR++
            }
        };
        let mut grouping = group_of(best, source, target, lengths.tolerance)?;
        grouping.scores = Some(confidence);
        let agreement = Agreement::difference(lengths.max_distance_difference);
        grouping = grouping.by(Rule::bounded(Kind::Residual, lengths.tolerance).agreeing(agreement));
        if let Some(kept) = kept {
            grouping = grouping.with("truncated", 1.0).with("vertices", kept.len() as f64);
        }
        Ok(grouping.with("hypotheses", poses.len() as f64))
    }
}

impl Sc2Pcr {
    fn check(&self, correspondences: &Correspondences) -> Result<Lengths> {
        let tolerance = correspondences.length("tolerance", self.tolerance, 5.0)?;
        let or_tolerance =
            |name, given: Option<f64>| correspondences.length(name, Some(given.unwrap_or(tolerance)), 5.0);
        Ok(Lengths {
            tolerance,
            max_distance_difference: or_tolerance("max_distance_difference", self.max_distance_difference)?,
            nms_radius: or_tolerance("nms_radius", self.nms_radius)?,
        })
    }

    /// The poses of the seeds' consensus sets, between the centred points, in the order of the seeds.
    fn hypotheses(
        &self,
        source: &Points,
        target: &Points,
        confidence: &[f64],
        lengths: &Lengths,
        execution: &Execution,
    ) -> Result<Vec<Rigid>> {
        let most = ((source.len() as f64 * self.seed_ratio) as usize).max(1);
        let seeds = seeds(source, confidence, lengths.nms_radius, most, execution)?; // step 3
        let limit = lengths.max_distance_difference;
        let sets = ConsensusSets::new(source, target, limit, [self.k1, self.k2], execution)?;
        execution.report(seeds.len(), 2 * seeds.len())?;
        let pose = |working: &mut _, &seed: &usize| {
            execution.advance()?;
            sets.pose(seed, memory::ready(working)?) // steps 4, 5, 6
        };
        let poses = memory::par_try_collect(seeds.par_iter().map_init(|| sets.working_space(), pose))?;
        memory::collect(poses.into_iter().flatten())
    }
}

/// The most confident correspondences whose graph fits into memory, ascending; `None` if all do.
fn most_confident(confidence: &[f64], most: usize) -> Result<Option<Vec<usize>>> {
    (most < confidence.len()).then(|| largest_in_order(confidence, most)).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grouping::test_problem::problem;

    #[test]
    fn finds_the_moved_points() -> Result<()> {
        for n in [400, 1_500] {
            let group = Sc2Pcr::default().group(&problem(n, n / 10)?, &Execution::default())?;
            assert!(group.mask[..n / 10].iter().all(|&selected| selected) && group.size() < n / 8);
            let model = group.model.unwrap_or_default();
            assert!((model[(0, 1)] + 1.0).abs() < 1e-2 && (model[(0, 3)] - 7.0).abs() < 0.5, "{model}");
            assert!(group.scores.is_some_and(|scores| scores.len() == n));
        }
        Ok(())
    }

    #[test]
    fn too_few_or_coincident_points_give_no_group() -> Result<()> {
        let empty = |input: &Correspondences| -> Result<()> {
            let group = Sc2Pcr::default().group(input, &Execution::default())?;
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
        let input = problem(400, 100)?;
        let bytes = 8 * 128 * 2;
        let group = Sc2Pcr::default().group(&input, &Execution::new(bytes))?;
        assert!(group.mask[..100].iter().all(|&selected| selected));
        assert_eq!(group.diagnostics.get("truncated"), Some(&1.0));
        assert_eq!(group.diagnostics.get("vertices"), Some(&128.0));
        assert_eq!(Sc2Pcr::default().group(&input, &Execution::new(0))?.size(), 0);
        Ok(())
    }

    #[test]
    fn needs_a_length_and_members() -> Result<()> {
        let without = Correspondences::new(&[[0.0; 3]; 4], &[[0.0; 3]; 4])?;
        assert!(Sc2Pcr::default().group(&without, &Execution::default()).is_err());
        let none = Sc2Pcr { k1: 0, ..Sc2Pcr::default() };
        assert!(none.group(&problem(9, 9)?, &Execution::default()).is_err());
        Ok(())
    }
}
