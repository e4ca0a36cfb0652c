//! A finely sampled surface: a slightly downsampled cloud for the final refinement.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::cloud::Own;
use crate::error::{Error, Result, positive};
use crate::execution::Execution;
use crate::features::normals::{Scatter, scatter};
use crate::features::voxels::voxel_downsample;
use crate::geometry::ball_search::{Ball, BallSearch};
use crate::geometry::own_axes::OwnFrame;
use crate::memory;
use crate::points::Points;
use crate::verification::sampling;

/// Radius of the nearest-neighbour search, in spacings.
pub(super) const REACH: f64 = 3.0;
/// Radius of the planes fitted around samples, in spacings.
const PLANE_RADIUS: f64 = 2.4;
/// Fewest points of a plane.
const LEAST_POINTS: usize = 6;
/// Least variance of a plane's points across their longer axis, relative to that along it. Points with less
/// lie on one scan line and do not determine a plane.
const LEAST_WIDTH: f64 = 0.01;
/// Least share of sampled points with a plane; fewer may all lie in one corner.
const LEAST_SHARE: f64 = 0.1;
/// Number of sampled points that planes are fitted at, and number of samples kept.
const PLANES: usize = 5_000;
const SAMPLES: usize = 3_000;

/// A point on a surface with the plane of its neighbours.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub point: Point3<f64>,
    pub normal: Vector3<f64>,
    /// Standard deviation of the neighbours from the plane, with three degrees of freedom removed: noise and
    /// curvature.
    pub deviation: f64,
}

/// Evenly spread points of a surface with a search for nearest neighbours, and samples of them. Coordinates
/// are relative to the points' mean.
#[derive(Debug)]
pub struct FineSurface {
    spacing: f64,
    frame: OwnFrame,
    points: Points,
    search: BallSearch,
    /// In the order drawn.
    samples: Vec<Sample>,
    radius: f64,
}

impl FineSurface {
    /// Downsamples a cloud to voxels of size `spacing`.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if the spacing is not positive, is too small to number the voxels, or leaves
    /// too few points with a plane; [`Error::Interrupted`], [`Error::OutOfMemory`].
    pub fn new(cloud: &Points, spacing: f64, execution: &Execution) -> Result<Self> {
        Self::of_own(&OwnFrame::of(cloud)?, spacing, execution)
    }

