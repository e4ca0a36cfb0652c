//! Point-cloud resolution *pr*: the mean distance of a point to its nearest other point.

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::geometry::neighbors::NearestNeighbors;

/// Mean distance to the nearest other point, in the unit of the data (paper, section 4.1).
///
/// A point with a duplicate contributes 0, or is ignored with `ignore_zero`. Cost O(N log N).
///
/// # Errors
/// [`Error::InvalidInput`] for fewer than two points, or if every distance is ignored;
/// [`Error::Interrupted`].
pub fn mean_nearest_distance(
    points: &NearestNeighbors,
    ignore_zero: bool,
    execution: &Execution,
) -> Result<f64> {
    if points.len() < 2 {
        let remedy = "a resolution needs at least two points";
        return Err(Error::invalid("points", format!("{} points", points.len()), remedy));
    }
    let distances = nearest_distances(points, execution)?;
    let count = distances.iter().filter(|&&d| !ignore_zero || d > 0.0).count();
    if count == 0 {
        let remedy = "with `ignore_zero`, at least two points must differ";
        return Err(Error::invalid("points", "only coincident points", remedy));
    }
    Ok(distances.iter().sum::<f64>() / count as f64)
}

/// Distance of every point to its nearest other point; infinite without one.
///
/// # Errors
/// [`Error::Interrupted`].
pub fn nearest_distances(points: &NearestNeighbors, execution: &Execution) -> Result<Vec<f64>> {
    points.map_points(1, execution, |_, found| {
        found.first().map_or(f64::INFINITY, |nearest| nearest.squared_distance.sqrt())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::Points;

    fn resolution(points: &Points, ignore_zero: bool) -> Result<f64> {
        let execution = Execution::default();
        mean_nearest_distance(&NearestNeighbors::new(points, &execution)?, ignore_zero, &execution)
    }

    #[test]
    fn mean_of_nearest_distances() -> Result<()> {
        let rows = [[0.0; 3], [1.0, 0.0, 0.0], [4.0, 0.0, 0.0]];
        let points = Points::from_rows("points", &rows)?;
        let pr = resolution(&points, false)?;
        assert!((pr - (1.0 + 1.0 + 3.0) / 3.0).abs() < 1e-15);
        Ok(())
    }

    #[test]
    fn duplicates_count_as_zero_or_are_ignored() -> Result<()> {
        let rows = [[0.0; 3], [0.0; 3], [2.0, 0.0, 0.0]];
        let points = Points::from_rows("points", &rows)?;
        assert!((resolution(&points, false)? - 2.0 / 3.0).abs() < 1e-15);
        assert!((resolution(&points, true)? - 2.0).abs() < 1e-15);
        Ok(())
    }

    #[test]
    fn needs_two_points() -> Result<()> {
        let points = Points::from_rows("points", &[[0.0; 3]])?;
        assert!(resolution(&points, false).is_err());
        Ok(())
    }
}
