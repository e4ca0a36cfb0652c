//! CV: distinctive correspondences vote for those whose distances and frames agree with theirs.
//!
//! The paper, section 3.1 (after Yang, Xiao, Cao, PRL 2019):
//! `s_i = sum_j exp(-(|ds - dt| / delta_r)^2 - (|e(L_i, L_j) - e(L'_i, L'_j)| / delta_L)^2)` over the 200
//! correspondences with the best nearest-neighbour ratio. Cost O(n voters).

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use rayon::prelude::*;

use super::GroupingMethod;
use crate::compatibility::lrf_angle::angle_difference;
use crate::compatibility::vector_math::{Arithmetic, ArithmeticWork, exp_of_negative, with_arithmetic};
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
        let distance_scale = correspondences.length("distance_scale", self.distance_scale, 10.0)?;
        let angle_scale = positive("angle_scale", self.angle_scale)?.to_radians();
        let matches = Matches { source, target, source_frames, target_frames };

        let voters = smallest(ratio, at_least_one("voters", self.voters)?); // V: top k by 1 - d1/d2
        let ballot = Ballot::new(&matches, &voters, distance_scale, angle_scale);
        let scores = self.count_votes(&matches, &ballot, execution)?; // s_i = sum_j D_ij
        let Cut { mask, threshold } = self.threshold.above(&scores); // s_i > t_cv
        Ok(Grouping { mask, scores: Some(scores), threshold, ..Grouping::default() })
    }
}

impl ConsistencyVoting {
    fn count_votes(&self, matches: &Matches, ballot: &Ballot, execution: &Execution) -> Result<Vec<f64>> {
        execution.report(0, matches.source.len())?;
        let votes_on = |i: usize| {
            execution.advance()?;
            let own = if self.exclude_self { ballot.voters.iter().position(|&j| j == i) } else { None };
            Ok(matches.terms(i).map_or(0.0, |candidate| ballot.votes_on(candidate, own)))
        };
        (0..matches.source.len()).into_par_iter().with_min_len(16).map(votes_on).collect()
    }
}

struct Matches<'a> {
    source: &'a Points,
    target: &'a Points,
    source_frames: &'a [Frame],
    target_frames: &'a [Frame],
}

impl Matches<'_> {
    /// What the votes on or by `i` are computed from; nothing where a frame is missing.
    fn terms(&self, i: usize) -> Option<Terms<f64>> {
        let (source_frame, target_frame) = (self.source_frames[i]?, self.target_frames[i]?);
        Some(Terms {
            points: [self.source.get(i).into(), self.target.get(i).into()],
            frames: [source_frame, target_frame].map(|axes| std::array::from_fn(|k| axes[k])),
        })
    }
}

/// Point and frame of both sides, source first: of one correspondence, or of each voter of a group.
#[derive(Clone, Copy)]
struct Terms<T> {
    points: [[T; 3]; 2],
    frames: [[T; 9]; 2],
}

/// Voters that a vector instruction takes at once, or two of them.
const LANES: usize = 8;

type Group = Terms<[f64; LANES]>;

impl Group {
    /// Voters that are far away in the source alone: their votes are 0.
    const NOBODY: Self =
        Self { points: [[[f64::INFINITY; LANES]; 3], [[0.0; LANES]; 3]], frames: [[[0.0; LANES]; 9]; 2] };

    fn of(voters: &[(usize, Terms<f64>)]) -> Self {
        let mut group = Self::NOBODY;
        for (lane, (_, voter)) in voters.iter().enumerate() {
            for side in 0..2 {
                (0..3).for_each(|axis| group.points[side][axis][lane] = voter.points[side][axis]);
                (0..9).for_each(|entry| group.frames[side][entry][lane] = voter.frames[side][entry]);
            }
        }
        group
    }
}

/// The voters that have frames.
struct Ballot {
    voters: Vec<usize>,
    groups: Vec<Group>,
    /// `1 / delta_r`
    distance_factor: f64,
    /// `1 / delta_L`, `delta_L` in radians.
    angle_factor: f64,
}

impl Ballot {
    fn new(matches: &Matches, voters: &[usize], distance_scale: f64, angle_scale: f64) -> Self {
        let framed: Vec<_> = voters.iter().filter_map(|&j| Some((j, matches.terms(j)?))).collect();
        Self {
            voters: framed.iter().map(|(j, _)| *j).collect(),
            groups: framed.chunks(LANES).map(Group::of).collect(),
            // Finite, so that a difference of 0 stays 0.
            distance_factor: distance_scale.recip().min(f64::MAX),
            angle_factor: angle_scale.recip().min(f64::MAX),
        }
    }

    /// `sum_j D_ij`, without the vote of voter number `left_out`.
    fn votes_on(&self, candidate: Terms<f64>, left_out: Option<usize>) -> f64 {
        with_arithmetic(VotesOn { ballot: self, candidate, left_out })
    }
}

struct VotesOn<'a> {
    ballot: &'a Ballot,
    candidate: Terms<f64>,
    left_out: Option<usize>,
}

impl ArithmeticWork for VotesOn<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<A: Arithmetic>(mut self, arithmetic: A) -> f64 {
        self.candidate.frames.as_flattened_mut().iter_mut().for_each(|entry| *entry *= 0.5);
        let mut sums = [0.0; LANES];
        for (number, group) in self.ballot.groups.iter().enumerate() {
            let mut votes = [0.0; LANES];
            for lane in 0..LANES {
                votes[lane] = self.vote(arithmetic, group, lane);
            }
            match self.left_out {
                Some(voter) if voter / LANES == number => votes[voter % LANES] = 0.0,
                _ => {}
            }
            for lane in 0..LANES {
                sums[lane] += votes[lane];
            }
        }
        sums.iter().sum()
    }
}

impl VotesOn<'_> {
    /// `D_ij = exp(-(|ds - dt| / delta_r)^2 - (|e - e'| / delta_L)^2)`
    #[inline(always)]
    fn vote<A: Arithmetic>(&self, arithmetic: A, group: &Group, lane: usize) -> f64 {
        let [ds, dt] = [0, 1].map(
            #[inline(always)]
            |side| edge(arithmetic, &self.candidate.points[side], &group.points[side], lane),
        );
        let [source, target] = [0, 1].map(
            #[inline(always)]
            |side| cosine(arithmetic, &self.candidate.frames[side], &group.frames[side], lane),
        );
        let distance_term = (ds - dt) * self.ballot.distance_factor;
        let angle_term = angle_difference(arithmetic, source, target) * self.ballot.angle_factor;
        let squares = arithmetic.multiply_add(distance_term, distance_term, angle_term * angle_term);
        exp_of_negative(arithmetic, -squares)
    }
}

/// `|p_i - p_j|`
#[inline(always)]
fn edge<A: Arithmetic>(arithmetic: A, point: &[f64; 3], others: &[[f64; LANES]; 3], lane: usize) -> f64 {
    let [x, y, z] = [point[0] - others[0][lane], point[1] - others[1][lane], point[2] - others[2][lane]];
    arithmetic.multiply_add(x, x, arithmetic.multiply_add(y, y, z * z)).sqrt()
}

/// `cos e = (trace(L_i L_j^T) - 1) / 2`
#[inline(always)]
fn cosine<A: Arithmetic>(arithmetic: A, halved: &[f64; 9], others: &[[f64; LANES]; 9], lane: usize) -> f64 {
    let mut cosine = -0.5;
    for entry in 0..9 {
        cosine = arithmetic.multiply_add(halved[entry], others[entry][lane], cosine);
    }
    cosine.clamp(-1.0, 1.0)
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
