//! A surface prepared for scoring: points with normals, nearest-point grids, ranges, samples.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use nalgebra::{Matrix3, Vector3};

use crate::error::{Error, Result, positive};
use crate::execution::Execution;
use crate::features::harris3d::check_normals;
use crate::geometry::own_axes::{OwnFrame, own_axes};
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::points::Points;
use crate::verification::group::{Coordinates, Element, Group, LANES};
use crate::verification::nearest_grid::{self, NONE, NearestGrid};
use crate::verification::pose::{Pose, nearest_rotation};
use crate::verification::range_map::RangeMap;
use crate::verification::sampling;

/// Samples of the last round; earlier rounds use fewer.
const MOST_SAMPLES: usize = 2_500;
/// Fewest points with a normal.
const LEAST_POINTS: usize = 10;
/// Least diagonal of the bounding box, in units; smaller surfaces cannot distinguish poses.
const LEAST_SPAN: f64 = 10.0;
/// Largest distance of the viewpoint, in units; beyond it, single precision loses the depths.
const MOST_RANGE: f64 = 1e6;

/// Cell size and reach of the coarse grid, in units.
const COARSE: (f32, f32) = (1.5, 8.0);
/// Cell size and reach of the fine grid, in units.
const FINE: (f32, f32) = (1.0, 4.0);

/// Knowledge of the side that normals point to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Side {
    /// Unknown: a normal and its opposite are equivalent.
    Unknown,
    /// The normals of both surfaces point to the same side.
    Known,
    /// As `Known`, and the points are one scan from this viewpoint.
    Viewpoint([f64; 3]),
}

/// A surface that poses are scored on. Lengths are in units; points are relative to their mean.
#[derive(Debug)]
pub struct Surface {
    unit: f64,
    frame: OwnFrame,
    radius: f32,
    oriented: bool,
    elements: Vec<Element>,
    samples: Vec<Group>,
    /// Number of samples in the groups.
    drawn: usize,
    coarse: NearestGrid,
    fine: NearestGrid,
    ranges: Option<RangeMap>,
}

impl Surface {
    /// Builds a surface from points and their normals, NaN for none; the unit is about 0.4 of the distance
    /// between points.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for an invalid unit, a number of normals other than that of the points, fewer
    /// than 10 points with a normal, points that span fewer than 10 units or too many for the grids, or a
    /// viewpoint too far away;
    /// [`Error::Interrupted`], [`Error::OutOfMemory`].
    pub fn new(
        points: &Points,
        normals: &[Vector3<f64>],
        unit: f64,
        side: Side,
        execution: &Execution,
    ) -> Result<Self> {
        let unit = positive("unit", unit)?;
        check_normals(points, Some(normals))?;
        check_span(points, unit)?;
        let frame = OwnFrame { axes: own_axes(points), center: points.center() };
        let eye = viewpoint(&frame, unit, side)?;
        let elements = elements(points, normals, unit, &frame.axes)?;
        execution.check()?;
        let normals = memory::collect(elements.iter().map(|element| element.normal))?;
        let oriented = side != Side::Unknown;
        let drawn = sampling::draw(&normals, oriented, MOST_SAMPLES)?;
        if drawn.len() < LEAST_POINTS {
            let remedy = format!("give at least {LEAST_POINTS} points that have one");
            return Err(Error::invalid("normals", format!("{} finite ones", drawn.len()), remedy));
        }
        execution.check()?;
        let places = memory::collect(elements.iter().map(|element| element.point))?;
        Ok(Self {
            unit,
            frame,
            radius: root_mean_square(&places),
            oriented,
            samples: in_groups(drawn.iter().map(|&i| elements[i as usize]))?,
            drawn: drawn.len(),
            coarse: NearestGrid::new(&places, COARSE, execution)?,
            fine: NearestGrid::new(&places, FINE, execution)?,
            ranges: eye.map(|eye| RangeMap::new(&places, eye, execution)).transpose()?,
            elements,
        })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.elements.len()
    }

    /// Always false: a surface has points.
    pub fn is_empty(&self) -> bool {
        self.elements.is_empty()
    }

    /// The unit of all lengths, in the data's unit.
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// The points' own axes, about their mean: the frame of the elements, the grids and the ranges, in units.
    pub(super) fn frame(&self) -> &OwnFrame {
        &self.frame
    }

    /// Converts a pose of the data to one between the surfaces' coordinates.
    pub(super) fn pose_onto(&self, target: &Self, pose: &Rigid) -> Pose {
        let pose = self.frame.pose_onto(&target.frame, pose);
        let translation = (pose.translation / self.unit).map(|length| length as f32);
        Pose { rotation: pose.rotation.map(|number| number as f32), translation }.orthonormal()
    }

