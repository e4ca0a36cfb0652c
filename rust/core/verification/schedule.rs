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

const COARSELY: Refinement =
    Refinement { samples: 300, steps: 12, reach: (8.0, 4.0), still: 1e-5, coarse: true };
pub(super) const FINELY: Refinement =
    Refinement { samples: 1000, steps: 15, reach: (4.0, 2.5), still: 1e-5, coarse: false };

/// A stage refines poses, scores them, removes those closer to a better one than a distance in units, and keeps the best.
struct Stage {
    refinement: Option<Refinement>,
    round: Round,
    /// Weight of the logarithm of the number of matches that the pose aligns, beside the score.
    support: f64,
    apart: f32,
    kept: usize,
}

/// Stages of [`verify`] before the last, which refines and judges.
const VERIFIED: [Stage; 2] = [
    Stage { refinement: None, round: FIRST, support: 0.0, apart: 10.0, kept: 150 },
    Stage { refinement: Some(COARSELY), round: SECOND, support: 0.0, apart: LAST_APART, kept: MOST_VERIFIED },
];
/// Stages of [`race`], with the kept poses given: many poses are seen with few samples, few poses with many.
const RACED: [Stage; 3] = [
    Stage { refinement: None, round: Round { samples: 96, ..FIRST }, support: 0.0, apart: 10.0, kept: 0 },
    Stage {
        refinement: Some(Refinement { samples: 128, steps: 3, still: STILL, ..COARSELY }),
        round: Round { samples: 160, ..FIRST },
        support: 0.1,
        apart: 5.0,
        kept: 0,
    },
    Stage {
        refinement: Some(Refinement { samples: 304, steps: 6, still: STILL, ..COARSELY }),
        round: Round { samples: 512, ..SECOND },
        support: 0.1,
        apart: LAST_APART,
        kept: 0,
    },
];
const LAST_RACED: Refinement = Refinement { samples: 640, steps: 12, still: STILL, ..FINELY };
/// Motion that ends the refinement of a raced pose, in radians and units.
const STILL: f64 = 1e-3;
/// Most poses returned, and their least distance, in units.
const MOST_VERIFIED: usize = 12;
const LAST_APART: f32 = 3.0;

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
    look_at(source, target, || run((source, target), poses, (&VERIFIED, &FINELY), evidence, execution))
}

/// Returns nearly what [`verify`] does, several times as fast: poses with low scores are dropped after few samples.
///
/// `kept` are the most poses after each of three stages; about (150, 40, 10) for poses of single matches.
///
/// # Errors
/// As for [`verify`].
pub fn race(
    source: &Surface,
    target: &Surface,
    poses: &[Rigid],
    evidence: &Evidence,
    kept: [usize; 3],
    execution: &Execution,
) -> Result<Vec<Verified>> {
    check_units(source, target)?;
    evidence.check()?;
    let mut stages = RACED;
    stages.iter_mut().zip(kept).for_each(|(stage, kept)| stage.kept = kept);
    let poses = memory::collect(poses.iter().map(|pose| source.pose_onto(target, pose)))?;
    look_at(source, target, || {
        run((source, target), poses, (&stages, &LAST_RACED), Some(evidence), execution)
    })
}

/// Runs the stages and the last refinement in the surfaces' own coordinates.
fn run(
    (source, target): (&Surface, &Surface),
    mut poses: Vec<Pose>,
    (stages, last): (&[Stage], &Refinement),
    evidence: Option<&Evidence>,
    execution: &Execution,
) -> Result<Vec<Verified>> {
    let radius = source.radius().max(target.radius());
    for Stage { refinement, round, support, apart, kept } in stages {
        let matches = evidence.filter(|_| *support > 0.0);
        let ranked = map(&poses, Ranked::default(), execution, |pose| {
            let pose = refinement.as_ref().map_or(*pose, |how| refine(source, target, pose, how));
            let logarithm = matches
                .map_or(0.0, |matches| logarithm_of(matches.count(&source.pose_in_data(target, &pose))));
            let value = f64::from(score(source, target, &pose, round)) + support * logarithm;
            Ranked { pose, value }
        })?;
        let rows = suppress(&ranked, *apart, radius, *kept)?;
        poses = memory::collect(rows.iter().map(|&row| ranked[row].pose))?;
    }
    let judged = map(&poses, None, execution, |pose| {
        let pose = refine(source, target, pose, last);
        Some((pose, judge(source, target, &pose, evidence)))
    })?;
    let judged = memory::collect(judged.into_iter().flatten())?;
    let rank = |(pose, found): &(Pose, Verified)| Ranked { pose: *pose, value: found.value };
    let ranked = memory::collect(judged.iter().map(rank))?;
    let rows = suppress(&ranked, LAST_APART, radius, MOST_VERIFIED)?;
    memory::collect(rows.into_iter().map(|row| judged[row].1.clone()))
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
    let value = score.max(LEAST_SCORE).ln() + EVIDENCE.0 * logarithm_of(evidence);
    Verified { pose, score, evidence, value }
}

