//! CV: distinctive correspondences vote for those whose distances and frames agree with theirs.
//!
//! The paper, section 3.1, Eq. (7) to (11) (after Yang, Xiao, Cao, PRL 2019):
//! `s_i = sum_j exp(-(|ds - dt| / delta_r)^2 - (|e(L_i, L_j) - e(L'_i, L'_j)| / delta_L)^2)` over the 200
//! correspondences with the best nearest-neighbour ratio. Cost O(n voters).

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use rayon::prelude::*;

use super::GroupingMethod;
use crate::compatibility::lrf_angle::angle_difference;
use crate::frames::Frames;
use crate::geometry::angle::atan2_by;
use crate::options::{POSITIVE, method};
use crate::rule::{Agreement, Kind, Rule};
use crate::selection::otsu::{Cut, OtsuMode, Threshold};
use crate::selection::top_k::smallest;
use crate::simd::arithmetic::{Arithmetic, exp_of_negative};
use crate::simd::{self, DOUBLES, Kernel, Lanes};
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};

method! {
    /// Parameters of consistency voting.
    pub struct ConsistencyVoting = "cv", ["source", "target", "ratio", "source_lrf", "target_lrf"],
        optional ["resolution"], {
        /// Distance difference at which a vote falls to 1/e (`delta_r`), a length; default `10 * resolution`.
        pub distance_scale: Option<f64> = None;
        /// Difference of frame angles at which a vote falls to 1/e (`delta_L`), in degrees.
        pub angle_scale: f64 = 10.0, POSITIVE;
        /// Number of voters: the correspondences with the lowest ratios.
        pub voters: usize = 200;
        /// Exclude the vote of a voter for itself.
        pub exclude_self: bool = false;
        /// Scores above this are selected.
        pub threshold: Threshold = Threshold::Otsu;
        /// Candidates of Otsu's threshold: 100 equal bins between the least and the greatest score; every gap
        /// between scores; as in the code of SI's author, for scores from 0 to 1; or as in the evaluation
        /// group's later code.
        pub otsu: OtsuMode = OtsuMode::default();
    }
}

impl GroupingMethod for ConsistencyVoting {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("cv")?;
        let (source_frames, target_frames) = correspondences.frames("cv")?;
        let ratio = correspondences.ratio("cv")?;
        let distance_scale = correspondences.length("distance_scale", self.distance_scale, 10.0)?;
        let angle_scale = self.angle_scale.to_radians();
        let matches = Matches { source, target, source_frames, target_frames };

        let voters = smallest(ratio, self.voters)?; // V: top k by 1 - d1/d2
        let ballot = Ballot::new(&matches, &voters, distance_scale, angle_scale)?;
        let scores = self.count_votes(&matches, &ballot, execution)?; // s_i = sum_j D_ij, Eq. (11)
        let Cut { mask, threshold } = self.threshold.above(&scores, self.otsu)?; // s_i > t_cv
        let rule = Rule::new(Kind::Score).agreeing(Agreement::difference(distance_scale));
        Ok(Grouping { mask, scores: Some(scores), threshold, ..Grouping::default() }.by(rule))
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
        memory::par_try_collect((0..matches.source.len()).into_par_iter().with_min_len(16).map(votes_on))
    }
}

struct Matches<'a> {
    source: &'a Points,
    target: &'a Points,
    source_frames: &'a Frames,
    target_frames: &'a Frames,
}

impl Matches<'_> {
    /// Terms of the votes for or by `i`; `None` if a frame is missing.
    fn terms(&self, i: usize) -> Option<Terms<f64>> {
        Some(Terms {
            points: [self.source.get(i).into(), self.target.get(i).into()],
            frames: [self.source_frames.block(i)?, self.target_frames.block(i)?],
        })
    }
}

/// Point and frame of both sides, source first: of one correspondence, or of each voter of a block.
#[derive(Clone, Copy)]
struct Terms<T> {
    points: [[T; 3]; 2],
    frames: [[T; 9]; 2],
}

/// Voters per block: whole registers, and the default number of voters fills whole blocks.
const VOTER_BLOCK: usize = 40;

type Block = Terms<[f64; VOTER_BLOCK]>;

impl Block {
    /// Voters at infinity in the source alone: their votes are 0.
    const NO_VOTERS: Self = Self {
        points: [[[f64::INFINITY; VOTER_BLOCK]; 3], [[0.0; VOTER_BLOCK]; 3]],
        frames: [[[0.0; VOTER_BLOCK]; 9]; 2],
    };