    /// Converts a pose between the surfaces' coordinates to one of the data.
    pub(super) fn pose_in_data(&self, target: &Self, pose: &Pose) -> Rigid {
        let rotation = nearest_rotation(&pose.rotation.map(f64::from));
        let translation = pose.translation.map(f64::from) * self.unit;
        self.frame.pose_in_data(&target.frame, &Rigid { rotation, translation })
    }

    /// Root mean square distance of the points from their mean, in units.
    pub(super) fn radius(&self) -> f32 {
        self.radius
    }

    pub(super) fn is_oriented(&self) -> bool {
        self.oriented
    }

    pub(super) fn elements(&self) -> &[Element] {
        &self.elements
    }

    /// The groups of the first samples drawn, at most `count`, and their number of samples.
    pub(super) fn samples(&self, count: usize) -> (&[Group], usize) {
        let count = count.min(self.drawn);
        (&self.samples[..count.div_ceil(LANES)], count)
    }

    /// Number of blocks of the grids whose memory was refused so far.
    fn refusals(&self) -> usize {
        self.coarse.refusals() + self.fine.refusals()
    }

    pub(super) fn ranges(&self) -> Option<&RangeMap> {
        self.ranges.as_ref()
    }

    /// Nearest points by the coarse or the fine grid; zero if there is none.
    #[inline(always)]
    pub(super) fn nearest(&self, places: &Coordinates, coarse: bool) -> ([bool; LANES], Group) {
        let grid = if coarse { &self.coarse } else { &self.fine };
        let found = grid.get(places);
        let (mut is_near, mut near) = ([false; LANES], Group::default());
        for lane in 0..LANES {
            if found[lane] != NONE {
                is_near[lane] = true;
                near.set(lane, &self.elements[found[lane] as usize]);
            }
        }
        (is_near, near)
    }
}

/// Result of a computation on two surfaces; an error if memory for blocks of their grids was refused in the
/// meantime.
pub(super) fn look_at<T>(source: &Surface, target: &Surface, look: impl FnOnce() -> Result<T>) -> Result<T> {
    let refusals = || source.refusals() + target.refusals();
    let before = refusals();
    let found = look()?;
    if refusals() == before { Ok(found) } else { Err(nearest_grid::refused()) }
}

fn in_groups(elements: impl Iterator<Item = Element>) -> Result<Vec<Group>> {
    memory::collect(memory::collect(elements)?.chunks(LANES).map(Group::of))
}

fn check_span(points: &Points, unit: f64) -> Result<()> {
    let span = points.diagonal() / unit;
    if span >= LEAST_SPAN {
        return Ok(());
    }
    let got = format!("{unit}, of which the {} points span {span:.3}", points.len());
    Err(Error::invalid(
        "unit",
        got,
        format!("give about 0.4 of the distance between points; a surface spans {LEAST_SPAN} units or more"),
    ))
}

/// The viewpoint in the surface's coordinates.
fn viewpoint(frame: &OwnFrame, unit: f64, side: Side) -> Result<Option<Vector3<f32>>> {
    let Side::Viewpoint(viewpoint) = side else { return Ok(None) };
    let eye = frame.axes * (Vector3::from(viewpoint) - frame.center) / unit;
    if eye.norm() <= MOST_RANGE {
        return Ok(Some(eye.map(|number| number as f32)));
    }
    let remedy = format!("give the scanner's place, at most {MOST_RANGE:e} units from the points, or None");
    Err(Error::invalid("viewpoint", format!("{viewpoint:?}"), remedy))
}

fn elements(
    points: &Points,
    normals: &[Vector3<f64>],
    unit: f64,
    axes: &Matrix3<f64>,
) -> Result<Vec<Element>> {
    let element = |(i, normal): (usize, &Vector3<f64>)| Element {
        point: (axes * points.get(i).coords / unit).map(|number| number as f32),
        normal: (axes * unit_length(normal)).map(|number| number as f32),
    };
    memory::collect(normals.iter().enumerate().map(element))
}

/// The normal scaled to unit length, or zero if there is none.
fn unit_length(normal: &Vector3<f64>) -> Vector3<f64> {
    let scale = normal.amax();
    if normal.iter().all(|number| number.is_finite()) && scale > 0.0 {
        return (normal / scale).normalize();
    }
    Vector3::zeros()
}

fn root_mean_square(points: &[Vector3<f32>]) -> f32 {
    let sum: f64 = points.iter().map(|p| f64::from(p.norm_squared())).sum();
    (sum / points.len().max(1) as f64).sqrt() as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn takes_one_normal_per_point() -> Result<()> {
        let rows: Vec<[f64; 3]> = (0..20).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        let points = Points::from_rows("points", &rows)?;
        for count in [19, 21] {
            let normals = vec![Vector3::z(); count];
            let built = Surface::new(&points, &normals, 1.0, Side::Unknown, &Execution::default());
            assert!(matches!(built, Err(Error::InvalidInput { what, .. }) if what == "normals"));
        }
        Ok(())
    }
}
