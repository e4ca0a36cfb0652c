//! TOLDI's local reference frame (Yang, Zhang, Xiao, Cao, Pattern Recognition 2017), and its variant for RCS.
//!
//! z is the normal of a plane fitted to a smaller ball, oriented away from most of it; x is a sum of the
//! neighbours' projections on the tangent plane, weighted by proximity and height.

use nalgebra::{Matrix3, Vector3};

use crate::cloud::Cloud;
use crate::correspondences::Frame;
use crate::error::Result;
use crate::execution::Execution;
use crate::features::keypoints::locations;
use crate::features::normals::fit;
use crate::geometry::ball_search::Ball;

/// Fewest points within the smaller ball and within the whole one.
const MIN_INNER_POINTS: usize = 4;
const MIN_POINTS: usize = 11;
/// Heights below this share of the radius are rounding errors: a plane has no x axis.
const FLAT: f64 = 1e-9;

/// Parameters that differ between TOLDI's frame and that of RCS.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Recipe {
    /// Radius of the ball for z, as a share of the support radius.
    pub inner_share: f64,
    /// Whether neighbours below the tangent plane count negatively in x.
    pub is_signed: bool,
}

/// TOLDI's parameters.
const TOLDI: Recipe = Recipe { inner_share: 1.0 / 3.0, is_signed: false };

/// Frames at the keypoints, rows x, y, z; `None` with fewer than 4 points within a third of `radius` or 11
/// within all of it (the keypoint included), and on planes. Cost O(m k).
///
/// # Errors
/// [`crate::Error::InvalidInput`] for a radius that is not positive, or an index out of range;
/// [`crate::Error::Interrupted`].
pub fn toldi_frames(
    cloud: &Cloud,
    keypoints: &[usize],
    radius: f64,
    execution: &Execution,
) -> Result<Vec<Frame>> {
    let centers = locations(cloud.points(), keypoints)?;
    cloud.balls(radius)?.map_at(&centers, None, execution, |_, ball| Ok(frame(ball, radius, TOLDI)))
}

/// The frame of one neighbourhood.
pub(super) fn frame(ball: &Ball, radius: f64, recipe: Recipe) -> Frame {
    let z = normal(ball, radius * recipe.inner_share)?;
    if ball.len() < MIN_POINTS {
        return None;
    }
    let mut sum = Vector3::zeros();
    let mut highest: f64 = 0.0;
    for (offset, square) in ball.offsets().iter().zip(ball.squared_distances()) {
        let offset = Vector3::from(*offset);
        let height = z.dot(&offset);
        highest = highest.max(height.abs());
        let nearness = radius - square.sqrt();
        let sign = if recipe.is_signed { height.signum() } else { 1.0 };
        sum += (offset - z * height) * (nearness * nearness * height * height * sign);
    }
    // Projected again to remove the rounding error along z.
    let x = (sum - z * z.dot(&sum)).try_normalize(0.0)?;
    (highest > FLAT * radius)
        .then(|| Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()]))
}

/// Unit normal of the plane through the points nearer than `radius`, oriented away from most of them.
fn normal(ball: &Ball, radius: f64) -> Option<Vector3<f64>> {
    let limit = radius * radius;
    let inner = || {
        let all = ball.offsets().iter().zip(ball.squared_distances());
        all.filter(move |&(_, &square)| square < limit).map(|(&offset, _)| Vector3::from(offset))
    };
    if inner().count() < MIN_INNER_POINTS {
        return None;
    }
    let z = fit(inner(), false).normal;
    let side = z.dot(&inner().sum::<Vector3<f64>>());
    z.x.is_finite().then_some(if side > 0.0 { -z } else { z })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dome that is higher towards +x.
    fn dome() -> Vec<[f64; 3]> {
        let mut rows = vec![[0.0; 3]];
        for i in 0..21 {
            for j in 0..21 {
                let (u, v) = (f64::from(i) / 10.0 - 0.98, f64::from(j) / 10.0 - 1.0);
                rows.push([u, v, -0.3 * (u * u + v * v) - 0.2 * u * u * u.max(0.0)]);
            }
        }
        rows
    }

    #[test]
    fn axes_of_a_lopsided_dome() -> Result<()> {
        let cloud = Cloud::from_rows("points", &dome())?;
        let frames = toldi_frames(&cloud, &[0], 1.0, &Execution::default())?;
        let axes = frames[0].unwrap_or_default();
        assert!((axes * axes.transpose() - Matrix3::identity()).amax() < 1e-14);
        assert!((axes.determinant() - 1.0).abs() < 1e-14);
        assert!(axes[(2, 2)] > 0.99, "z away from the points: {axes}");
        assert!(axes[(0, 0)] > 0.95, "x towards the steeper side: {axes}");
        Ok(())
    }

    #[test]
    fn planes_and_small_balls_have_no_frame() -> Result<()> {
        let plane: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i % 10), f64::from(i / 10), 0.0]).collect();
        let cloud = Cloud::from_rows("points", &plane)?;
        assert_eq!(toldi_frames(&cloud, &[44, 0], 6.0, &Execution::default())?, [None, None]);
        let cloud = Cloud::from_rows("points", &dome()[..10])?;
        assert_eq!(toldi_frames(&cloud, &[0], 9.0, &Execution::default())?, [None]);
        Ok(())
    }
}
