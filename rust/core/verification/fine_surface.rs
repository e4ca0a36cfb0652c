//! A surface in detail: a cloud thinned out only a little, which the last refinement lies on another.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::error::{Error, Result, positive};
use crate::execution::Execution;
use crate::features::normals::{Scatter, scatter};
use crate::features::voxels::voxel_downsample;
use crate::geometry::ball_search::{Ball, BallSearch};
use crate::points::Points;
use crate::verification::sampling;

/// Distance up to which the nearest point is looked for, in spacings.
pub(super) const REACH: f64 = 3.0;
/// Radius of the planes fitted around samples, in spacings.
const PLANE_RADIUS: f64 = 2.4;
/// Points that a plane needs.
const LEAST_POINTS: usize = 6;
/// Variance of the points of a plane across its longer axis, as a share of that along it: less is one line of a scan, whose
/// plane is open.
const LEAST_WIDTH: f64 = 0.01;
/// Places that planes are fitted at, and those of them that are kept.
const PLANES: usize = 8_000;
const SAMPLES: usize = 3_000;

/// A place on a surface with the plane of the points around it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub point: Point3<f64>,
    pub normal: Vector3<f64>,
    /// Root mean square distance of the points around from the plane: noise and curvature.
    pub deviation: f64,
}

/// Points of a surface about evenly spread, ready for the nearest of any place, and samples of it. Coordinates are relative
/// to the points' mean.
#[derive(Debug)]
pub struct FineSurface {
    spacing: f64,
    points: Points,
    search: BallSearch,
    /// In the order drawn.
    samples: Vec<Sample>,
    radius: f64,
}

impl FineSurface {
    /// Thins out a cloud to voxels of size `spacing`.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a spacing that is not positive or so small that voxels can't be numbered, or so large or
    /// small that no place has a plane; [`Error::Interrupted`].
    pub fn new(cloud: &Points, spacing: f64, execution: &Execution) -> Result<Self> {
        let spacing = positive("spacing", spacing)?;
        let points = Points::from_rows("points", &voxel_downsample(cloud, None, spacing, execution)?.points)?;
        let search = BallSearch::new(&points, REACH * spacing)?;
        let samples = sample(&points, &search.narrowed(PLANE_RADIUS * spacing), execution)?;
        if samples.is_empty() {
            let got = format!("{spacing}, of which the cloud is {:.3} across", points.diagonal() / spacing);
            return Err(Error::invalid("spacing", got, "give about the distance between points"));
        }
        let radius = root_mean_square(&samples);
        Ok(Self { spacing, points, search, samples, radius })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are no points; never so.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Distance between points, about.
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// Mean of the points.
    pub fn center(&self) -> Vector3<f64> {
        self.points.center()
    }

    /// The first samples drawn, at most `count`.
    pub(super) fn samples(&self, count: usize) -> &[Sample] {
        &self.samples[..count.min(self.samples.len())]
    }

    /// Root mean square distance of the samples from the points' mean.
    pub(super) fn radius(&self) -> f64 {
        self.radius
    }

    /// A search for points within some spacings, [`REACH`] at most.
    pub(super) fn search(&self, reach: f64) -> BallSearch {
        self.search.narrowed(reach.min(REACH) * self.spacing)
    }
}

/// The point of a search that is nearest to a place, if one is within its radius.
pub(super) fn nearest(search: &BallSearch, place: &Point3<f64>, ball: &mut Ball) -> Option<Point3<f64>> {
    search.within(place, ball);
    let squares = ball.squared_distances().iter().enumerate();
    let (best, _) = squares.min_by(|a, b| a.1.total_cmp(b.1))?;
    Some(place + ball.vector(best))
}

fn root_mean_square(samples: &[Sample]) -> f64 {
    let squares: f64 = samples.iter().map(|sample| sample.point.coords.norm_squared()).sum();
    (squares / samples.len() as f64).sqrt()
}

/// Places spread over the surface, drawn against the frequency of their normals.
fn sample(points: &Points, around: &BallSearch, execution: &Execution) -> Result<Vec<Sample>> {
    let step = points.len().div_ceil(PLANES).max(1);
    let rows: Vec<usize> = (0..points.len()).step_by(step).collect();
    let places: Vec<Sample> = rows
        .par_iter()
        .map_init(Ball::default, |ball, &row| {
            execution.check()?;
            around.within(&points.get(row), ball);
            Ok(plane(points.get(row), ball))
        })
        .collect::<Result<Vec<Option<Sample>>>>()?
        .into_iter()
        .flatten()
        .collect();
    let normals: Vec<Vector3<f32>> =
        places.iter().map(|place| place.normal.map(|number| number as f32)).collect();
    let drawn = sampling::draw(&normals, false, SAMPLES);
    Ok(drawn.into_iter().map(|index| places[index as usize]).collect())
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
    // The plane's own foot below the point: samples lie on the surface, not on its noise.
    let foot = point + normal * mean.dot(&normal);
    Some(Sample { point: foot, normal, deviation: low.max(0.0).sqrt() })
}
