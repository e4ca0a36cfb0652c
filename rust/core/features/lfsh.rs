//! LFSH-30, local feature statistics histograms (Yang, Cao, Zhang, Information Sciences 2016): histograms of
//! depth, horizontal distance to the normal's axis, and deviation angle of normals around a keypoint. Cost
//! O(m k).

use nalgebra::Vector3;

use crate::cloud::Cloud;
use crate::error::Result;
use crate::execution::Execution;
use crate::features::harris3d::check_normals;
use crate::features::keypoints::locations;
use crate::geometry::ball_search::Ball;

/// Length of the descriptor: bins of local depth, horizontal radius and deviation angle.
pub const LENGTH: usize = DEPTH_BINS + RADIUS_BINS + ANGLE_BINS;
const DEPTH_BINS: usize = 10;
const RADIUS_BINS: usize = 5;
const ANGLE_BINS: usize = 15;
/// A ball with fewer points, the keypoint included, has a zero descriptor.
const MIN_POINTS: usize = 6;

/// The descriptor and its parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lfsh {
    /// Radius of the support, in the unit of the data; the paper's is 15 pr.
    pub radius: f64,
}

impl Lfsh {
    /// Computes one descriptor per keypoint: three histograms, each divided by the number of points. Zero
    /// with fewer than 6 points, NaN if the keypoint has no normal; neighbours without a normal are skipped
    /// in the angles.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] for a radius that is not positive, an index out of range, or a wrong
    /// number of normals; [`crate::Error::Interrupted`].
    pub fn describe(
        self,
        cloud: &Cloud,
        normals: &[Vector3<f64>],
        keypoints: &[usize],
        execution: &Execution,
    ) -> Result<Vec<[f32; LENGTH]>> {
        let centers = locations(cloud.points(), keypoints)?;
        check_normals(cloud.points(), Some(normals))?;
        let search = cloud.balls(self.radius)?;
        let sorted = search.reorder(normals)?;
        search.map_at(&centers, [f32::NAN; LENGTH], execution, |i, ball| {
            let normal = &normals[keypoints[i]];
            if normal.iter().all(|value| value.is_finite()) {
                Ok(self.histograms(ball, normal, &sorted))
            } else {
                Ok([f32::NAN; LENGTH])
            }
        })
    }

    fn histograms(self, ball: &Ball, normal: &Vector3<f64>, normals: &[Vector3<f64>]) -> [f32; LENGTH] {
        let mut bins = [0_u32; LENGTH];
        if ball.len() < MIN_POINTS {
            return [0.0; LENGTH];
        }
        let (depths, rest) = bins.split_at_mut(DEPTH_BINS);
        let (radii, angles) = rest.split_at_mut(RADIUS_BINS);
        for (i, &position) in ball.positions().iter().enumerate() {
            let height = normal.dot(&ball.vector(i));
            let horizontal = (ball.squared_distances()[i] - height * height).max(0.0).sqrt();
            count(depths, (self.radius + height) / (2.0 * self.radius));
            count(radii, horizontal / self.radius);
            let cosine = normal.dot(&normals[position as usize]).clamp(-1.0, 1.0);
            if cosine.is_finite() {
                count(angles, cosine.acos() / std::f64::consts::PI);
            }
        }
        let weight = 1.0 / ball.len() as f64;
        bins.map(|points| (f64::from(points) * weight) as f32)
    }
}

/// Counts a value in 0..=1; the last bin holds its upper end.
fn count(bins: &mut [u32], value: f64) {
    let bin = (value.max(0.0) * bins.len() as f64) as usize;
    bins[bin.min(bins.len() - 1)] += 1;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_fills_one_bin_of_depth_and_angle() -> Result<()> {
        let rows: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i % 10), f64::from(i / 10), 0.0]).collect();
        let cloud = Cloud::from_rows("points", &rows)?;
        let normals = vec![Vector3::z(); 100];
        let rows = Lfsh { radius: 3.5 }.describe(&cloud, &normals, &[55], &Execution::default())?;
        let row = rows[0];
        assert!((row[5] - 1.0).abs() < 1e-6 && (row[15] - 1.0).abs() < 1e-6);
        assert!((row[10..15].iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert!((row.iter().sum::<f32>() - 3.0).abs() < 1e-6);
        Ok(())
    }

    #[test]
    fn bins_of_a_hand_made_ball() -> Result<()> {
        // Heights -0.95, 0.95, 0; horizontal radii 0, 0, 0.95; angles 180, 90, 0 degrees, of radius 1.
        let rows = [[0.0; 3], [0.0, 0.0, -0.95], [0.0, 0.0, 0.95], [0.95, 0.0, 0.0], [0.0; 3], [0.0; 3]];
        let cloud = Cloud::from_rows("points", &rows)?;
        let z = Vector3::z();
        let normals = [z, -z, Vector3::x(), z, z, Vector3::repeat(f64::NAN)];
        let rows = Lfsh { radius: 1.0 }.describe(&cloud, &normals, &[0, 5], &Execution::default())?;
        let sixths: Vec<i32> = rows[0].iter().map(|value| (value * 6.0).round() as i32).collect();
        assert_eq!(sixths[..10], [1, 0, 0, 0, 0, 4, 0, 0, 0, 1]);
        assert_eq!(sixths[10..15], [5, 0, 0, 0, 1]);
        assert_eq!(sixths[15..], [3, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1]);
        assert!(rows[1].iter().all(|value| value.is_nan()));
        Ok(())
    }

    #[test]
    fn too_few_points_are_zero() -> Result<()> {
        let cloud = Cloud::from_rows("points", &[[0.0; 3]; 5])?;
        let rows = Lfsh { radius: 1.0 }.describe(&cloud, &[Vector3::z(); 5], &[0], &Execution::default())?;
        assert!(rows[0].iter().all(|&value| value.to_bits() == 0));
        Ok(())
    }
}
