//! RCS-72, rotational contour signatures (Yang, Zhang, Xian, Xiao, Cao, CVIU 2017): contours of the local
//! surface projected along six directions. Cost O(m k).

use std::f64::consts::FRAC_PI_6;

use nalgebra::Matrix3;

use crate::cloud::Cloud;
use crate::error::Result;
use crate::execution::Execution;
use crate::features::keypoints::locations;
use crate::features::toldi_lrf::{Recipe, frame};
use crate::geometry::angle::atan2;
use crate::geometry::ball_search::Ball;
use crate::simd;

/// Length of the descriptor: contour points of every view.
pub const LENGTH: usize = VIEWS * CONTOUR_POINTS;
const VIEWS: usize = 6;
const CONTOUR_POINTS: usize = 12;
/// Points whose angles are computed at once.
const LANES: usize = 16;
/// Angle from one view to the next, and from one contour point to the next.
const STEP: f64 = FRAC_PI_6;
/// Share of a contour point's sector that is used: 16 degrees of 30, as for whole degrees up to 15.
const WINDOW: f64 = 16.0 / 30.0;
/// z from half the radius; x weighted by the sign of the height.
const RECIPE: Recipe = Recipe { inner_share: 0.5, is_signed: true };

/// The descriptor and its parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rcs {
    /// Radius of the support, in the unit of the data; the paper's is 15 pr.
    pub radius: f64,
}

impl Rcs {
    /// Computes one descriptor per keypoint, each value a share of the radius; zero if there are too few
    /// points for a frame (4 within half the radius, 11 within all of it) or the surface is a plane.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] for a radius that is not positive, or an index out of range;
    /// [`crate::Error::Interrupted`].
    pub fn describe(
        self,
        cloud: &Cloud,
        keypoints: &[usize],
        execution: &Execution,
    ) -> Result<Vec<[f32; LENGTH]>> {
        let centers = locations(cloud.points(), keypoints)?;
        cloud.balls(self.radius)?.map_at(&centers, [0.0; LENGTH], execution, |_, ball| {
            Ok(frame(ball, self.radius, RECIPE).map_or([0.0; LENGTH], |axes| self.contours(ball, &axes)))
        })
    }

    fn contours(self, ball: &Ball, axes: &Matrix3<f64>) -> [f32; LENGTH] {
        let mut squares = [0.0; LENGTH];
        simd::run(
            #[inline(always)]
            || {
                for (view, contour) in squares.chunks_exact_mut(CONTOUR_POINTS).enumerate() {
                    let turned = rotation(STEP * view as f64) * axes;
                    for offsets in ball.offsets().chunks(LANES) {
                        extend(contour, offsets, &turned);
                    }
                }
            },
        );
        squares.map(|square: f64| (square.sqrt() / self.radius) as f32)
    }
}

/// Extends the contour, as squared distances, by up to [`LANES`] points projected along the third axis.
#[inline(always)]
#[expect(clippy::inline_always, reason = "must inherit the vector features of its caller")]
fn extend(contour: &mut [f64], offsets: &[[f64; 3]], axes: &Matrix3<f64>) {
    let (mut x, mut y) = ([0.0; LANES], [0.0; LANES]);
    for (lane, &offset) in offsets.iter().enumerate() {
        let along = |k: usize| axes[(k, 0)] * offset[0] + axes[(k, 1)] * offset[1] + axes[(k, 2)] * offset[2];
        (x[lane], y[lane]) = (along(0), along(1));
    }
    // One unit per contour point, from 0 to 12.
    let mut angles = [0.0; LANES];
    for lane in 0..LANES {
        let angle = atan2(y[lane], x[lane]) / STEP;
        angles[lane] = if angle < 0.0 { angle + CONTOUR_POINTS as f64 } else { angle };
    }
    for lane in 0..offsets.len() {
        let sector = (angles[lane] as u32).min(CONTOUR_POINTS as u32 - 1);
        let square = x[lane] * x[lane] + y[lane] * y[lane];
        let counts = angles[lane] - f64::from(sector) < WINDOW;
        let farthest = &mut contour[sector as usize];
        *farthest = f64::max(*farthest, if counts { square } else { 0.0 });
    }
}

/// Rotation by the same angle about z, y and x in that order, of the axes and not of the points.
fn rotation(angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    Matrix3::new(
        c * c,
        c * s,
        -s,
        s * s * c - c * s,
        s * s * s + c * c,
        s * c,
        c * s * c + s * s,
        c * s * s - s * c,
        c * c,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};

    fn bumpy() -> Vec<[f64; 3]> {
        let mut rows = vec![[0.0; 3]];
        for i in 0..25 {
            for j in 0..25 {
                let (u, v) = (f64::from(i) / 12.3 - 1.0, f64::from(j) / 12.7 - 0.95);
                rows.push([u, v, 0.3 * (2.0 * u).sin() * u - 0.2 * (3.0 * v + u).cos() * v]);
            }
        }
        rows
    }

    #[test]
    fn rotation_is_orthonormal() {
        assert!((rotation(0.0) - Matrix3::identity()).amax() < 1e-15);
        for view in 0..VIEWS {
            let turn = rotation(STEP * view as f64);
            assert!((turn * turn.transpose() - Matrix3::identity()).amax() < 1e-14);
            assert!((turn.determinant() - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn contour_of_known_points() {
        let points = [[0.5, 0.01, 0.3], [0.3, 0.01, 0.2], [0.01, -0.4, 0.0], [-0.2, 0.2, 0.0]];
        let mut ball = Ball::default();
        ball.fill(&points);
        let row = Rcs { radius: 1.0 }.contours(&ball, &Matrix3::identity());
        assert!((row[0] - 0.5001).abs() < 1e-4);
        assert!((row[9] - 0.4001).abs() < 1e-4);
        // 135 degrees lies in the second half of its one-degree window: 15 of 30.
        assert!((row[4] - 0.2828).abs() < 1e-4);
        assert!(row[1].abs() < 1e-9 && row[5].abs() < 1e-9);
    }

    #[test]
    fn a_rigid_motion_changes_nothing() -> Result<()> {
        let rows = bumpy();
        let turn = Rotation3::from_euler_angles(0.4, -1.1, 2.0);
        let moved: Vec<[f64; 3]> = rows
            .iter()
            .map(|&row| (turn * Vector3::from(row) + Vector3::new(5.0, -3.0, 9.0)).into())
            .collect();
        let describe = |rows: &[[f64; 3]]| {
            Rcs { radius: 0.8 }.describe(&Cloud::from_rows("points", rows)?, &[0, 300], &Execution::default())
        };
        for (before, after) in describe(&rows)?.iter().zip(describe(&moved)?) {
            assert!(before.iter().any(|&value| value > 0.5));
            assert!(before.iter().zip(after).all(|(a, b)| (a - b).abs() < 1e-5));
        }
        Ok(())
    }

    #[test]
    fn no_frame_is_zero() -> Result<()> {
        let cloud = Cloud::from_rows("points", &bumpy()[..8])?;
        let rows = Rcs { radius: 9.0 }.describe(&cloud, &[0], &Execution::default())?;
        assert!(rows[0].iter().all(|&value| value.to_bits() == 0));
        Ok(())
    }
}
