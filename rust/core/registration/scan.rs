//! A cloud before it is downsampled.

use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::{Matrix3, Vector3};

use crate::cloud::{Cloud, Own};
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;
use crate::verification::FineSurface;

use super::motions::{median, quantile, quantile_of_many, some_rows};

/// Distance from the median beyond which a point may be an outlier, in multiples of the 9th decile of these distances.
const FAR: f64 = 3.0;
/// Edge of the cubes around candidates, in the same unit, and the points of a cube that is not an outlier.
const ROOM: f64 = 0.5;
const ALONE: usize = 4;
/// Share of the points beyond which points far from the others are no outliers.
const MOST_OUTLIERS: f64 = 0.05;

/// A cloud, with its own axes and the normals of its file.
#[derive(Debug)]
pub struct Scan {
    cloud: Arc<Cloud>,
    normals: Option<Vec<Vector3<f64>>>,
    own: Arc<Own>,
    fine: Mutex<Vec<(f64, Option<Arc<FineSurface>>)>>,
}

impl Scan {
    /// Takes a cloud, and normals if its file has them.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(cloud: Arc<Cloud>, normals: Option<Vec<Vector3<f64>>>) -> Result<Self> {
        let own = cloud.own()?;
        Ok(Self { cloud, normals, own, fine: Mutex::default() })
    }

    /// Returns the scan in another unit, of which its own is the scale.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn scaled(&self, scale: f64) -> Result<Self> {
        let cloud = Cloud::new(self.points().scaled(scale)?);
        Self::new(Arc::new(cloud), self.normals.as_deref().map(memory::copied).transpose()?)
    }

    /// Returns the points with their searches.
    pub fn cloud(&self) -> &Cloud {
        &self.cloud
    }

    /// Returns the points, relative to their mean.
    pub fn points(&self) -> &Points {
        self.cloud.points()
    }

    /// Returns the mean of the points.
    pub fn centroid(&self) -> Vector3<f64> {
        self.points().center()
    }

    /// Returns the normals of the file.
    pub fn normals(&self) -> Option<&[Vector3<f64>]> {
        self.normals.as_deref()
    }

    /// Returns the points along the cloud's own axes.
    pub fn own(&self) -> &Own {
        &self.own
    }

    /// Returns the rotation into the cloud's own axes.
    pub fn axes(&self) -> &Matrix3<f64> {
        &self.own.0.axes
    }

    /// Returns the fine surface of a spacing, kept for all levels; none if the cloud is too sparse for it.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn fine_surface(&self, spacing: f64, execution: &Execution) -> Result<Option<Arc<FineSurface>>> {
        let known = |kept: &[(f64, Option<Arc<FineSurface>>)]| {
            kept.iter().find(|one| one.0.total_cmp(&spacing).is_eq()).map(|one| one.1.clone())
        };
        if let Some(found) = known(&self.fine.lock().unwrap_or_else(PoisonError::into_inner)) {
            return Ok(found);
        }
        let made = match FineSurface::of_own(&self.own, spacing, execution) {
            Ok(surface) => Some(Arc::new(surface)),
            Err(Error::InvalidInput { .. }) => None,
            Err(error) => return Err(error),
        };
        let mut kept = self.fine.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = known(&kept) {
            return Ok(found); // of another thread
        }
        memory::push(&mut kept, (spacing, made.clone()))?;
        Ok(made)
    }

    /// Returns the diagonal of the box around the cloud along its own axes.
    pub fn diagonal(&self) -> f64 {
        self.own.1.diagonal()
    }
}

