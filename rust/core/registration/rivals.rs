//! Rivals of a pose: slides along weak motions, turns about the axes of the normals.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Vector3, Vector6};

use crate::error::Result;
use crate::geometry::rigid::Rigid;
use crate::geometry::symmetric::eigen;
use crate::memory;

use super::level::Pair;
use super::motions::{Resisted, moved, quantile};

/// Slides, in voxels: the first, the last, and the step between them.
const FIRST: f64 = 10.0;
const LAST: f64 = 62.0;
const STEP: f64 = 4.0;
/// Quantiles of the coordinates whose mean is the second middle of turns.
const ENDS: [f64; 2] = [0.02, 0.98];

/// Proposes other poses of the source, to be verified.
///
/// Slides follow the two directions and the motion that the surfaces resist least (along a wall, about the axis of a gear), by
/// 10 to 62 times `voxel`. Turns are by quarters about the axes of the target's normals, through the middle of the source.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn propose_rivals(
    pair: Pair<'_>,
    pose: &Rigid,
    voxel: f64,
    resisted: &Resisted,
    slides: &Matrix3<f64>,
) -> Result<Vec<Rigid>> {
    let axes = eigen(slides).vectors;
    let along = |axis: Vector3<f64>| Vector6::new(0.0, 0.0, 0.0, axis.x, axis.y, axis.z);
    let weakest = [along(axes[0]), along(axes[1]), resisted.motions[0]];
    let mut poses = Vec::new();
    for motion in weakest {
        let mut slide = FIRST;
        while slide < LAST {
            for sign in [-1.0, 1.0] {
                let step = motion * (sign * slide * voxel);
                memory::push(&mut poses, moved(pose, &step, &resisted.middle))?;
            }
            slide += STEP;
        }
    }
    let mut scatter = Matrix3::zeros();
    for normal in pair.target.normals().iter().filter(|normal| normal.x.is_finite()) {
        scatter.ger(1.0, normal, normal, 1.0);
    }
    let axes = eigen(&scatter).vectors;
    let points = memory::collect(pair.source.points().iter().map(|p| pose.rotation * p + pose.translation))?;
    let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let mut between = Vector3::zeros();
    for axis in axes {
        let mut heights = memory::collect(points.iter().map(|point| point.dot(&axis)))?;
        between += axis * (ENDS.map(|share| quantile(&mut heights, share)).iter().sum::<f64>() / 2.0);
    }
    for axis in axes {
        for quarters in 1..4 {
            let turn = axis * (f64::from(quarters) * FRAC_PI_2);
            let motion = Vector6::new(turn.x, turn.y, turn.z, 0.0, 0.0, 0.0);
            memory::push(&mut poses, moved(pose, &motion, &mean))?;
            memory::push(&mut poses, moved(pose, &motion, &between))?;
        }
    }
    Ok(poses)
}