    fn of(voters: &[(usize, Terms<f64>)]) -> Self {
        let mut block = Self::NO_VOTERS;
        for (j, (_, voter)) in voters.iter().enumerate() {
            for side in 0..2 {
                (0..3).for_each(|axis| block.points[side][axis][j] = voter.points[side][axis]);
                (0..9).for_each(|entry| block.frames[side][entry][j] = voter.frames[side][entry]);
            }
        }
        block
    }
}

/// The voters that have frames.
struct Ballot {
    voters: Vec<usize>,
    blocks: Vec<Block>,
    /// `1 / delta_r`
    distance_factor: f64,
    /// `1 / delta_L`, `delta_L` in radians.
    angle_factor: f64,
}

impl Ballot {
    fn new(matches: &Matches, voters: &[usize], distance_scale: f64, angle_scale: f64) -> Result<Self> {
        let framed = memory::collect(voters.iter().filter_map(|&j| Some((j, matches.terms(j)?))))?;
        Ok(Self {
            voters: memory::collect(framed.iter().map(|(j, _)| *j))?,
            blocks: memory::collect(framed.chunks(VOTER_BLOCK).map(Block::of))?,
            // Finite, so that a difference of 0 stays 0.
            distance_factor: distance_scale.recip().min(f64::MAX),
            angle_factor: angle_scale.recip().min(f64::MAX),
        })
    }

    /// `sum_j D_ij`, without the vote of the voter of number `left_out`.
    fn votes_on(&self, candidate: Terms<f64>, left_out: Option<usize>) -> f64 {
        simd::run(VotesOn { ballot: self, candidate, left_out })
    }
}

struct VotesOn<'a> {
    ballot: &'a Ballot,
    candidate: Terms<f64>,
    left_out: Option<usize>,
}

impl Kernel for VotesOn<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(mut self, lanes: L) -> f64 {
        self.candidate.frames.as_flattened_mut().iter_mut().for_each(|entry| *entry *= 0.5);
        let mut sums = [0.0; DOUBLES];
        for (number, block) in self.ballot.blocks.iter().enumerate() {
            let mut votes = self.votes(lanes, block);
            match self.left_out {
                Some(voter) if voter / VOTER_BLOCK == number => votes[voter % VOTER_BLOCK] = 0.0,
                _ => {}
            }
            for j in 0..VOTER_BLOCK {
                sums[j % DOUBLES] += votes[j];
            }
        }
        sums.iter().sum()
    }
}

impl VotesOn<'_> {
    /// `D_ij = exp(-(|ds - dt| / delta_r)^2 - (|e - e'| / delta_L)^2)` of each voter. Split into short loops:
    /// the processor overlaps the iterations of short loops only.
    #[inline(always)]
    fn votes<A: Arithmetic>(&self, arithmetic: A, block: &Block) -> [f64; VOTER_BLOCK] {
        let Terms { points, frames } = &self.candidate;
        let mut exponents = [0.0; VOTER_BLOCK];
        for (j, exponent) in exponents.iter_mut().enumerate() {
            let ds = edge(arithmetic, &points[0], &block.points[0], j);
            let dt = edge(arithmetic, &points[1], &block.points[1], j);
            let term = (ds - dt) * self.ballot.distance_factor; // r(c_i, c_j) / delta_r, Eq. (7)
            *exponent = -(term * term);
        }
        let mut cosines = [[0.0; VOTER_BLOCK]; 2];
        for side in 0..2 {
            for (j, cosine) in cosines[side].iter_mut().enumerate() {
                *cosine = cosine_between(arithmetic, &frames[side], &block.frames[side], j);
            }
        }
        let [mut sine, mut cosine] = [[0.0; VOTER_BLOCK]; 2]; // of the difference of the angles
        for j in 0..VOTER_BLOCK {
            [sine[j], cosine[j]] = angle_difference(arithmetic, [cosines[0][j], cosines[1][j]]);
        }
        for j in 0..VOTER_BLOCK {
            let term = atan2_by(arithmetic, sine[j], cosine[j]) * self.ballot.angle_factor;
            exponents[j] -= term * term; // L(c_i, c_j) / delta_L, Eq. (8)
        }
        let mut votes = [0.0; VOTER_BLOCK];
        for j in 0..VOTER_BLOCK {
            votes[j] = exp_of_negative(arithmetic, exponents[j]); // D(c_i, c_j), Eq. (10)
        }
        votes
    }
}

/// `|p_i - p_j|`
#[inline(always)]
fn edge<A: Arithmetic>(arithmetic: A, point: &[f64; 3], others: &[[f64; VOTER_BLOCK]; 3], j: usize) -> f64 {
    let [x, y, z] = [point[0] - others[0][j], point[1] - others[1][j], point[2] - others[2][j]];
    arithmetic.multiply_add(x, x, arithmetic.multiply_add(y, y, z * z)).sqrt()
}

