//! SHOT-352 (Tombari, Salti, Di Stefano, ECCV 2010; Salti et al., CVIU 2014), as PCL's `SHOTEstimation`.
//!
//! A ball around the keypoint is divided into 8 sectors in azimuth, 2 shells in radius and 2 halves in
//! elevation; each of the 32 volumes holds 11 bins of the cosine between a neighbour's normal and the frame's
//! z axis. A neighbour's vote is interpolated between adjacent bins, one dimension at a time. Cost O(m k).

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use nalgebra::{Matrix3, Vector3};

use crate::cloud::Cloud;
use crate::correspondences::Frame;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::features::harris3d::check_normals;
use crate::features::keypoints::locations;
use crate::features::shot_lrf::frame;
use crate::geometry::angle::atan2;
use crate::geometry::ball_search::Ball;
use crate::simd;

/// Length of the descriptor.
pub const LENGTH: usize = 352;
/// Bins of the cosine in each volume, and the index of the last.
const STEPS: usize = 11;
const LAST_STEP: usize = STEPS - 1;
/// Index offset of the next sector and of the next shell.
const SECTOR: usize = 4;
const SHELL: usize = 2;
const VOLUMES: usize = 32;
/// Neighbours whose angles are computed at once.
const LANES: usize = 16;
/// A ball with fewer points, the keypoint included, has no descriptor.
const MIN_POINTS: usize = 5;

/// The descriptor and its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shot {
    /// Radius of the support, in the unit of the data; the paper's is 15 pr.
    pub radius: f64,
    /// Wrap the cosine's interpolation from bin 9 to bin 0, as PCL does; otherwise continue to bin 10.
    pub pcl_compat: bool,
}

impl Shot {
    /// The descriptor as in PCL.
    pub fn new(radius: f64) -> Self {
        Self { radius, pcl_compat: true }
    }

    /// Computes one descriptor of unit length per keypoint; NaN without a frame or with fewer than 5 points,
    /// zero if no neighbour has a normal. Without given frames, SHOT's own frames of the same radius are
    /// used.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a radius that is not positive, an index out of range, or a wrong number of
    /// normals or frames; [`Error::Interrupted`].
    pub fn describe(
        &self,
        cloud: &Cloud,
        normals: &[Vector3<f64>],
        keypoints: &[usize],
        frames: Option<&[Frame]>,
        execution: &Execution,
    ) -> Result<Vec<[f32; LENGTH]>> {
        let centers = locations(cloud.points(), keypoints)?;
        check_normals(cloud.points(), Some(normals))?;
        check_frames(keypoints, frames)?;
        let search = cloud.balls(self.radius)?;
        let normals = search.reorder(normals)?;
        search.map_at(&centers, [f32::NAN; LENGTH], execution, |i, ball| {
            let axes = frames.map_or_else(|| frame(&centers[i], ball, &search), |frames| Ok(frames[i]))?;
            Ok(match axes {
                Some(axes) if ball.len() >= MIN_POINTS => self.histogram(ball, &axes, &normals),
                _ => [f32::NAN; LENGTH],
            })
        })
    }

    fn histogram(&self, ball: &Ball, axes: &Matrix3<f64>, normals: &[Vector3<f64>]) -> [f32; LENGTH] {
        let mut bins = [0.0; LENGTH];
        let z_axis = axes.row(2).transpose();
        let neighbors = ball.offsets().chunks(LANES).zip(ball.positions().chunks(LANES));
        simd::run(
            #[inline(always)]
            || {
                for (offsets, positions) in neighbors.clone() {
                    let places = places(offsets, axes);
                    for (place, &position) in places.iter().zip(positions) {
                        let cosine = z_axis.dot(&normals[position as usize]);
                        if place.distance > 0.0 && cosine.is_finite() {
                            self.vote(&mut bins, place, cosine.clamp(-1.0, 1.0));
                        }
                    }
                }
            },
        );
        normalized(&bins)
    }

