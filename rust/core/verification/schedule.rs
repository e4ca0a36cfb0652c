//! Reduces many poses to few: scores all coarsely, then refines and rescores the best.

use nalgebra::Point3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::points::Points;
use crate::verification::pose::Pose;
use crate::verification::refine::{Refinement, refine};
use crate::verification::score::{Round, score};
use crate::verification::surface::{Surface, look_at};

pub(super) const FIRST: Round =
    Round { samples: 300, tolerance: 8.0, in_front: 8.0, cosine: 0.7, coarse: true };
pub(super) const SECOND: Round =
    Round { samples: 1000, tolerance: 3.0, in_front: 4.0, cosine: 0.8, coarse: false };
pub(super) const LAST: Round =
    Round { samples: 2500, tolerance: 2.0, in_front: 3.0, cosine: 0.8, coarse: false };

const COARSELY: Refinement = Refinement { samples: 300, steps: 12, reach: (8.0, 4.0), coarse: true };
pub(super) const FINELY: Refinement =
    Refinement { samples: 1000, steps: 15, reach: (4.0, 2.5), coarse: false };

/// Poses kept after the first round, and after the second.
const KEPT: (usize, usize) = (150, 12);
/// Poses closer than this to a better one, in units, are removed: after the first round, and later.
const SAME: (f32, f32) = (10.0, 3.0);

/// Weight of the matches' evidence relative to the logarithm of the score, and the number of matches beyond
/// which more add no evidence.
const EVIDENCE: (f64, f64) = (0.1, 20.0);
/// Lower bound of scores: no agreement.
const LEAST_SCORE: f64 = 1e-6;
/// Two poses differ by more than this rotation in degrees, or this distance in units at the source's centre.
pub const DIFFERENT: (f32, f32) = (10.0, 20.0);

/// Matches that support a pose if it aligns their points.
#[derive(Debug)]
pub struct Evidence {
    /// Points of the source.
    pub source: Points,
    /// Points of the target, in the same order.
    pub target: Points,
    /// Largest distance, in the data's unit, of a match that supports a pose.
    pub tolerance: f64,
}

impl Evidence {
    fn check(&self) -> Result<()> {
        let (given, expected) = (self.target.len(), self.source.len());
        if given == expected {
            return Ok(());
        }
        let remedy = format!("give one target point per source point, here {expected}");
        Err(Error::invalid("matches", format!("{given} target points"), remedy))
    }

    fn count(&self, pose: &Rigid) -> usize {
        let (p, q) = (&self.source, &self.target);
        let shift = pose.rotation * p.center() + pose.translation - q.center();
        let near = |i: &usize| {
            let moved = Point3::from(pose.rotation * p.get(*i).coords + shift);
            (moved - q.get(*i)).norm_squared() < self.tolerance * self.tolerance
        };
        (0..p.len()).filter(near).count()
    }
}

/// A pose that passed all rounds.
#[derive(Debug, Clone)]
pub struct Verified {
    /// From the source's coordinates into the target's.
    pub pose: Rigid,
    /// Agreement minus violations, at most 2.
    pub score: f64,
    /// Number of matches that the pose aligns.
    pub evidence: usize,
    /// Ranking value: `ln score + 0.1 ln(1 + min(evidence, 20))`.
    pub value: f64,
}

/// A pose and its ranking value.
#[derive(Clone, Copy, Default)]
struct Ranked {
    pose: Pose,
    value: f64,
}

/// Scores the poses without refinement, by the measure of the last round.
///
/// # Errors
/// [`Error::InvalidInput`] unless both surfaces have one unit; [`Error::Interrupted`],
/// [`Error::OutOfMemory`].
pub fn score_poses(
    source: &Surface,
    target: &Surface,
    poses: &[Rigid],
    execution: &Execution,
) -> Result<Vec<f64>> {
    check_units(source, target)?;
    let poses = memory::collect(poses.iter().map(|pose| source.pose_onto(target, pose)))?;
    look_at(source, target, || {
        map(&poses, 0.0, execution, |pose| f64::from(score(source, target, pose, &LAST)))
    })
}

/// Returns the best of the poses, refined, best first; none lies within 3 units of a better one.
///
/// # Errors
/// [`Error::InvalidInput`] unless both surfaces have one unit and the evidence has as many source as target
/// points, [`Error::Interrupted`], [`Error::OutOfMemory`].
pub fn verify(
    source: &Surface,
    target: &Surface,
    poses: &[Rigid],
    evidence: Option<&Evidence>,
    execution: &Execution,
) -> Result<Vec<Verified>> {
    check_units(source, target)?;
    evidence.map_or(Ok(()), Evidence::check)?;
    let poses = memory::collect(poses.iter().map(|pose| source.pose_onto(target, pose)))?;
    look_at(source, target, || verify_local(source, target, &poses, evidence, execution))
}

