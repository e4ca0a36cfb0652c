//! Proximity of the points of one cloud to those of another: whether a point is near, and the offset of the
//! nearest.

use nalgebra::Point3;
use rayon::prelude::*;

use super::ball_search::BallSearch;
use super::grid::Grid;
use crate::error::{Result, positive};
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;

/// Cells per radius: the first point found decides a query, so larger cells than for a ball search suffice.
const CELLS_PER_RADIUS: f64 = 1.0;
/// Queries per task.
const QUERIES_PER_TASK: usize = 256;
/// Upper bound of the rounding of a coordinate in the grid, relative to the greatest magnitude.
const ROUNDING: f64 = 32.0 * f64::EPSILON;

/// Whether each of the points has at least one of the others within `radius`, by the distance of the given
/// coordinates: ``sqrt(dx^2 + dy^2 + dz^2) <= radius``, each operation rounded once.
///
/// Points with NaN coordinates have no near point. Cost O((N + M) log M) for small balls.
///
/// # Errors
/// [`crate::Error::InvalidInput`] unless the radius is positive and the squares of the others' coordinates
/// are finite;
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn any_within(
    points: &[[f64; 3]],
    others: &[[f64; 3]],
    radius: f64,
    execution: &Execution,
) -> Result<Vec<bool>> {
    positive("radius", radius)?;
    let mut found = memory::filled(false, points.len())?;
    if others.is_empty() {
        return Ok(found);
    }
    let centred = Points::from_rows("others", others)?;
    let center = <[f64; 3]>::from(centred.center());
    let largest = others.iter().map(magnitude).fold(0.0, f64::max);
    let grid = Grid::new(&centred, (radius / CELLS_PER_RADIUS).max(ROUNDING * largest))?;
    let others = grid.reorder(others)?;
    found.par_chunks_mut(QUERIES_PER_TASK).zip(points.par_chunks(QUERIES_PER_TASK)).try_for_each(
        |(found, points)| {
            execution.check()?;
            for (found, point) in found.iter_mut().zip(points) {
                // The grid holds rounded coordinates: search it with a larger reach, then test the given
                // coordinates.
                let reach = radius * (1.0 + ROUNDING) + ROUNDING * (largest + magnitude(point));
                let place = std::array::from_fn(|k| point[k] - center[k]);
                let near = grid.visit_runs(place, reach, |start, end| {
                    others[start..end].iter().any(|other| distance(point, other) <= radius).then_some(())
                });
                *found = near.is_some();
            }
            Ok(())
        },
    )?;
    Ok(found)
}

/// Returns the vector from each of the points to the nearest of the others, if nearer than `radius`; NaN
/// otherwise.
///
/// # Errors
/// As for [`any_within`].
pub fn nearest_offsets(
    points: &[[f64; 3]],
    others: &[[f64; 3]],
    radius: f64,
    execution: &Execution,
) -> Result<Vec<[f64; 3]>> {
    positive("radius", radius)?;
    let mut found = memory::filled([f64::NAN; 3], points.len())?;
    if others.is_empty() {
        return Ok(found);
    }
    let others = Points::from_rows("others", others)?;
    let search = BallSearch::new(&others, radius)?;
    found.par_iter_mut().zip(points).with_min_len(QUERIES_PER_TASK).try_for_each(|(found, point)| {
        execution.check()?;
        if let Some(offset) = search.nearest(&Point3::from(Point3::from(*point) - others.center())).offset() {
            *found = offset.into();
        }
        Ok(())
    })?;
    Ok(found)
}

/// Greatest magnitude of a coordinate.
fn magnitude(point: &[f64; 3]) -> f64 {
    point.iter().fold(0.0, |most: f64, coordinate| most.max(coordinate.abs()))
}

#[inline]
fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let [x, y, z]: [f64; 3] = std::array::from_fn(|k| a[k] - b[k]);
    (x * x + y * y + z * z).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of a small generator, with many equal distances.
    fn rows(count: u32, seed: u32, scale: f64, offset: f64) -> Vec<[f64; 3]> {
        let number = |i: u32| offset + scale * f64::from((i * 7919 + seed * 104_729) % 101 % 17);
        (0..count).map(|i| [number(3 * i), number(3 * i + 1), number(3 * i + 2)]).collect()
    }

    #[test]
    fn agrees_with_all_pairs() -> Result<()> {
        for (scale, offset) in [(1.0, 0.0), (0.1, 1e6), (1e-3, -1e9), (1e40, 0.0)] {
            let (points, others) = (rows(300, 1, scale, offset), rows(40, 2, scale, offset));
            // Lattice distances: many pairs have a distance of exactly the radius, up to rounding.
            for radius in [1.0, 2.0, 3.0, 5.0_f64.sqrt(), 6.0, 40.0] {
                let radius = radius * scale;
                let wanted: Vec<bool> =
                    points.iter().map(|p| others.iter().any(|q| distance(p, q) <= radius)).collect();
                assert_eq!(any_within(&points, &others, radius, &Execution::default())?, wanted);
            }
        }
        Ok(())
    }

    #[test]
    fn nothing_is_near_nothing() -> Result<()> {
        let execution = Execution::default();
        assert_eq!(any_within(&[[0.0; 3]], &[], 1.0, &execution)?, [false]);
        assert!(any_within(&[], &[[0.0; 3]], 1.0, &execution)?.is_empty());
        let strange = [[f64::NAN, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0], [f64::MAX; 3], [0.0; 3]];
        assert_eq!(any_within(&strange, &[[0.0; 3]], 1.0, &execution)?, [false, false, false, true]);
        Ok(())
    }

    #[test]
    fn the_nearest_of_all_others_is_found() -> Result<()> {
        let (points, others) = (rows(300, 1, 1.0, 1e6), rows(40, 2, 1.0, 1e6));
        let offsets = nearest_offsets(&points, &others, 1.2, &Execution::default())?;
        for (point, offset) in points.iter().zip(&offsets) {
            let least = others.iter().map(|other| distance(point, other)).fold(f64::INFINITY, f64::min);
            if least < 1.2 {
                assert!((distance(&[0.0; 3], offset) - least).abs() < 1e-6);
                let reached: [f64; 3] = std::array::from_fn(|k| point[k] + offset[k]);
                assert!(others.iter().any(|other| distance(other, &reached) < 1e-6));
            } else {
                assert!(offset.iter().all(|part| part.is_nan()));
            }
        }
        assert!(
            offsets.iter().any(|offset| offset[0].is_nan())
                && offsets.iter().any(|offset| !offset[0].is_nan())
        );
        assert!(nearest_offsets(&[[0.0; 3]], &[], 1.0, &Execution::default())?[0][0].is_nan());
        Ok(())
    }

    #[test]
    fn radius_must_be_positive() {
        assert!(any_within(&[], &[], 0.0, &Execution::default()).is_err());
        assert!(nearest_offsets(&[], &[], 0.0, &Execution::default()).is_err());
    }
}