    /// Adds the votes of one neighbour: its own bin, and one adjacent bin per dimension.
    fn vote(&self, bins: &mut [f64; LENGTH], place: &Place, cosine: f64) {
        let is_outer = place.distance > 0.5 * self.radius;
        let sector = (place.azimuth as u32).min(7);
        let is_upper = place.z > 0.0;
        let volume = SECTOR * sector as usize + SHELL * usize::from(is_outer) + usize::from(is_upper);
        let scaled = 5.0 * (1.0 + cosine);
        let step = (scaled + 0.5) as u32;
        let row = step as usize;

        // Cosine.
        let u = scaled - f64::from(step);
        bins[volume * STEPS + self.adjacent_step(row, u > 0.0)] += u.abs();
        // Radius: the other shell, if it is closer.
        let middle = if is_outer { 0.75 } else { 0.25 };
        let g = 2.0 * place.distance / self.radius - 2.0 * middle;
        bins[(volume ^ SHELL) * STEPS + row] += if is_outer == (g < 0.0) { g.abs() } else { 0.0 };
        // Elevation: the other half, if it is closer.
        let middle = if is_upper { FRAC_PI_4 } else { 3.0 * FRAC_PI_4 };
        let e = (place.inclination - middle) / FRAC_PI_2;
        bins[(volume ^ 1) * STEPS + row] += if is_upper == (e > 0.0) { e.abs() } else { 0.0 };
        // Azimuth, undefined on the z axis.
        let a = (place.azimuth - f64::from(sector) - 0.5).clamp(-0.5, 0.5).abs();
        let (home_share, shared) = if place.from_axis == 0.0 { (0.0, 0.0) } else { (1.0 - a, a) };
        let turn = if place.azimuth - f64::from(sector) > 0.5 { SECTOR } else { VOLUMES - SECTOR };
        bins[(volume + turn) % VOLUMES * STEPS + row] += shared;

        bins[volume * STEPS + row] += (1.0 - u.abs()) + (1.0 - g.abs()) + (1.0 - e.abs()) + home_share;
    }

    fn adjacent_step(&self, step: usize, is_above: bool) -> usize {
        match (is_above, step) {
            (true, 9) if self.pcl_compat => 0,
            (true, _) => (step + 1).min(LAST_STEP),
            // Only an exact -1 has step 0, and its weight is zero.
            (false, _) => step.saturating_sub(1),
        }
    }
}

/// Position of a neighbour in the frame.
#[derive(Debug, Clone, Copy, Default)]
struct Place {
    distance: f64,
    /// Coordinate along the z axis, and distance from it.
    z: f64,
    from_axis: f64,
    /// Angle about the z axis from the negative x axis, in sectors: 0 to 8.
    azimuth: f64,
    /// Angle from the z axis, in radians.
    inclination: f64,
}