/// [`verify`] in the surfaces' own coordinates.
fn verify_local(
    source: &Surface,
    target: &Surface,
    poses: &[Pose],
    evidence: Option<&Evidence>,
    execution: &Execution,
) -> Result<Vec<Verified>> {
    let radius = source.radius().max(target.radius());
    let none = Ranked::default();
    let all = map(poses, none, execution, |pose| ranked_by_score(source, target, *pose, &FIRST))?;
    let best = take(&all, &suppress(&all, SAME.0, radius, KEPT.0)?)?;
    let refined = map(&best, none, execution, |pose| {
        ranked_by_score(source, target, refine(source, target, pose, &COARSELY), &SECOND)
    })?;
    let best = take(&refined, &suppress(&refined, SAME.1, radius, KEPT.1)?)?;
    let judged = map(&best, None, execution, |pose| {
        let pose = refine(source, target, pose, &FINELY);
        Some((pose, judge(source, target, &pose, evidence)))
    })?;
    let judged = memory::collect(judged.into_iter().flatten())?;
    let rank = |(pose, found): &(Pose, Verified)| Ranked { pose: *pose, value: found.value };
    let last = memory::collect(judged.iter().map(rank))?;
    memory::collect(suppress(&last, SAME.1, radius, KEPT.1)?.into_iter().map(|i| judged[i].1.clone()))
}

/// Difference between the first pose's value and that of the best pose that differs from it by more than 10
/// degrees or 20 units; infinite if there is none.
pub fn margin(source: &Surface, target: &Surface, found: &[Verified]) -> f64 {
    let Some(best) = found.first() else { return f64::INFINITY };
    let pose = |found: &Verified| source.pose_onto(target, &found.pose);
    let (first, (degrees, units)) = (pose(best), DIFFERENT);
    let differs = |other: &&Verified| {
        let other = pose(other);
        let turned = first.angle_to(&other) > degrees * std::f32::consts::PI / 180.0;
        turned || (first.translation - other.translation).norm() > units
    };
    found[1..].iter().find(differs).map_or(f64::INFINITY, |next| best.value - next.value)
}

fn judge(source: &Surface, target: &Surface, pose: &Pose, evidence: Option<&Evidence>) -> Verified {
    let score = f64::from(score(source, target, pose, &LAST));
    let pose = source.pose_in_data(target, pose);
    let evidence = evidence.map_or(0, |matches| matches.count(&pose));
    let (weight, most) = EVIDENCE;
    let value = score.max(LEAST_SCORE).ln() + weight * (1.0 + (evidence as f64).min(most)).ln();
    Verified { pose, score, evidence, value }
}

fn ranked_by_score(source: &Surface, target: &Surface, pose: Pose, round: &Round) -> Ranked {
    Ranked { pose, value: f64::from(score(source, target, &pose, round)) }
}

/// Computes a result for each pose, in parallel; `value` is a placeholder.
fn map<T: Send + Clone>(
    poses: &[Pose],
    value: T,
    execution: &Execution,
    by: impl Fn(&Pose) -> T + Sync,
) -> Result<Vec<T>> {
    let checked = |pose: &Pose| execution.check().map(|()| by(pose));
    memory::par_try_fill(value, poses.par_iter().with_max_len(16).map(checked))
}

/// Non-maximum suppression: the best `most` poses, without those within a distance of a better one; best
/// first, ties to the earlier.
fn suppress(poses: &[Ranked], within: f32, radius: f32, most: usize) -> Result<Vec<usize>> {
    let mut order = memory::collect((0..poses.len()).filter(|&i| poses[i].pose.is_finite()))?;
    order.sort_unstable_by(|&i, &j| poses[j].value.total_cmp(&poses[i].value).then(i.cmp(&j)));
    let mut kept = memory::with_capacity(most.min(order.len()))?;
    for i in order {
        if kept.len() == most {
            break;
        }
        if kept.iter().all(|&better: &usize| poses[better].pose.is_apart(&poses[i].pose, radius, within)) {
            kept.push(i);
        }
    }
    Ok(kept)
}

fn take(poses: &[Ranked], rows: &[usize]) -> Result<Vec<Pose>> {
    memory::collect(rows.iter().map(|&i| poses[i].pose))
}

pub(super) fn check_units(source: &Surface, target: &Surface) -> Result<()> {
    let (a, b) = (source.unit(), target.unit());
    if (a - b).abs() <= 1e-9 * a.max(b) {
        return Ok(());
    }
    let remedy = "make both surfaces with the same unit";
    Err(Error::invalid("source, target", format!("surfaces of unit {a} and {b}"), remedy))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn evidence_needs_equal_numbers_of_points() -> Result<()> {
        let side = |count: usize| Points::from_rows("matches", &vec![[0.0; 3]; count]);
        let check = |target| Ok(Evidence { source: side(2)?, target: side(target)?, tolerance: 1.0 }.check());
        assert_eq!(check(2)?, Ok(()));
        assert!(matches!(check(1)?, Err(Error::InvalidInput { what, .. }) if what == "matches"));
        Ok(())
    }
}
