//! Pairs of the samples of two fine surfaces with points of the other one.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::ball_search::Nearest;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::verification::fine_surface::{FineSurface, Sample};

/// A sample paired with a point: coordinates relative to the target's mean, in spacings.
#[derive(Clone)]
pub(super) struct Pair {
    pub place: Vector3<f64>,
    pub normal: Vector3<f64>,
    pub residual: f64,
    pub squared_distance: f64,
    pub deviation: f64,
}

/// Cache of the nearest neighbours of each surface's samples: they rarely change when the pose moves little.
pub(super) struct Known {
    to_source: Vec<Nearest>,
    to_target: Vec<Nearest>,
}

impl Known {
    pub fn new(source: &FineSurface, target: &FineSurface, samples: usize) -> Result<Self> {
        let nothing =
            |surface: &FineSurface| memory::filled(Nearest::default(), surface.samples(samples).len());
        Ok(Self { to_source: nothing(source)?, to_target: nothing(target)? })
    }

    /// Pairs of samples and points within `reach` spacings, for the samples of both surfaces.
    pub fn pair(
        &mut self,
        source: &FineSurface,
        target: &FineSurface,
        pose: &Rigid,
        reach: f64,
        samples: usize,
        execution: &Execution,
    ) -> Result<Vec<Pair>> {
        let inverse = pose.rotation.transpose();
        let unit = target.spacing();
        let forward = |(sample, known): (&Sample, &mut Nearest)| {
            let place = pose.apply(&sample.point);
            let near = place + nearest(known, &place, target, reach)?;
            as_pair(sample, (place, near, pose.rotation * sample.normal), unit, reach)
        };
        let backward = |(sample, known): (&Sample, &mut Nearest)| {
            let place = Point3::from(inverse * (sample.point.coords - pose.translation));
            let near = place + nearest(known, &place, source, reach)?;
            as_pair(sample, (pose.apply(&near), sample.point, sample.normal), unit, reach)
        };
        let moved = source.samples(samples).par_iter().zip(&mut self.to_source).map(|sample| {
            execution.check()?;
            Ok(forward(sample))
        });
        let still = target.samples(samples).par_iter().zip(&mut self.to_target).map(|sample| {
            execution.check()?;
            Ok(backward(sample))
        });
        let pairs = memory::par_try_collect(moved.chain(still))?;
        memory::collect(pairs.into_iter().flatten())
    }
}

/// Returns the vector to the nearest point of a surface, if there is one within about `reach` spacings;
/// updates the cache.
fn nearest(
    known: &mut Nearest,
    place: &Point3<f64>,
    surface: &FineSurface,
    reach: f64,
) -> Option<Vector3<f64>> {
    let seen = known.seen_from(place, reach * surface.spacing());
    let found = seen.unwrap_or_else(|| {
        *known = surface.search().nearest(place);
        *known
    });
    found.offset()
}

/// Pair of a moved and a fixed point with the plane's normal and the sample's deviation; `None` beyond
/// `reach`.
fn as_pair(
    sample: &Sample,
    (moved, fixed, normal): (Point3<f64>, Point3<f64>, Vector3<f64>),
    unit: f64,
    reach: f64,
) -> Option<Pair> {
    let offset = (moved - fixed) / unit;
    let squared_distance = offset.norm_squared();
    (squared_distance < reach * reach).then_some(Pair {
        place: moved.coords / unit,
        normal,
        residual: offset.dot(&normal),
        squared_distance,
        deviation: sample.deviation,
    })
}
