//! Points that occlude each other from a viewpoint.

use nalgebra::Vector3;

use crate::cloud::Cloud;
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;

use super::motions::quantile;

/// Returns whether points lie behind each other from a viewpoint: it is wrong, or the cloud is no single scan.
///
/// Of a single scan, the points nearest in direction lie at nearly the same depth, but for edges.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn shows_layers(
    points: &Points,
    viewpoint: &Vector3<f64>,
    diagonal: f64,
    voxel: f64,
    execution: &Execution,
) -> Result<bool> {
    /// Points that are looked at, directions among them, one of so many first, nearest directions of each.
    const LOOKED_AT: usize = 20_000;
    const DIRECTIONS: usize = 1000;
    const FIRST: usize = 8;
    const NEAR: usize = 4;
    /// Least difference of two depths, in voxels.
    const LAYERS_APART: f64 = 3.0;
    /// Share of directions with several depths that edges explain.
    const MOST_LAYERED: f64 = 0.015;
    /// Distance of the nearest surfaces, in diagonals, below which a scan's rings and plants explain more.
    const LEAST_DISTANCE: f64 = 0.045;
    let place = viewpoint - points.center();
    let rays = points.rows().step_by(points.len() / LOOKED_AT + 1).map(|row| Vector3::from(row) - place);
    let rays = memory::collect(rays.filter(|ray| ray.norm() > 0.0))?;
    let depths = memory::collect(rays.iter().map(Vector3::norm))?;
    if quantile(&mut memory::copied(&depths)?, 0.01) < LEAST_DISTANCE * diagonal {
        return Ok(false);
    }
    let units = memory::collect(rays.iter().zip(&depths).map(|(ray, depth)| (ray / *depth).into()))?;
    let sphere = Cloud::from_rows("rays", &units)?;
    let search = sphere.nearest(execution)?;
    let some = memory::collect((0..rays.len()).step_by(rays.len() / DIRECTIONS + 1))?;
    let share = |rows: &[usize]| -> Result<f64> {
        let near = search.of_rows(rows, NEAR, execution)?;
        let is_apart = |(row, near): &(&usize, &[u32])| {
            let others = near.iter().map(|&other| (depths[other as usize] - depths[**row]).abs());
            others.fold(f64::INFINITY, f64::min) > LAYERS_APART * voxel
        };
        Ok(rows.iter().zip(near.chunks(NEAR)).filter(is_apart).count() as f64 / rows.len().max(1) as f64)
    };
    // Most scans have none: then a few directions suffice.
    let few = memory::collect(some.iter().step_by(FIRST).copied())?;
    Ok(share(&few)? > 0.0 && share(&some)? > MOST_LAYERED)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_behind_each_other_are_layers() -> Result<()> {
        let look = |depth: &dyn Fn(u32) -> f64| {
            let ray = |i: u32| [f64::from(i % 60) / 60.0, f64::from(i / 60) / 60.0, 1.0];
            let rows = (0..3600).map(|i| ray(i).map(|part| part * depth(i))).collect::<Vec<_>>();
            let points = Points::from_rows("points", &rows)?;
            shows_layers(&points, &Vector3::zeros(), 20.0, 0.3, &Execution::default())
        };
        assert!(!look(&|_| 10.0)?);
        assert!(!look(&|i| if i % 60 < 30 { 10.0 } else { 13.0 })?); // an edge
        let bit = |i: u32| (i.wrapping_mul(i).wrapping_add(i / 7).wrapping_mul(2_654_435_761) >> 13) & 1;
        assert!(look(&|i| if bit(i) == 0 { 10.0 } else { 13.0 })?);
        Ok(())
    }
}
