//! Classifies the points of one surface by their place relative to the other surface under a pose.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::simd;
use crate::verification::group::{Element, Group, LANES};
use crate::verification::pose::Pose;
use crate::verification::range_map::{RangeMap, Sights};
use crate::verification::schedule::{LAST, check_units};
use crate::verification::score::{ALONG, FACING};
use crate::verification::surface::{Surface, look_at};

/// Points per task.
const CHUNK: usize = 64 * LANES;

/// Place of a moved point relative to the other surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Place {
    /// Occluded from the other's scanner, by either surface; or without a normal; or away from a surface of
    /// unknown viewpoint.
    Unknown = 0,
    /// On the other surface, with an agreeing normal.
    On = 1,
    /// Near the other surface, but not on it, or with a disagreeing normal.
    Off = 2,
    /// In front of the surface that the other's scanner observed: in its free space.
    InFront = 3,
    /// Visible to the other's scanner, in a direction in which it observed nothing.
    Background = 4,
}

/// Places of all points of the source, by the tolerances of the last round of scoring.
///
/// # Errors
/// [`crate::Error::InvalidInput`] unless both surfaces have one unit; [`crate::Error::Interrupted`],
/// [`crate::Error::OutOfMemory`].
pub fn places(source: &Surface, target: &Surface, pose: &Rigid, execution: &Execution) -> Result<Vec<Place>> {
    check_units(source, target)?;
    let pose = source.pose_onto(target, pose);
    let own = target.ranges().map(|ranges| {
        let moved = |element: &Element| pose.rotation * element.point + pose.translation;
        RangeMap::new(&memory::collect(source.elements().iter().map(moved))?, ranges.eye(), execution)
    });
    let own = own.transpose()?;
    look_at(source, target, || moved_places(source, target, &pose, own.as_ref(), execution))
}

/// Places of the moved points; `own` are the sights of the moved source's own viewpoint.
fn moved_places(
    source: &Surface,
    target: &Surface,
    pose: &Pose,
    own: Option<&RangeMap>,
    execution: &Execution,
) -> Result<Vec<Place>> {
    let mut places = memory::filled(Place::Unknown, source.len())?;
    let oriented = source.is_oriented() && target.is_oriented();
    let chunks = places.par_chunks_mut(CHUNK).zip(source.elements().par_chunks(CHUNK));
    chunks.try_for_each(|(places, elements)| {
        execution.check()?;
        simd::run(
            #[inline(always)]
            || {
                for (places, elements) in places.chunks_mut(LANES).zip(elements.chunks(LANES)) {
                    let moved = Group::of(elements).moved(pose);
                    let found = of_group(&moved, target, own, oriented);
                    places.copy_from_slice(&found[..elements.len()]);
                }
            },
        );
        Ok(())
    })?;
    Ok(places)
}

#[inline(always)]
fn of_group(moved: &Group, target: &Surface, own: Option<&RangeMap>, oriented: bool) -> [Place; LANES] {
    let (is_near, near) = target.nearest(&moved.point, false);
    let seen = target.ranges().map(|ranges| ranges.look(moved));
    let own = own.map(|own| own.look(moved));
    let mut places = [Place::Unknown; LANES];
    for lane in 0..LANES {
        let normal = Vector3::from(moved.normal.map(|values| values[lane]));
        let is_visible = own.as_ref().is_none_or(|own| is_visible(own, lane));
        if normal == Vector3::zeros() || !is_visible {
            continue;
        }
        places[lane] = if is_near[lane] {
            near_place(moved, &near, oriented, lane)
        } else {
            seen.as_ref().map_or(Place::Unknown, |seen| far_place(seen, lane))
        };
    }
    places
}

/// Whether a point faces the scanner and is not occluded by its own surface.
#[inline(always)]
fn is_visible(own: &Sights, lane: usize) -> bool {
    own.facing[lane] > FACING && own.in_front[lane] >= -LAST.in_front
}

/// Place of a point with a near point of the other surface.
#[inline(always)]
fn near_place(moved: &Group, near: &Group, oriented: bool, lane: usize) -> Place {
    let d = moved.offset(near, lane);
    let plane: f32 = (0..3).map(|k| d[k] * near.normal[k][lane]).sum();
    let squared = plane * plane + ALONG * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    let is_on = squared < LAST.tolerance * LAST.tolerance && moved.cosine(near, oriented, lane) > LAST.cosine;
    if is_on { Place::On } else { Place::Off }
}

/// Place of a visible point without a near point of the other surface.
#[inline(always)]
fn far_place(seen: &Sights, lane: usize) -> Place {
    if seen.in_front[lane] == f32::INFINITY {
        Place::Background
    } else if seen.in_front[lane] > LAST.in_front {
        Place::InFront
    } else {
        Place::Unknown
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::Points;
    use crate::verification::surface::Side;
    use nalgebra::Matrix3;

    /// A square of points one unit apart, facing up.
    fn sheet(side: Side) -> Result<Surface> {
        let rows: Vec<[f64; 3]> = (0..441).map(|i| [f64::from(i % 21), f64::from(i / 21), 0.0]).collect();
        let points = Points::from_rows("points", &rows)?;
        Surface::new(&points, &vec![Vector3::z(); rows.len()], 1.0, side, &Execution::default())
    }

    /// Place of the middle of a sheet after a shift.
    fn place(target: Side, shift: [f64; 3]) -> Result<Place> {
        let pose = Rigid { rotation: Matrix3::identity(), translation: shift.into() };
        let found = places(&sheet(Side::Known)?, &sheet(target)?, &pose, &Execution::default())?;
        assert_eq!(found.len(), 441);
        Ok(found[220])
    }

    #[test]
    fn places_depend_on_the_observed_surface() -> Result<()> {
        let scanned = Side::Viewpoint([10.0, 10.0, 100.0]);
        assert_eq!(place(scanned, [0.0, 0.0, 0.1])?, Place::On);
        assert_eq!(place(scanned, [0.0, 0.0, 2.5])?, Place::Off);
        assert_eq!(place(scanned, [0.0, 0.0, 20.0])?, Place::InFront);
        assert_eq!(place(scanned, [0.0, 0.0, -20.0])?, Place::Unknown);
        assert_eq!(place(scanned, [90.0, 0.0, 0.0])?, Place::Background);
        assert_eq!(place(Side::Known, [0.0, 0.0, 20.0])?, Place::Unknown);
        Ok(())
    }
}