    /// As [`FineSurface::new`], for points along the cloud's own axes.
    ///
    /// # Errors
    /// As [`FineSurface::new`].
    pub fn of_own((frame, cloud): &Own, spacing: f64, execution: &Execution) -> Result<Self> {
        let spacing = positive("spacing", spacing)?;
        let points = Points::from_rows("points", &voxel_downsample(cloud, None, spacing, execution)?.points)?;
        let frame = OwnFrame { center: frame.in_data(&points.center()), ..*frame };
        let search = BallSearch::new(&points, REACH * spacing)?;
        let samples = sample(&points, &search.narrowed(PLANE_RADIUS * spacing), spacing, execution)?;
        let radius = root_mean_square(&samples);
        Ok(Self { spacing, frame, points, search, samples, radius })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Always false: a surface has points.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Approximate distance between points.
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// The points' own axes, about their mean: the frame of the samples and of the search.
    pub(super) fn frame(&self) -> &OwnFrame {
        &self.frame
    }

    /// Positions of the samples, in the coordinates of the data.
    pub fn sample_points(&self) -> impl ExactSizeIterator<Item = [f64; 3]> {
        self.samples.iter().map(|sample| self.frame.in_data(&sample.point.coords).into())
    }

    /// The first samples drawn, at most `count`.
    pub(super) fn samples(&self, count: usize) -> &[Sample] {
        &self.samples[..count.min(self.samples.len())]
    }

    /// Root mean square distance of the samples from the points' mean.
    pub(super) fn radius(&self) -> f64 {
        self.radius
    }

    /// Search for points within [`REACH`] spacings.
    pub(super) fn search(&self) -> &BallSearch {
        &self.search
    }
}

fn root_mean_square(samples: &[Sample]) -> f64 {
    let squares: f64 = samples.iter().map(|sample| sample.point.coords.norm_squared()).sum();
    (squares / samples.len() as f64).sqrt()
}

/// Samples the surface, with weights that fall with the frequency of the normals.
fn sample(points: &Points, around: &BallSearch, spacing: f64, execution: &Execution) -> Result<Vec<Sample>> {
    let step = points.len().div_ceil(PLANES).max(1);
    let rows = memory::collect((0..points.len()).step_by(step))?;
    let planes = rows.par_iter().map_init(Ball::default, |ball, &row| {
        execution.check()?;
        around.within(&points.get(row), ball)?;
        Ok(plane(points.get(row), ball))
    });
    let places = memory::collect(memory::par_try_collect(planes)?.into_iter().flatten())?;
    if places.is_empty() || (places.len() as f64) < LEAST_SHARE * rows.len() as f64 {
        let got = format!("{spacing:.3e}, at which {} of {} places have a plane", places.len(), rows.len());
        let across = points.diagonal();
        let remedy = format!("the cloud is {across:.3e} across; give about the distance between points");
        return Err(Error::invalid("spacing", got, remedy));
    }
    let normals = memory::collect(places.iter().map(|place| place.normal.map(|number| number as f32)))?;
    let drawn = sampling::draw(&normals, false, SAMPLES)?;
    memory::collect(drawn.into_iter().map(|index| places[index as usize]))
}

fn plane(point: Point3<f64>, ball: &Ball) -> Option<Sample> {
    if ball.len() < LEAST_POINTS {
        return None;
    }
    let Scatter { mean, axes } = scatter(ball.offsets().iter().map(|&offset| Vector3::from(offset)), false)?;
    let [low, middle, high] = axes.values;
    if middle < LEAST_WIDTH * high {
        return None;
    }
    let normal = axes.vectors[0];
    // The foot of the perpendicular on the plane: samples lie on the surface, without its noise.
    let foot = point + normal * mean.dot(&normal);
    let count = ball.len() as f64;
    Some(Sample { point: foot, normal, deviation: (low.max(0.0) * count / (count - 3.0)).sqrt() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A raster of 30 x 30 points, 1 apart, on the plane z = 5.
    fn raster() -> Vec<[f64; 3]> {
        (0..900).map(|i| [f64::from(i % 30), f64::from(i / 30), 5.0]).collect()
    }

    fn surface(rows: &[[f64; 3]], spacing: f64) -> Result<FineSurface> {
        FineSurface::new(&Points::from_rows("points", rows)?, spacing, &Execution::default())
    }

    #[test]
    fn samples_lie_on_the_planes_of_their_neighbours() -> Result<()> {
        let mut rows = raster();
        rows.iter_mut().enumerate().for_each(|(i, row)| row[2] += if i % 2 == 0 { 0.1 } else { -0.1 });
        let surface = surface(&rows, 1.0)?;
        assert_eq!((surface.len(), surface.samples(usize::MAX).len()), (900, 900));
        for sample in surface.samples(usize::MAX) {
            assert!(sample.normal.z.abs() > 0.99);
            assert!(sample.point.z.abs() < 0.08, "{}", sample.point.z);
            assert!((0.05..0.12).contains(&sample.deviation), "{}", sample.deviation);
        }
        Ok(())
    }

    #[test]
    fn the_nearest_point_is_found_up_to_the_reach() -> Result<()> {
        let surface = surface(&raster(), 1.0)?;
        let place = surface.points.get(37) + Vector3::new(0.3, -0.2, REACH - 0.1);
        let nearest = |place: &Point3<f64>| surface.search().nearest(place).offset();
        let found = place + nearest(&place).unwrap_or_default();
        assert!((found - surface.points.get(37)).amax() < 1e-12);
        assert_eq!(nearest(&(place + Vector3::z() * 0.1)), None);
        Ok(())
    }

    #[test]
    fn samples_are_no_more_than_needed() -> Result<()> {
        let rows: Vec<[f64; 3]> =
            (0..40_000).map(|i| [f64::from(i % 200), f64::from(i / 200), 0.0]).collect();
        assert_eq!(surface(&rows, 1.0)?.samples(usize::MAX).len(), SAMPLES);
        Ok(())
    }

    #[test]
    fn clouds_without_planes_are_refused() -> Result<()> {
        let line: Vec<[f64; 3]> = (0..50).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        let far_apart = raster().into_iter().map(|row| row.map(|x| 3.0 * x));
        let mostly_apart: Vec<[f64; 3]> = far_apart.chain(raster()[..90].to_vec()).collect();
        for rows in [vec![], vec![[1.0; 3]; 50], line, raster()[..5].to_vec(), mostly_apart] {
            assert!(surface(&rows, 1.0).is_err());
        }
        for spacing in [0.0, -1.0, f64::NAN, 1e-30, 0.1, 100.0] {
            assert!(surface(&raster(), spacing).is_err());
        }
        let interrupted = Execution::default();
        interrupted.interrupt();
        let points = Points::from_rows("points", &raster())?;
        assert!(matches!(FineSurface::new(&points, 1.0, &interrupted), Err(Error::Interrupted)));
        Ok(())
    }
}
