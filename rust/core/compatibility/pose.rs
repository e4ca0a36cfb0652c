//! The pose of a correspondence's frames, and its residual at another correspondence (SI, Eq. (4)).

use nalgebra::Matrix3;

use crate::correspondences::Frame;
use crate::geometry::rigid::Rigid;
use crate::points::Points;

/// Pose of correspondence `i` from its two frames: `R = L'^T L`, `t = p' - R p`; frames have axes as rows.
pub fn pose_of(
    i: usize,
    source: &Points,
    target: &Points,
    source_frame: &Frame,
    target_frame: &Frame,
) -> Option<Rigid> {
    let rotation: Matrix3<f64> = target_frame.as_ref()?.transpose() * source_frame.as_ref()?;
    let translation = target.get(i).coords - rotation * source.get(i).coords;
    Some(Rigid { rotation, translation })
}

/// `v_G = |R p_j + t - p'_j|`, Eq. (4): residual of correspondence `j` under the pose.
#[inline]
pub fn residual(pose: &Rigid, j: usize, source: &Points, target: &Points) -> f64 {
    (pose.apply(&source.get(j)) - target.get(j)).norm()
}