/// `cos e = (trace(L_i L_j^T) - 1) / 2`, Eq. (9), with the entries of `L_i` halved.
#[inline(always)]
fn cosine_between<A: Arithmetic>(
    arithmetic: A,
    halved: &[f64; 9],
    others: &[[f64; VOTER_BLOCK]; 9],
    j: usize,
) -> f64 {
    let mut cosine = -0.5;
    for entry in 0..9 {
        cosine = arithmetic.multiply_add(halved[entry], others[entry][j], cosine);
    }
    cosine.clamp(-1.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Frame;
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
    fn the_own_vote_can_be_excluded() -> Result<()> {
        let method = ConsistencyVoting { voters: 1, exclude_self: true, ..ConsistencyVoting::default() };
        let scores = method.group(&problem()?, &Execution::default())?.scores.unwrap_or_default();
        assert!(scores[0].abs() < 1e-15);
        Ok(())
    }

    /// Random points and frames; every fifth frame is missing.
    fn clutter(n: usize) -> Result<Correspondences> {
        let number = |i: usize, k: usize| 30.0 * ((i * 37 + k * 101) as f64).sin();
        let rows =
            |side: usize| (0..n).map(|i| [0, 1, 2].map(|k| number(i, 3 * side + k))).collect::<Vec<_>>();
        let frame = |i: usize, side: usize| {
            let axis = Vector3::new(number(i, 7 + side), number(i, 9), number(i, 11 + side));
            (i % 5 != side).then(|| Rotation3::new(axis).into_inner())
        };
        let frames = |side: usize| (0..n).map(|i| frame(i, side)).collect::<Vec<Frame>>();
        Correspondences::new(&rows(0), &rows(1))?
            .with_ratio((0..n).map(|i| 0.5 + number(i, 13) / 60.0).collect())?
            .with_frames(frames(0), frames(1))
    }

    /// `D_ij` as in the paper.
    fn vote(input: &Correspondences, method: &ConsistencyVoting, i: usize, j: usize) -> Result<f64> {
        let (source, target) = input.positions("cv")?;
        let (source_frames, target_frames) = input.frames("cv")?;
        let angle = |frames: &Frames| {
            let cosine = (frames.get(i)?.dot(&frames.get(j)?) - 1.0) / 2.0;
            Some(cosine.clamp(-1.0, 1.0).acos().to_degrees())
        };
        let (Some(source_angle), Some(target_angle)) = (angle(source_frames), angle(target_frames)) else {
            return Ok(0.0);
        };
        let distance = (source.distance(i, j) - target.distance(i, j)) / method.distance_scale.unwrap_or(1.0);
        let angle = (source_angle - target_angle) / method.angle_scale;
        Ok((-distance.powi(2) - angle.powi(2)).exp())
    }

    #[test]
    fn votes_equal_the_plain_formula() -> Result<()> {
        for (n, voters, exclude_self) in [(1, 1, false), (97, 41, true), (130, 200, false), (130, 80, true)] {
            let input = clutter(n)?;
            let method = ConsistencyVoting {
                distance_scale: Some(20.0),
                angle_scale: 45.0,
                voters,
                exclude_self,
                ..ConsistencyVoting::default()
            };
            let scores = method.group(&input, &Execution::default())?.scores.unwrap_or_default();
            for (i, score) in scores.iter().enumerate() {
                let mut expected = 0.0;
                for j in smallest(input.ratio("cv")?, voters)? {
                    if !(exclude_self && i == j) {
                        expected += vote(&input, &method, i, j)?;
                    }
                }
                assert!((score - expected).abs() <= 1e-12 * expected.max(1e-3), "{i}: {score} {expected}");
            }
        }
        Ok(())
    }

    #[test]
    fn extreme_scales_give_votes_of_one_or_zero() -> Result<()> {
        let mut input = clutter(60)?;
        input =
            Correspondences::between(input.positions("cv")?.0.copied()?, input.positions("cv")?.0.copied()?)?
                .with_ratio(vec![0.5; 60])?
                .with_frames(vec![Some(Matrix3::identity()); 60], vec![Some(Matrix3::identity()); 60])?;
        for scale in [5e-324, 1e-300, 1e300] {
            let method =
                ConsistencyVoting { distance_scale: Some(scale), angle_scale: scale, ..Default::default() };
            let scores = method.group(&input, &Execution::default())?.scores.unwrap_or_default();
            assert!(scores.iter().all(|score| (score - 60.0).abs() < 1e-9), "{scale}: {scores:?}");
        }
        Ok(())
    }
}
