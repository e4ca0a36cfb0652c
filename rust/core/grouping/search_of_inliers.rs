//! SI: votes of neighbours, then of the most distinctive correspondences under the candidate's own pose.
//!
//! The paper, section 3.1, Eq. (3) to (6) (after Buch, Yang, Kruger, Petersen, CVPR 2014):
//! `s_i = (|Y_L| + |Y_G|) / (|C_L| + |C_G|)`. Cost O(n log n + n neighbours).

use rayon::prelude::*;

use super::GroupingMethod;
use crate::compatibility::pose::pose_of;
use crate::compatibility::votes::{PointPair, RigidityTest, Voters, count_rigid, point_pairs, square_limit};
use crate::frames::Frames;
use crate::geometry::nearest_sets::NearestSets;
use crate::options::{SHARE, Value, method, words};
use crate::rule::{Agreement, Kind, Rule};
use crate::selection::otsu::{Cut, OtsuMode, Threshold};
use crate::selection::top_k::{largest, smallest};
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};

words! {
    /// Selection of the correspondences that vote for all others.
    pub enum GlobalRank {
        /// The lowest nearest-neighbour ratios, as in the paper.
        Lowe = Value::Word("lowe"),
        /// The best local scores, as in the original author's code.
        LocalScore = Value::Word("local_score"),
    }
}

method! {
    /// Parameters of the search of inliers.
    pub struct SearchOfInliers = "si", ["source", "target", "ratio", "source_lrf", "target_lrf"],
        optional ["resolution"], {
        /// Greatest residual under the pose of a correspondence (delta), a length; default `5 * resolution`.
        pub tolerance: Option<f64> = None;
        /// Number of local neighbours, and of global voters (kappa).
        pub neighbors: usize = 250;
        /// Least rigidity `min(ds/dt, dt/ds)` of a vote (sigma).
        pub min_distance_ratio: f64 = 0.9, SHARE;
        /// Upper bound of the ratio of local voters.
        pub lowe_ratio: f64 = 0.8, SHARE;
        /// Global voters have the lowest ratios, or the best local scores as in the original author's code.
        pub global_rank: GlobalRank = GlobalRank::default();
        /// Scores above this are selected.
        pub threshold: Threshold = Threshold::Otsu;
        /// Candidates of Otsu's threshold: 100 equal bins between the least and the greatest score; every gap
        /// between scores; as in the code of SI's author, for scores from 0 to 1; or as in the evaluation
        /// group's later code.
        pub otsu: OtsuMode = OtsuMode::default();
    }
}

/// Votes for a correspondence, and votes cast.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Votes {
    support: usize,
    cast: usize,
}

impl Votes {
    fn share(self) -> f64 {
        if self.cast == 0 { 0.0 } else { self.support as f64 / self.cast as f64 }
    }
}

impl GroupingMethod for SearchOfInliers {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("si")?;
        let (source_frames, target_frames) = correspondences.frames("si")?;
        let ratio = correspondences.ratio("si")?;
        let tolerance = correspondences.length("tolerance", self.tolerance, 5.0)?;
        let ballot = Ballot {
            source,
            target,
            source_frames,
            target_frames,
            pairs: point_pairs(source, target)?,
            rigidity: RigidityTest {
                zero_source: source.zero_length(),
                zero_target: target.zero_length(),
                min_ratio: self.min_distance_ratio,
            },
            tolerance,
            neighbors: self.neighbors,
        };

        let distinctive = memory::collect(ratio.iter().map(|&r| r < self.lowe_ratio))?; // C_Ratio, Eq. (2)
        let local = ballot.local_votes(&distinctive, execution)?; // Y_L and C_L, Eq. (3)
        let voters = self.global_voters(ratio, &local)?; // C_G
        let global = ballot.global_votes(&voters, execution)?; // Y_G and C_G without i, Eq. (5)
        let both = |(l, g): (&Votes, &Votes)| Votes { support: l.support + g.support, cast: l.cast + g.cast };
        let scores = memory::collect(local.iter().zip(&global).map(|votes| both(votes).share()))?; // s_i, Eq. (6)
        let Cut { mask, threshold } = self.threshold.above(&scores, self.otsu)?;
        let rule = Rule::new(Kind::Score).agreeing(Agreement::ratio(self.min_distance_ratio));
        Ok(Grouping { mask, scores: Some(scores), threshold, ..Grouping::default() }.by(rule))
    }
}