/// Returns the rows of outliers: single points far from all others, unless they are many.
///
/// With r the 9th decile of the distances from the median, a point beyond 3 r along one of the cloud's own axes is an outlier
/// if a cube of side r / 2 around it has fewer than four points.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn find_outliers(cloud: &Cloud) -> Result<Vec<usize>> {
    let own = cloud.own()?;
    let points = &own.1;
    if points.is_empty() || surely_has_none(points)? {
        return Ok(Vec::new());
    }
    let mut center = Vector3::zeros();
    for (axis, values) in [&points.x, &points.y, &points.z].into_iter().enumerate() {
        center[axis] = quantile_of_many(points.len(), |row| values[row], 0.5)?;
    }
    let size = quantile_of_many(points.len(), |row| (points.get(row).coords - center).norm(), 0.9)?;
    let is_far = |place: Vector3<f64>| (place - center).amax() > FAR * size;
    if size <= 0.0 {
        return Ok(Vec::new());
    }
    let far = memory::collect((0..points.len()).filter(|&row| is_far(points.get(row).coords)))?;
    let mut alone = memory::filled(true, far.len())?;
    for shift in [0.0, 0.5] {
        // Points of a surface may lie on both sides of a wall between two cubes.
        let cube = |row: &usize| {
            <[i64; 3]>::from(
                ((points.get(*row).coords - center) / (ROOM * size))
                    .map(|part| (part + shift).floor() as i64),
            )
        };
        let cubes = memory::collect(far.iter().map(cube))?;
        let mut sorted = memory::copied(&cubes)?;
        sorted.sort_unstable();
        for (is_alone, cube) in alone.iter_mut().zip(&cubes) {
            let first = sorted.partition_point(|other| other < cube);
            let count = sorted[first..].partition_point(|other| other == cube);
            *is_alone &= count < ALONE;
        }
    }
    let outliers = memory::collect(far.iter().zip(&alone).filter(|(_, alone)| **alone).map(|(&row, _)| row))?;
    if outliers.len() as f64 > MOST_OUTLIERS * points.len() as f64 { Ok(Vec::new()) } else { Ok(outliers) }
}

/// Returns whether some of the points show that the box of all lies well within the bounds of outliers.
fn surely_has_none(points: &Points) -> Result<bool> {
    const SOME: usize = 2000;
    const SURELY: f64 = 0.9; // of the distance of outliers: ten standard deviations of the decile of so many
    let some = memory::collect(some_rows(points.len(), SOME).map(|row| points.get(row).coords))?;
    let mut center = Vector3::zeros();
    for axis in 0..3 {
        center[axis] = median(&mut memory::collect(some.iter().map(|place| place[axis]))?);
    }
    let size = quantile(&mut memory::collect(some.iter().map(|place| (place - center).norm()))?, 0.9);
    let (low, extent) = points.bounding_box();
    let (low, extent) = (Vector3::from(low), Vector3::from(extent));
    let most = (low - center).amax().max((low + extent - center).amax());
    Ok(most <= SURELY * FAR * size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_far_points_are_outliers() -> Result<()> {
        let raster = |i: u32| [f64::from(i % 30), f64::from(i / 30), 0.0];
        let mut rows: Vec<[f64; 3]> = (0..900).map(raster).collect();
        assert!(find_outliers(&Cloud::from_rows("points", &rows)?)?.is_empty());
        rows.push([500.0, 3.0, 7.0]);
        rows.push([-300.0, 3.0, 900.0]);
        assert_eq!(find_outliers(&Cloud::from_rows("points", &rows)?)?, [900, 901]);
        rows.extend((0..20).map(|i| [500.0 + f64::from(i % 5) / 10.0, 200.0 + f64::from(i / 5) / 10.0, 7.0]));
        assert_eq!(find_outliers(&Cloud::from_rows("points", &rows)?)?, [900, 901]);
        assert!(find_outliers(&Cloud::from_rows("points", &[])?)?.is_empty());
        assert!(find_outliers(&Cloud::from_rows("points", &[[1.0; 3]; 9])?)?.is_empty());
        Ok(())
    }

    #[test]
    fn the_diagonal_is_along_the_own_axes() -> Result<()> {
        let turned = |i: u32| [f64::from(i), f64::from(i), f64::from(i % 2)];
        let cloud = Cloud::from_rows("points", &(0..101).map(turned).collect::<Vec<_>>())?;
        let scan = Scan::new(Arc::new(cloud), None)?;
        assert!((scan.diagonal() - 20_001_f64.sqrt()).abs() < 0.1);
        assert!((scan.centroid().x - 50.0).abs() < 1e-12 && scan.normals().is_none());
        Ok(())
    }
}
