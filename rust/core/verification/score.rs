//! Score of the agreement of two surfaces under a pose.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]
#![expect(clippy::needless_bitwise_bool, reason = "without branches all lanes are computed at once")]

use crate::simd;
use crate::verification::group::{Group, LANES};
use crate::verification::pose::Pose;
use crate::verification::surface::Surface;

/// Weight of the squared distance relative to the squared distance to the plane.
pub(super) const ALONG: f32 = 0.15;
/// Weight of a sample in front of a scan's background, relative to one in front of its surface.
const BACKGROUND: f32 = 0.3;
/// Least cosine between a sample's normal and the direction to a viewer that should have observed it.
pub(super) const FACING: f32 = 0.3;

/// Parameters of a round of scoring. Lengths are in units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Round {
    pub samples: usize,
    /// Distance at which the agreement of a sample reaches zero.
    pub tolerance: f32,
    /// Least distance of a sample in front of the other surface that counts as a free-space violation.
    pub in_front: f32,
    /// Least cosine between normals that agree.
    pub cosine: f32,
    pub coarse: bool,
}

/// Agreement minus free-space violations of both surfaces' samples on the other surface: at most 2.
pub(super) fn score(source: &Surface, target: &Surface, pose: &Pose, round: &Round) -> f32 {
    one_way(source, target, pose, round) + one_way(target, source, &pose.inverse(), round)
}

fn one_way(from: &Surface, to: &Surface, pose: &Pose, round: &Round) -> f32 {
    let (groups, count) = from.samples(round.samples);
    let oriented = from.is_oriented() && to.is_oriented();
    let mut sum = 0.0;
    simd::run(
        #[inline(always)]
        || {
            for (number, group) in groups.iter().enumerate() {
                let values = values(&group.moved(pose), to, round, oriented);
                // Summed in order, so that the sum is the same on every machine.
                for value in &values[..(count - number * LANES).min(LANES)] {
                    sum += value;
                }
            }
        },
    );
    sum / count as f32
}

/// Value of each of the moved samples.
#[inline(always)]
fn values(samples: &Group, to: &Surface, round: &Round, oriented: bool) -> [f32; LANES] {
    let (is_near, near) = to.nearest(&samples.point, round.coarse);
    let squared_tolerance = round.tolerance * round.tolerance;
    let mut values = [0.0; LANES];
    for lane in 0..LANES {
        let [dx, dy, dz] = samples.offset(&near, lane);
        let plane = dx * near.normal[0][lane] + dy * near.normal[1][lane] + dz * near.normal[2][lane];
        let share = (plane * plane + ALONG * (dx * dx + dy * dy + dz * dz)) / squared_tolerance;
        let agrees = is_near[lane] & (share < 1.0) & (samples.cosine(&near, oriented, lane) > round.cosine);
        values[lane] = if agrees { 1.0 - share } else { 0.0 };
    }
    if let Some(ranges) = to.ranges()
        && is_near.contains(&false)
    {
        let sights = ranges.look(samples);
        for lane in 0..LANES {
            let violation = violation(sights.in_front[lane], sights.facing[lane], round);
            values[lane] = if is_near[lane] { values[lane] } else { violation };
        }
    }
    values
}

/// Free-space violation of a sample without a near point of the surface.
#[inline(always)]
fn violation(in_front: f32, facing: f32, round: &Round) -> f32 {
    let background = if facing > FACING { -BACKGROUND } else { 0.0 };
    let surface = if in_front > round.in_front { -1.0 } else { 0.0 };
    if in_front == f32::INFINITY { background } else { surface }
}
