//! SHOT's local reference frame (Tombari, Salti, Di Stefano, ECCV 2010), as PCL's
//! `SHOTLocalReferenceFrameEstimation`.
//!
//! Axes are the eigenvectors of the neighbourhood's scatter about the keypoint, weighted by proximity; x and
//! z are oriented towards most of the neighbours. Cost O(m k).

use nalgebra::{Matrix3, Point3, Vector3};

use crate::cloud::Cloud;
use crate::correspondences::Frame;
use crate::error::Result;
use crate::execution::Execution;
use crate::features::keypoints::locations;
use crate::features::normals::{add_products, symmetric};
use crate::geometry::ball_search::{Ball, BallSearch};
use crate::geometry::symmetric::eigen;
use crate::memory;

/// A ball with fewer neighbours, without points that coincide with the keypoint, has no frame.
const MIN_NEIGHBORS: usize = 5;

/// Share of the radius below which a point lies on the plane through the keypoint: rounding must not decide
/// its side.
const FLAT: f64 = 1e-9;

/// Frames at the keypoints, rows x, y, z; `None` with fewer than 5 neighbours within `radius`.
///
/// # Errors
/// [`crate::Error::InvalidInput`] for a radius that is not positive, or an index out of range;
/// [`crate::Error::Interrupted`].
pub fn shot_frames(
    cloud: &Cloud,
    keypoints: &[usize],
    radius: f64,
    execution: &Execution,
) -> Result<Vec<Frame>> {
    let centers = locations(cloud.points(), keypoints)?;
    let search = cloud.balls(radius)?;
    search.map_at(&centers, None, execution, |i, ball| frame(&centers[i], ball, &search))
}

/// The frame of the neighbourhood of a point.
pub(super) fn frame(center: &Point3<f64>, ball: &Ball, search: &BallSearch) -> Result<Frame> {
    let mut count = 0;
    let mut total = 0.0;
    let mut products = [0.0; 6];
    for (i, &square) in ball.squared_distances().iter().enumerate() {
        let weight = search.radius() - square.sqrt();
        let is_apart = square > 0.0;
        count += usize::from(is_apart);
        total += if is_apart { weight } else { 0.0 };
        // Points at the keypoint itself add nothing here.
        add_products(&mut products, &(ball.vector(i) * weight), &ball.vector(i));
    }
    if count < MIN_NEIGHBORS {
        return Ok(None);
    }
    // Axes without a majority are oriented towards the mean of the cloud.
    let axes = eigen(&(symmetric(&products) / total)).vectors;
    let axes = axes.map(|axis| if axis.dot(&center.coords) > 0.0 { -axis } else { axis });
    let z = towards_most(axes[0], ball, search, count)?;
    let x = towards_most(axes[2], ball, search, count)?;
    Ok(Some(Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()])))
}

/// Orients an axis towards the majority of neighbours; on a tie, of the five at the median distance.
fn towards_most(axis: Vector3<f64>, ball: &Ball, search: &BallSearch, count: usize) -> Result<Vector3<f64>> {
    let (coincident, flat) = (ball.len() - count, -FLAT * search.radius());
    let ahead = ball.offsets().iter().filter(|&&offset| axis.dot(&Vector3::from(offset)) >= flat).count();
    // Coincident points have a product of zero and were counted as ahead.
    let ahead = ahead - coincident;
    let keeps = match (2 * ahead).cmp(&count) {
        std::cmp::Ordering::Greater => true,
        std::cmp::Ordering::Less => false,
        std::cmp::Ordering::Equal => median_is_ahead(&axis, ball, search)?,
    };
    Ok(if keeps { axis } else { -axis })
}

fn median_is_ahead(axis: &Vector3<f64>, ball: &Ball, search: &BallSearch) -> Result<bool> {
    let apart = (0..ball.len()).filter(|&i| ball.squared_distances()[i] > 0.0);
    let mut apart = memory::collect(apart)?;
    apart.sort_unstable_by(|&a, &b| {
        ball.squared_distances()[a]
            .total_cmp(&ball.squared_distances()[b])
            .then_with(|| search.index(ball.positions()[a]).cmp(&search.index(ball.positions()[b])))
    });
    let median = apart.len() / 2;
    let around = &apart[median - 2..=median + 2];
    Ok(around.iter().filter(|&&i| axis.dot(&ball.vector(i)) > 0.0).count() >= 3)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn half_dome() -> Vec<[f64; 3]> {
        let mut rows = vec![[0.0; 3]];
        for i in 0..15 {
            for j in 0..15 {
                let (u, v) = (f64::from(i) / 7.0 - 0.93, f64::from(j) / 7.0 - 1.07);
                rows.push([1.4 * u + 0.2, v, -0.3 * (u * u + v * v)]);
            }
        }
        rows
    }

    #[test]
    fn rows_are_a_right_handed_basis() -> Result<()> {
        let cloud = Cloud::from_rows("points", &half_dome())?;
        let frames = shot_frames(&cloud, &[0], 1.2, &Execution::default())?;
        let axes = frames[0].unwrap_or_default();
        assert!((axes * axes.transpose() - Matrix3::identity()).amax() < 1e-14);
        assert!((axes.determinant() - 1.0).abs() < 1e-14);
        // The dome bends away from +z; most of it lies below the keypoint.
        assert!(axes[(2, 2)] < -0.9, "{axes}");
        Ok(())
    }

    #[test]
    fn duplicates_of_the_keypoint_change_nothing() -> Result<()> {
        let mut rows = half_dome();
        let cloud = Cloud::from_rows("points", &rows)?;
        let expected = shot_frames(&cloud, &[0], 1.2, &Execution::default())?;
        rows.extend([[0.0; 3]; 40]);
        let cloud = Cloud::from_rows("points", &rows)?;
        let frames = shot_frames(&cloud, &[0], 1.2, &Execution::default())?;
        let difference = frames[0].unwrap_or_default() - expected[0].unwrap_or_default();
        assert!(difference.amax() < 1e-12);
        Ok(())
    }

    #[test]
    fn too_few_neighbours_give_no_frame() -> Result<()> {
        let cloud = Cloud::from_rows("points", &half_dome()[..5])?;
        assert_eq!(shot_frames(&cloud, &[0, 1], 9.0, &Execution::default())?, [None, None]);
        assert!(shot_frames(&cloud, &[], 9.0, &Execution::default())?.is_empty());
        assert!(shot_frames(&cloud, &[5], 9.0, &Execution::default()).is_err());
        Ok(())
    }
}