/// Positions of up to [`LANES`] neighbours; the angles, the most expensive part, are vectorized.
#[inline(always)]
#[expect(clippy::inline_always, reason = "must inherit the vector features of its caller")]
fn places(offsets: &[[f64; 3]], axes: &Matrix3<f64>) -> [Place; LANES] {
    let mut places = [Place::default(); LANES];
    let (mut azimuths, mut inclinations) = ([0.0; LANES], [0.0; LANES]);
    let (mut x, mut y, mut z, mut from_axis) = ([0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for (lane, &offset) in offsets.iter().enumerate() {
        let along = |k: usize| axes[(k, 0)] * offset[0] + axes[(k, 1)] * offset[1] + axes[(k, 2)] * offset[2];
        (x[lane], y[lane], z[lane]) = (along(0), along(1), along(2));
    }
    for lane in 0..LANES {
        from_axis[lane] = (x[lane] * x[lane] + y[lane] * y[lane]).sqrt();
        azimuths[lane] = (atan2(y[lane], x[lane]) + PI) / FRAC_PI_4;
        inclinations[lane] = atan2(from_axis[lane], z[lane]);
    }
    for (lane, (place, &offset)) in places.iter_mut().zip(offsets).enumerate() {
        *place = Place {
            distance: Vector3::from(offset).norm(),
            z: z[lane],
            from_axis: from_axis[lane],
            azimuth: azimuths[lane],
            inclination: inclinations[lane],
        };
    }
    places
}

/// Divides by the Euclidean norm, as PCL, instead of the ECCV paper's sum; zero stays zero.
fn normalized(bins: &[f64; LENGTH]) -> [f32; LENGTH] {
    let norm = bins.iter().map(|value| value * value).sum::<f64>().sqrt();
    let factor = if norm > 0.0 { 1.0 / norm } else { 0.0 };
    bins.map(|value| (value * factor) as f32)
}

fn check_frames(keypoints: &[usize], frames: Option<&[Frame]>) -> Result<()> {
    match frames {
        Some(frames) if frames.len() != keypoints.len() => {
            let remedy = format!("give one frame per keypoint, here {}", keypoints.len());
            Err(Error::invalid("lrf", format!("{} frames", frames.len()), remedy))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn single_vote(local: [f64; 3], cosine: f64, pcl_compat: bool) -> Vec<(usize, f64)> {
        let mut bins = [0.0; LENGTH];
        let place = places(&[local], &Matrix3::identity())[0];
        Shot { radius: 4.0, pcl_compat }.vote(&mut bins, &place, cosine);
        bins.iter().copied().enumerate().filter(|&(_, value)| value > 1e-12).collect()
    }

    #[test]
    fn a_vote_in_the_middle_of_a_bin_is_not_shared() {
        // Azimuth -157.5 degrees is the middle of sector 0; elevation 45, distance 3 = 3/4 R.
        let (s, c) = (PI / 8.0).sin_cos();
        let side = 3.0 * FRAC_PI_4.sin();
        let votes = single_vote([-side * c, -side * s, side], 0.0, true);
        assert_eq!(votes.len(), 1);
        assert_eq!(votes[0].0, 3 * STEPS + 5);
        assert!((votes[0].1 - 4.0).abs() < 1e-12);
    }

    #[test]
    fn votes_are_shared_one_dimension_at_a_time() {
        // All four dimensions are off the middle by a known share.
        let (s, c) = (PI / 8.0 + 0.25 * FRAC_PI_4).sin_cos();
        let elevation = FRAC_PI_4 + 0.2 * FRAC_PI_2;
        let (distance, cosine) = (2.4, 0.06);
        let (z, plane) = (distance * elevation.cos(), distance * elevation.sin());
        let votes = single_vote([plane * c, plane * s, z], cosine, true);
        let volume = 4 * 4 + 2 + 1;
        let expected = [
            (volume * STEPS + 5, 4.0 - 0.3 - 0.3 - 0.2 - 0.25),
            (volume * STEPS + 6, 0.3),
            ((volume - 2) * STEPS + 5, 0.3),
            ((volume - 1) * STEPS + 5, 0.2),
            ((volume + 4) * STEPS + 5, 0.25),
        ];
        for (bin, value) in expected {
            let got = votes.iter().find(|vote| vote.0 == bin).map_or(0.0, |vote| vote.1);
            assert!((got - value).abs() < 1e-12, "bin {bin}: {got} instead of {value}");
        }
        assert_eq!(votes.len(), expected.len());
    }

    #[test]
    fn pcl_wraps_the_last_cosine_step() {
        let local = [1.0, 1.0, 1.0];
        let wrapped = single_vote(local, 0.85, true);
        let clamped = single_vote(local, 0.85, false);
        let steps = |votes: &[(usize, f64)]| votes.iter().map(|vote| vote.0 % STEPS).collect::<Vec<_>>();
        assert!(steps(&wrapped).contains(&0) && !steps(&wrapped).contains(&10));
        assert!(steps(&clamped).contains(&10) && !steps(&clamped).contains(&0));
    }

    #[test]
    fn extremes_of_the_cosine_stay_in_range() {
        for cosine in [-1.0, 1.0] {
            let total: f64 = single_vote([0.0, 0.0, 1.0], cosine, true).iter().map(|vote| vote.1).sum();
            // Cosine 1, radius 1, elevation 0.5 (the pole is half a bin off), no azimuth on the axis.
            assert!((total - 2.5).abs() < 1e-12, "{total}");
        }
    }

    #[test]
    fn invalid_keypoints_are_nan_and_missing_normals_zero() -> Result<()> {
        let rows: Vec<[f64; 3]> =
            (0..30).map(|i| [f64::from(i % 6), f64::from(i / 6), f64::from(i % 5)]).collect();
        let cloud = Cloud::from_rows("points", &rows)?;
        let none = vec![Vector3::repeat(f64::NAN); 30];
        let execution = Execution::default();
        assert!(Shot::new(9.0).describe(&cloud, &none, &[0], None, &execution)?[0].iter().all(|&v| v == 0.0));
        let up = vec![Vector3::z(); 30];
        assert!(Shot::new(0.5).describe(&cloud, &up, &[0], None, &execution)?[0][0].is_nan());
        assert!(Shot::new(9.0).describe(&cloud, &up, &[0], Some(&[None]), &execution)?[0][0].is_nan());
        assert!(Shot::new(9.0).describe(&cloud, &up, &[], None, &execution)?.is_empty());
        assert!(Shot::new(9.0).describe(&cloud, &up[1..], &[], None, &execution).is_err());
        Ok(())
    }
}
