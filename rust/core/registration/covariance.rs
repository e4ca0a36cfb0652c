//! The covariance of a refined pose, and the motions that the surfaces leave open.

use nalgebra::{Matrix6, Vector6};

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::pose_graph::motion::{compose, inverse};
use crate::verification::{Alignment, DIFFERENT, align, scatter_of_blocks};

use super::level::{FinePair, Pair};
use super::motions::{Resisted, about, motion_of, moved};
use super::settings::{
    ALIKE, DISPLACED, INDEPENDENT, LEAST_DEVIATION, LEAST_RESISTANCE, LEFT, NOT_PULLED_BACK, OPEN,
    PULLING_ROUNDS, PULLING_SAMPLES, SCATTER, UNIT,
};

/// Returns the resistance of the surfaces to motions of the source under a pose.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn resisted(pair: Pair<'_>, found: &Alignment) -> Result<Resisted> {
    let pose = &found.pose;
    let points = pair.source.points().iter().map(|point| pose.rotation * point + pose.translation);
    Resisted::new(&found.resistance.information, points)
}

/// Counts the motions that the surfaces leave open: 3 for a plane, 1 for a corridor.
///
/// A motion is open if the surfaces hardly resist it, and if refining does not undo a displacement of a voxel along it. Normals of
/// a rough plane seem to resist it but do not pull the pose back; a shallow relief does.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn count_open_motions(
    pair: Pair<'_>,
    fine: FinePair<'_>,
    found: &Alignment,
    resisted: &Resisted,
    execution: &Execution,
) -> Result<usize> {
    let mut count = 0;
    for (motion, _) in resisted.motions.iter().zip(resisted.values).filter(|&(_, value)| value <= OPEN) {
        let how = (PULLING_SAMPLES.1, PULLING_ROUNDS.1);
        let left = displace(fine, &found.pose, resisted, motion, pair.voxel(), how, execution)?;
        count += usize::from(share_left(&left, resisted, pair.voxel()) >= NOT_PULLED_BACK);
    }
    Ok(count)
}

/// Returns the covariance of the small motion of the origin of the target's frame that maps a refined pose to the true one.
///
/// `(s^2 + (0.01 v)^2) (W / 5000 + 0.75) H^-1 + 0.03 sum_k x_k x_k^T + 3 S`: s the root mean square of the residuals, v the voxel, H
/// and W the matrix and the weight of a point-to-plane step, `x_k` the remainder of a displacement by a voxel, to either side along
/// each eigenvector of H, after refining again (after M. Brossard, S. Bonnabel, A. Barrau, *A new approach to 3D ICP covariance
/// estimation*, RA-L 2020), S the scatter of blocks as large as the median distance of the points from their middle
/// ([`scatter_of_blocks`]). Along an open motion the pose may lie anywhere within 8 voxels; farther poses are its rivals.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn covariance_of(
    pair: Pair<'_>,
    fine: FinePair<'_>,
    found: &Alignment,
    execution: &Execution,
) -> Result<Matrix6<f64>> {
    let (voxel, resisted) = (pair.voxel(), resisted(pair, found)?);
    let squares = found.residuals.iter().map(|residual| residual * residual).sum::<f64>();
    let variance =
        if found.residuals.is_empty() { voxel * voxel } else { squares / found.residuals.len() as f64 };
    let noise = (variance + (LEAST_DEVIATION * voxel).powi(2))
        * (1.0 / INDEPENDENT + ALIKE / resisted.weight.max(1.0));
    let blocks = (&resisted.middle, resisted.radius);
    let mut covariance =
        SCATTER * scatter_of_blocks(fine.source, fine.target, &found.pose, blocks, execution)?;
    for (motion, value) in resisted.motions.iter().zip(resisted.values) {
        let how = (PULLING_SAMPLES.0, PULLING_ROUNDS.0);
        let left = displace(fine, &found.pose, &resisted, motion, voxel, how, execution)?;
        let is_open = value <= OPEN
            && share_left(&left, &resisted, voxel) >= NOT_PULLED_BACK
            && found.resistance.open_motion.is_some();
        let far = (f64::from(DIFFERENT.1) * UNIT * voxel).powi(2) / 3.0;
        let variance = noise / value.max(LEAST_RESISTANCE) + if is_open { far } else { 0.0 };
        covariance.ger(variance, motion, motion, 1.0);
        left.iter().for_each(|left| covariance.ger(LEFT, left, left, 1.0));
    }
    let change = about(&-resisted.middle);
    Ok(change * covariance * change.transpose())
}

/// Returns what refining leaves of displacements by a voxel along a motion to both sides.
fn displace(
    fine: FinePair<'_>,
    pose: &Rigid,
    resisted: &Resisted,
    motion: &Vector6<f64>,
    voxel: f64,
    (samples, rounds): (usize, usize),
    execution: &Execution,
) -> Result<[Vector6<f64>; 2]> {
    let back = inverse(pose);
    memory::try_map([1.0, -1.0], |sign: f64| {
        let mut displaced = moved(pose, &(motion * (sign * DISPLACED * voxel)), &resisted.middle);
        for _ in 0..rounds {
            displaced = align(fine.source, fine.target, &displaced, samples, execution)?.pose;
        }
        Ok(motion_of(&compose(&displaced, &back), &resisted.middle))
    })
}

/// Returns the remaining share of a displacement, averaged over both sides.
fn share_left(left: &[Vector6<f64>; 2], resisted: &Resisted, voxel: f64) -> f64 {
    left.iter().map(|left| resisted.length(left)).sum::<f64>() / (2.0 * DISPLACED * voxel)
}