impl SearchOfInliers {
    fn global_voters(&self, ratio: &[f64], local: &[Votes]) -> Result<Vec<usize>> {
        match self.global_rank {
            GlobalRank::Lowe => smallest(ratio, self.neighbors),
            GlobalRank::LocalScore => {
                let local_scores = memory::collect(local.iter().map(|votes| votes.share()))?;
                largest(&local_scores, self.neighbors)
            }
        }
    }
}

struct Ballot<'a> {
    source: &'a Points,
    target: &'a Points,
    source_frames: &'a Frames,
    target_frames: &'a Frames,
    pairs: Vec<PointPair>,
    rigidity: RigidityTest,
    tolerance: f64,
    neighbors: usize,
}

impl Ballot<'_> {
    /// Distinctive correspondences among the nearest source keypoints vote by rigidity.
    fn local_votes(&self, distinctive: &[bool], execution: &Execution) -> Result<Vec<Votes>> {
        // C_L: the nearest ones that are in C_Ratio.
        NearestSets::new(self.source, execution)?.map(self.neighbors, distinctive, execution, |i, members| {
            let support = count_rigid(&self.pairs, members, &self.pairs[i], &self.rigidity);
            Votes { support, cast: members.len() }
        })
    }

    /// Global voters must also agree with the pose of `i`; `i` has no vote of its own.
    fn global_votes(&self, voters: &[usize], execution: &Execution) -> Result<Vec<Votes>> {
        execution.report(0, self.source.len())?;
        let mut cast = memory::filled(voters.len(), self.source.len())?;
        voters.iter().for_each(|&i| cast[i] -= 1);
        let voters = memory::collect(voters.iter().map(|&i| i as u32))?;
        let voters = Voters::new(&self.pairs, &voters)?;
        let limit = square_limit(self.tolerance);
        let votes_on = |i: usize| {
            execution.advance()?;
            let frames = (self.source_frames.get(i), self.target_frames.get(i));
            let pose = pose_of(i, self.source, self.target, &frames.0, &frames.1); // T(c_i), Eq. (4)
            // Its distances are 0, so `i` never supports itself.
            let support =
                pose.map_or(0, |pose| voters.count_carried(&self.pairs[i], &self.rigidity, &pose, limit));
            Ok(Votes { support, cast: cast[i] })
        };
        memory::par_try_collect((0..self.source.len()).into_par_iter().with_min_len(16).map(votes_on))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    /// Four points shifted, one matched elsewhere; identity frames.
    fn problem(ratio: [f64; 5]) -> Result<Correspondences> {
        let source = [[0., 0., 0.], [4., 0., 0.], [0., 3., 0.], [0., 0., 5.], [1., 1., 1.]];
        let mut target = source.map(|p| [p[0] + 10.0, p[1], p[2]]);
        target[4] = [90.0, 9.0, 2.0];
        let frames = vec![Some(Matrix3::identity()); 5];
        Correspondences::new(&source, &target)?
            .with_ratio(ratio.to_vec())?
            .with_frames(frames.clone(), frames)?
            .with_resolution(0.1)
    }

    #[test]
    fn votes_by_hand() -> Result<()> {
        // All are distinctive and neighbours: 4 local and 4 global votes are cast for each. A correct one
        // gets 3 + 3 from the other correct ones, the wrong one none.
        let group =
            SearchOfInliers::default().group(&problem([0.1, 0.2, 0.3, 0.4, 0.5])?, &Execution::default())?;
        assert_eq!(group.scores, Some(vec![0.75, 0.75, 0.75, 0.75, 0.0]));
        assert_eq!(group.mask, [true, true, true, true, false]);
        Ok(())
    }

    #[test]
    fn only_distinctive_neighbours_vote_locally() -> Result<()> {
        // 3 and 4 are not distinctive; one global voter: 0.
        let method = SearchOfInliers { neighbors: 1, ..SearchOfInliers::default() };
        let group = method.group(&problem([0.1, 0.2, 0.3, 0.9, 0.9])?, &Execution::default())?;
        // Nearest others: 0 -> 4 (not distinctive), 1 -> 4, 2 -> 4, 3 -> 4, 4 -> 0 (fails).
        assert_eq!(group.scores, Some(vec![0.0, 1.0, 1.0, 1.0, 0.0]));
        Ok(())
    }
}
