//! How well two surfaces agree under a pose.

use crate::verification::pose::Pose;
use crate::verification::range_map::Sight;
use crate::verification::surface::{Element, Surface};

/// Weight of the squared distance beside that of the squared distance to the plane.
const ALONG: f32 = 0.15;
/// What a sample before the background of a scan counts against one before its surface.
const BACKGROUND: f32 = 0.3;
/// Cosine beyond which a sample faces the viewer, who should have seen it.
const FACING: f32 = 0.3;

/// What a round of scoring looks at. Lengths are in units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Round {
    pub samples: usize,
    /// Distance from which on a sample no longer agrees.
    pub tolerance: f32,
    /// How far before a scan's surface a sample violates what was seen.
    pub in_front: f32,
    /// Least cosine between normals that agree.
    pub cosine: f32,
    pub coarse: bool,
}

/// Agreement less violations, of both surfaces' samples on the other one: at most 2.
pub(super) fn score(source: &Surface, target: &Surface, pose: &Pose, round: &Round) -> f32 {
    one_way(source, target, pose, round) + one_way(target, source, &pose.inverse(), round)
}

fn one_way(from: &Surface, to: &Surface, pose: &Pose, round: &Round) -> f32 {
    let samples = from.samples(round.samples);
    let oriented = from.is_oriented() && to.is_oriented();
    let sum: f32 = samples.iter().map(|sample| one_sample(sample, to, pose, round, oriented)).sum();
    sum / samples.len() as f32
}

#[inline]
fn one_sample(sample: &Element, to: &Surface, pose: &Pose, round: &Round, oriented: bool) -> f32 {
    let place = pose.rotation * sample.point + pose.translation;
    if let Some(near) = to.nearest(&place, round.coarse) {
        let d = place - near.point;
        let plane = d.dot(&near.normal);
        let share = (plane * plane + ALONG * d.norm_squared()) / (round.tolerance * round.tolerance);
        if share < 1.0 && agree(sample, near, pose, oriented) > round.cosine {
            return 1.0 - share;
        }
        return 0.0;
    }
    match to.ranges().map(|ranges| ranges.look(&place, &(pose.rotation * sample.normal))) {
        Some(Sight::Surface { in_front }) if in_front > round.in_front => -1.0,
        Some(Sight::Background { facing }) if facing > FACING => -BACKGROUND,
        _ => 0.0,
    }
}

/// Cosine between the normals of a moved sample and of a point.
#[inline]
pub(super) fn agree(sample: &Element, near: &Element, pose: &Pose, oriented: bool) -> f32 {
    let cosine = (pose.rotation * sample.normal).dot(&near.normal);
    if oriented { cosine } else { cosine.abs() }
}
