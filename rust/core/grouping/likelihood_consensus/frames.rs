//! Local frames in LC: poses of stars, terms of the score, and the decision to use frames.
//!
//! A wrong frame is never a veto and costs a match little. But if most frames of correct matches are wrong,
//! those that agree mislead. The significant poses by position therefore decide: three in four of their
//! supporters must have frames that agree. If positions alone give no significant pose, frames are tried, and
//! their best pose is taken unless the best by position has far fewer false alarms.

use nalgebra::Matrix3;

use super::confidence::{Judge, MOST_FALSE_ALARMS};
use super::{Answer, DEVIATION, Joined, Problem, Ranked};
use crate::consensus::likelihood::levels::cluster_sizes;
use crate::consensus::likelihood::{FrameTerm, Likelihood};
use crate::consensus::stars::{FRAME_ANGLE, FRAME_DEVIATION, Stars};
use crate::geometry::rigid::Rigid;
use crate::{Correspondences, Result, memory};

/// Frames are used if at least this share of the supporters' frames agree with the pose.
const LEAST_SHARE: f64 = 0.75;

/// Share of correct frames without a significant pose, and upper bound of the share: some are always wrong.
const UNKNOWN_SHARE: f64 = 0.5;
const GREATEST_SHARE: f64 = 0.9;

/// Factor of fewer false alarms that the best pose by position needs to win against frames that are only
/// tried.
const ADVANTAGE: f64 = 100.0;

/// Likelihood ratio of agreement between frames of correct and of wrong matches, under a pose that aligns
/// surfaces.
const LIKELIHOOD_RATIO: f64 = 40.0;

/// Radius, in units of the tolerance, within which matches are wrong together.
const CLUSTER: f64 = 5.0;

/// `L'^T L` of each match that has both frames; `None` if none has.
pub fn proposed_rotations(correspondences: &Correspondences) -> Result<Option<Vec<Option<Matrix3<f64>>>>> {
    let Ok((source, target)) = correspondences.frames("lc") else {
        return Ok(None);
    };
    let rotation = |i: usize| Some(target.get(i)?.transpose() * source.get(i)?);
    let rotations = memory::collect((0..source.len()).map(rotation))?;
    Ok(rotations.iter().any(Option::is_some).then_some(rotations))
}

/// Whether frames propose the rotation of a pose, up to 30 degrees.
fn agrees(rotation: &Matrix3<f64>, pose: &Rigid) -> bool {
    rotation.dot(&pose.rotation) > 1.0 + 2.0 * FRAME_ANGLE.cos()
}

/// The answer with frames; `None` if the one by position stays.
pub fn with_frames(
    judge: &Judge,
    by_position: &Answer,
    rotations: &[Option<Matrix3<f64>>],
    joined: &Joined,
    cliques: &[Rigid],
) -> Result<Option<Answer>> {
    let share = share(judge, &by_position.ranked, rotations)?;
    if share.is_some_and(|share| share < LEAST_SHARE) {
        return Ok(None);
    }
    let problem = judge.problem;
    let mut hypotheses = memory::copied(cliques)?;
    memory::extend(&mut hypotheses, &star_poses(problem, rotations, joined)?)?;
    let likelihood = weigh(problem, &by_position.likelihood, rotations, share.unwrap_or(UNKNOWN_SHARE))?;
    let by_frames = Answer { ranked: problem.rank(&likelihood, &hypotheses)?, likelihood, by_frames: true };
    let alarms =
        |answer: &Answer| answer.ranked.first().map(|best| judge.false_alarms(best, &[])).transpose();
    let is_worse = match (alarms(by_position)?, alarms(&by_frames)?) {
        (Some(before), Some(after)) => ADVANTAGE * before <= after,
        (before, _) => before.is_some(),
    };
    Ok((share.is_some() || !is_worse).then_some(by_frames))
}

/// Share of agreeing frames among the supporters of significant poses; `None` without such a pose.
fn share(judge: &Judge, ranked: &[Ranked], rotations: &[Option<Matrix3<f64>>]) -> Result<Option<f64>> {
    let (mut agreeing, mut framed) = (0_u32, 0_u32);
    for one in ranked {
        if judge.false_alarms(one, &[])? < MOST_FALSE_ALARMS {
            let supporters = judge.problem.group(&judge.likelihood.squared_residuals(&one.mode.pose)?)?;
            for rotation in supporters.iter().filter_map(|&i| rotations[i].as_ref()) {
                agreeing += u32::from(agrees(rotation, &one.mode.pose));
                framed += 1;
            }
        }
    }
    Ok((framed > 0).then(|| f64::from(agreeing) / f64::from(framed)))
}

/// The motions of stars of frames.
fn star_poses(problem: &Problem, rotations: &[Option<Matrix3<f64>>], joined: &Joined) -> Result<Vec<Rigid>> {
    let stars = Stars {
        source: problem.source,
        target: problem.target,
        rotations,
        graph: &joined.graph,
        vertices: &joined.vertices,
        tolerance: problem.tolerance,
        deviation: DEVIATION * problem.tolerance,
    };
    stars.poses(problem.execution)
}

/// The likelihood with frames, of which `share` are correct, and with weights 1 / c for clusters of size c.
fn weigh(
    problem: &Problem,
    likelihood: &Likelihood,
    rotations: &[Option<Matrix3<f64>>],
    share: f64,
) -> Result<Likelihood> {
    let share = share.min(GREATEST_SHARE);
    let term = FrameTerm {
        gain: (1.0 - share + share * LIKELIHOOD_RATIO).ln(),
        loss: (1.0 - share).ln(),
        deviation: FRAME_DEVIATION,
    };
    let Problem { source, target, tolerance, execution, .. } = *problem;
    let mut weights = cluster_sizes(source, target, CLUSTER * tolerance, tolerance, execution)?;
    weights.iter_mut().for_each(|size| *size = size.recip());
    likelihood.copied()?.with_frames(rotations, &weights, term)
}
