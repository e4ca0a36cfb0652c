//! Poses near a rough one: a grid of starts, reduced to the few that fit on coarse surfaces.

use nalgebra::{Matrix3, Point3, Vector3, Vector6};

use crate::cloud::Cloud;
use crate::error::Result;
use crate::execution::Execution;
use crate::features::normals::{Neighborhood, surfaces};
use crate::features::voxels::thin;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::points::Points;
use crate::verification::{Side, Surface, verify};

use super::level::{Level, Outside, Pair};
use super::motions::moved;
use super::settings::UNIT;

/// Coarse voxels, in voxels, and their least size as a share of the radius.
const COARSER: f64 = 3.0;
const OF_RADIUS: f64 = 0.14;
/// Largest coarse voxel as a share of the smaller diagonal.
const OF_CLOUD: f64 = 0.16;
/// Distance of starts, in coarse voxels, and angle between them, in degrees.
const STEP: f64 = 2.7;
const TURN: f64 = 15.0;
/// Radius of the planes of normals, in coarse voxels, and their most neighbours.
const NORMAL_RADIUS: f64 = 2.0;
const NORMAL_NEIGHBORS: usize = 30;
/// Slack of the bounds, in voxels and in degrees.
const SLACK: f64 = 1.0;

/// A rough pose, and its largest error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearby {
    /// Pose of the source in the target's frame.
    pub pose: Rigid,
    /// Largest error of the rotation, in degrees.
    pub angle: f64,
    /// Largest error at the middle of the source, a length.
    pub radius: f64,
}

impl Nearby {
    /// Returns whether a pose is near enough, to a voxel and a degree.
    pub fn holds(&self, pose: &Rigid, source: &Level) -> bool {
        let cosine = ((pose.rotation.transpose() * self.pose.rotation).trace() - 1.0) / 2.0;
        let middle = Point3::from(source.scan().centroid());
        let away = (pose.apply(&middle) - self.pose.apply(&middle)).norm();
        cosine >= (self.angle + SLACK).to_radians().cos() && away <= self.radius + SLACK * source.voxel()
    }

    /// Proposes poses: the best shifts of each turn of a grid, on coarse surfaces.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn propose(&self, pair: Pair<'_>, execution: &Execution) -> Result<Vec<Rigid>> {
        let (source, target) = (pair.source.scan(), pair.target.scan());
        let diagonals = [source.diagonal(), target.diagonal()];
        let coarse = (COARSER * pair.voxel()).max(OF_RADIUS * self.radius);
        let size = coarse.min(OF_CLOUD * diagonals[0].min(diagonals[1])).max(pair.voxel());
        let one = coarse_surface(pair.source, size, execution)?;
        let other = coarse_surface(pair.target, size, execution)?;
        let middle = self.pose.apply(&Point3::from(source.centroid())).coords;
        let apart = (middle - target.centroid()).norm();
        let radius = self.radius.min(apart + f64::midpoint(diagonals[0], diagonals[1]));
        let shifts = ball(radius, STEP * size, target.axes())?;
        let mut found = Vec::new();
        for turn in ball(self.angle.to_radians(), TURN.to_radians(), target.axes())? {
            let turned = moved(&self.pose, &Vector6::new(turn.x, turn.y, turn.z, 0.0, 0.0, 0.0), &middle);
            let start = |shift: &Vector3<f64>| Rigid { translation: turned.translation + shift, ..turned };
            let starts = memory::collect(shifts.iter().map(start))?;
            let best = verify(&one, &other, &starts, None, execution)?;
            memory::extend(&mut found, &memory::collect(best.iter().map(|one| one.pose))?)?;
        }
        Ok(found)
    }
}

/// Returns the points of a grid along some axes around the origin, with none beyond a radius.
fn ball(radius: f64, step: f64, axes: &Matrix3<f64>) -> Result<Vec<Vector3<f64>>> {
    let count = (radius / step).ceil().max(1.0) as i64;
    let tick = |k: i64| radius * k as f64 / count as f64;
    let ticks = || -count..=count;
    let places = ticks().flat_map(|x| ticks().flat_map(move |y| ticks().map(move |z| (x, y, z))));
    let places = places.map(|(x, y, z)| Vector3::new(tick(x), tick(y), tick(z)));
    let within = places.filter(|place| place.norm() <= radius * (1.0 + 1e-9));
    memory::collect(within.map(|place| axes.transpose() * place))
}

fn coarse_surface(level: &Level, size: f64, execution: &Execution) -> Result<Surface> {
    let rows = memory::collect(level.points().iter().map(|&point| point.into()))?;
    let thinned = thin(&Points::from_rows("voxels", &rows)?, None, size, execution)?;
    let cloud = Cloud::from_rows("voxels", &thinned.points)?;
    let around = Neighborhood::NearestWithin(NORMAL_NEIGHBORS, NORMAL_RADIUS * size);
    let eye = level.viewpoint().map_or(Point3::origin(), Point3::from);
    let planes = surfaces(&cloud, around, eye, execution)?;
    let normals = memory::collect(planes.iter().map(|plane| plane.normal))?;
    let side = match level.outside() {
        Outside::Viewpoint(eye) | Outside::Frames(Some(eye)) => Side::Viewpoint(eye),
        Outside::Given => Side::Known,
        Outside::Frames(None) => Side::Unknown,
    };
    Surface::new(cloud.points(), &normals, UNIT * size, side, execution)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_is_a_grid_around_its_centre() -> Result<()> {
        let axes = Matrix3::identity();
        let places = ball(2.0, 1.0, &axes)?;
        assert_eq!(places.len(), 33);
        assert!(places.iter().any(|place| place.norm() < 1e-12));
        assert!(places.iter().all(|place| place.norm() < 2.0 + 1e-6));
        assert_eq!(ball(1.0, 5.0, &axes)?.len(), 7);
        Ok(())
    }
}
