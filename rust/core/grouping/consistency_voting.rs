//! CV: distinctive correspondences vote for those whose distances and frames agree with theirs.
//!
//! The paper, section 3.1 (after Yang, Xiao, Cao, PRL 2019):
//! `s_i = sum_j exp(-(|ds - dt| / delta_r)^2 - (|e(L_i, L_j) - e(L'_i, L'_j)| / delta_L)^2)` over the 200
//! correspondences with the best nearest-neighbour ratio. Cost O(n voters).

use rayon::prelude::*;

use super::GroupingMethod;
use crate::compatibility::distance::distance_difference;
use crate::compatibility::lrf_angle::frame_angle_degrees;
use crate::correspondences::Frame;
use crate::error::{at_least_one, positive};
use crate::selection::otsu::{Cut, Threshold};
use crate::selection::top_k::smallest;
use crate::{Correspondences, Execution, Grouping, Points, Result};

/// Parameters of consistency voting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConsistencyVoting {
    /// `delta_r`: distance difference at which a vote falls to 1/e, a length; default 10 resolutions.
    pub distance_scale: Option<f64>,
    /// `delta_L`: difference of frame angles at which a vote falls to 1/e, in degrees.
    pub angle_scale: f64,
    /// Number of voters.
    pub voters: usize,
    /// Whether voters do without the vote for themselves.
    pub exclude_self: bool,
    /// Cut on the scores.
    pub threshold: Threshold,
}

impl Default for ConsistencyVoting {
    fn default() -> Self {
        Self {
            distance_scale: None,
            angle_scale: 10.0,
            voters: 200,
            exclude_self: false,
            threshold: Threshold::default(),
        }
    }
}

impl GroupingMethod for ConsistencyVoting {
    fn group(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("cv")?;
        let (source_frames, target_frames) = correspondences.frames("cv")?;
        let ratio = correspondences.ratio("cv")?;
        self.threshold.validate()?;
        let pairs = Pairs {
            source,
            target,
            source_frames,
            target_frames,
            distance_scale: correspondences.length("distance_scale", self.distance_scale, 10.0)?,
            angle_scale: positive("angle_scale", self.angle_scale)?,
        };
        let voters = smallest(ratio, at_least_one("voters", self.voters)?); // V: top k by 1 - d1/d2
        let scores = self.count_votes(&pairs, &voters, execution)?; // s_i = sum_j D_ij
        let Cut { mask, threshold } = self.threshold.above(&scores); // s_i > t_cv
        Ok(Grouping { mask, scores: Some(scores), threshold, ..Grouping::default() })
    }
}

impl ConsistencyVoting {
    fn count_votes(&self, pairs: &Pairs, voters: &[usize], execution: &Execution) -> Result<Vec<f64>> {
        execution.report(0, pairs.source.len())?;
        (0..pairs.source.len())
            .into_par_iter()
            .with_min_len(16)
            .map(|i| {
                execution.advance()?;
                let others = voters.iter().filter(|&&j| !(self.exclude_self && j == i));
                Ok(others.map(|&j| pairs.vote(i, j)).sum())
            })
            .collect()
    }
}

struct Pairs<'a> {
    source: &'a Points,
    target: &'a Points,
    source_frames: &'a [Frame],
    target_frames: &'a [Frame],
    distance_scale: f64,
    angle_scale: f64,
}

impl Pairs<'_> {
    /// `D_ij`; 0 where a frame is missing.
    fn vote(&self, i: usize, j: usize) -> f64 {
        let (Some(source_i), Some(source_j)) = (&self.source_frames[i], &self.source_frames[j]) else {
            return 0.0;
        };
        let (Some(target_i), Some(target_j)) = (&self.target_frames[i], &self.target_frames[j]) else {
            return 0.0;
        };
        let difference = distance_difference(self.source.distance(i, j), self.target.distance(i, j));
        let source_angle = frame_angle_degrees(source_i, source_j); // e(L_i, L_j)
        let target_angle = frame_angle_degrees(target_i, target_j); // e(L'_i, L'_j)
        let distance_term = (difference / self.distance_scale).powi(2);
        let angle_term = ((source_angle - target_angle) / self.angle_scale).powi(2);
        (-distance_term - angle_term).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Rotation3, Vector3};

    fn problem() -> Result<Correspondences> {
        let source = [[0., 0., 0.], [10., 0., 0.], [0., 10., 0.]];
        let target = [[0., 0., 0.], [10., 0., 0.], [0., 13., 0.]];
        let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), 5_f64.to_radians()).into_inner();
        let identity = Some(Matrix3::identity());
        Correspondences::new(&source, &target)?
            .with_ratio(vec![0.1, 0.9, 0.5])?
            .with_frames(vec![identity; 3], vec![identity, Some(turned), None])?
            .with_resolution(0.3)
    }

    #[test]
    fn votes_by_hand() -> Result<()> {
        let method = ConsistencyVoting { voters: 1, ..ConsistencyVoting::default() };
        let scores = method.group(&problem()?, &Execution::default())?.scores.unwrap_or_default();
        // Voter 0 votes 1 for itself, exp(-(5/10)^2) for 1, and 0 for 2, which has no frame.
        for (score, expected) in scores.iter().zip([1.0, (-0.25_f64).exp(), 0.0]) {
            assert!((score - expected).abs() < 1e-6, "{score} {expected}");
        }
        Ok(())
    }

    #[test]
    fn the_own_vote_can_be_left_out() -> Result<()> {
        let method = ConsistencyVoting { voters: 1, exclude_self: true, ..ConsistencyVoting::default() };
        let scores = method.group(&problem()?, &Execution::default())?.scores.unwrap_or_default();
        assert!(scores[0].abs() < 1e-15);
        Ok(())
    }
}
