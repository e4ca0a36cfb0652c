//! Keypoints as indices into a cloud: validation, and selection by support.

use nalgebra::Point3;

use crate::cloud::Cloud;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;

/// Positions of the keypoints.
///
/// # Errors
/// [`Error::InvalidInput`] for an index out of range.
pub fn locations(points: &Points, keypoints: &[usize]) -> Result<Vec<Point3<f64>>> {
    for (row, &index) in keypoints.iter().enumerate() {
        if index >= points.len() {
            let remedy = format!("the cloud has {} points", points.len());
            return Err(Error::invalid("keypoints", format!("index {index} in row {row}"), remedy));
        }
    }
    memory::collect(keypoints.iter().map(|&index| points.get(index)))
}

/// The keypoints that have at least `min_points` points within `radius`, themselves included.
///
/// The paper's authors drop keypoints with fewer than 10 points within 15 pr.
///
/// # Errors
/// [`Error::InvalidInput`] for a radius that is not positive, or an index out of range;
/// [`Error::Interrupted`].
pub fn drop_isolated(
    cloud: &Cloud,
    keypoints: &[usize],
    radius: f64,
    min_points: usize,
    execution: &Execution,
) -> Result<Vec<usize>> {
    let centers = locations(cloud.points(), keypoints)?;
    let counts = cloud.balls(radius)?.map_at(&centers, 0, execution, |_, ball| Ok(ball.len()))?;
    memory::collect(keypoints.iter().zip(counts).filter(|&(_, count)| count >= min_points).map(|(&i, _)| i))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drops_keypoints_without_support() -> Result<()> {
        let rows = [[0.0; 3], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [9.0, 0.0, 0.0]];
        let cloud = Cloud::from_rows("points", &rows)?;
        assert_eq!(drop_isolated(&cloud, &[0, 3], 1.0, 3, &Execution::default())?, [0]);
        assert!(drop_isolated(&cloud, &[4], 1.0, 3, &Execution::default()).is_err());
        Ok(())
    }
}