fn logarithm_of(evidence: usize) -> f64 {
    (1.0 + (evidence as f64).min(EVIDENCE.1)).ln()
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
    use nalgebra::{Rotation3, Vector3};

    use super::*;
    use crate::verification::surface::Side;

    /// A wavy height field of 40 x 40 points, 1 apart, moved by a pose.
    fn waves(pose: &Rigid) -> Result<(Points, Surface)> {
        let height = |x: f64, y: f64| 4.0 * (0.31 * x).sin() * (0.23 * y).cos() + (0.011 * x * y).sin();
        let place = |i: u32| (f64::from(i % 40), f64::from(i / 40));
        let row = |(x, y)| pose.apply(&[x, y, height(x, y)].into()).coords.into();
        let points = Points::from_rows("points", &(0..1600).map(place).map(row).collect::<Vec<_>>())?;
        let slope = |(x, y)| {
            let run = |dx: f64, dy: f64| height(x + dx, y + dy) - height(x - dx, y - dy);
            pose.rotation * Vector3::new(-run(0.01, 0.0) / 0.02, -run(0.0, 0.01) / 0.02, 1.0).normalize()
        };
        let normals: Vec<_> = (0..1600).map(place).map(slope).collect();
        let surface = Surface::new(&points, &normals, 0.4, Side::Known, &Execution::default())?;
        Ok((points, surface))
    }

    #[test]
    fn a_race_is_won_by_the_verified_pose() -> Result<()> {
        let turn = |angle: f64| Rotation3::new(Vector3::new(0.3, 0.2, 0.9) * angle).into_inner();
        let away = Rigid { rotation: turn(0.7), translation: Vector3::new(5.0, -7.0, 11.0) };
        let ((source_points, source), (target_points, target)) = (waves(&Rigid::identity())?, waves(&away)?);
        let proposal = |i: i32| {
            let shift = Vector3::new(f64::from(i % 11), f64::from(i / 11), 1.0) * 2.0;
            Rigid { rotation: turn(0.7 + 0.02 * f64::from(i % 5)), translation: away.translation + shift }
        };
        let mut poses: Vec<_> = (0..121).map(proposal).collect();
        poses.push(Rigid { rotation: turn(0.72), translation: away.translation.add_scalar(0.2) });
        let (run, kept) = (Execution::default(), [60, 20, 6]);
        let evidence = Evidence { source: source_points, target: target_points, tolerance: 1.0 };
        let verified = verify(&source, &target, &poses, Some(&evidence), &run)?;
        let raced = race(&source, &target, &poses, &evidence, kept, &run)?;
        assert!((1..=6).contains(&raced.len()));
        for found in [&verified[0], &raced[0]] {
            assert!((found.pose.rotation - away.rotation).amax() < 1e-3);
            assert!((found.pose.translation - away.translation).amax() < 0.05);
            assert_eq!(found.evidence, 1600);
        }
        assert!(race(&source, &target, &[], &evidence, kept, &run)?.is_empty());
        Ok(())
    }

    #[test]
    fn evidence_needs_equal_numbers_of_points() -> Result<()> {
        let side = |count: usize| Points::from_rows("matches", &vec![[0.0; 3]; count]);
        let check = |target| Ok(Evidence { source: side(2)?, target: side(target)?, tolerance: 1.0 }.check());
        assert_eq!(check(2)?, Ok(()));
        assert!(matches!(check(1)?, Err(Error::InvalidInput { what, .. }) if what == "matches"));
        Ok(())
    }
}
