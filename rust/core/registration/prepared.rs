//! A scan prepared for registration with others.

use std::sync::{Arc, OnceLock};

use crate::cloud::Cloud;
use crate::error::{Error, Result};
use crate::execution::Execution;

use super::lazy::lazily;
use super::level::{Level, Outside, Radii, Refusal};
use super::scan::Scan;
use super::settings::{FACTORS, FEW_POINTS, FEW_VOXELS, LEAST_COARSE, MOST_VOXELS, PREPARED};

/// A scan with its levels from coarse to fine, each made when it is first needed.
#[derive(Debug)]
pub struct Prepared {
    scan: Arc<Scan>,
    voxel: f64,
    radii: Radii,
    outside: Outside,
    most: usize,
    is_single: bool,
    levels: [OnceLock<std::result::Result<Arc<Level>, Refusal>>; FACTORS.len()],
    without_viewpoint: OnceLock<Arc<Self>>,
}

impl Prepared {
    /// Prepares a scan for voxels of a size, of which there may be `most` ([`MOST_VOXELS`] for scans
    /// that are matched as a whole); nothing is computed yet.
    pub fn new(scan: Arc<Scan>, voxel: f64, radii: Radii, outside: Outside, most: usize) -> Self {
        let (levels, without_viewpoint) = Default::default();
        Self { scan, voxel, radii, outside, most, is_single: false, levels, without_viewpoint }
    }

    /// Prepares a cloud whose scanner's position may be known; `voxel` is the edge length of the finest voxels, such as that of
    /// [`suit_voxel`](super::suit_voxel).
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn of(cloud: Arc<Cloud>, voxel: f64, viewpoint: Option<[f64; 3]>) -> Result<Self> {
        let outside = viewpoint.map_or(Outside::Frames(None), Outside::Viewpoint);
        Ok(Self::new(Arc::new(Scan::new(cloud, None)?), voxel, Radii::default(), outside, MOST_VOXELS))
    }

    /// Returns a scan with one level only.
    pub fn single(level: Level) -> Self {
        let (scan, voxel, outside) = (Arc::clone(level.scan()), level.voxel(), level.outside());
        let made = Self { is_single: true, ..Self::new(scan, voxel, Radii::default(), outside, usize::MAX) };
        // The cell is empty.
        let _ = made.levels[PREPARED].set(Ok(Arc::new(level)));
        made
    }

    /// Returns the scan in another unit, prepared for voxels of a size in that unit.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn scaled(&self, scale: f64, voxel: f64) -> Result<Self> {
        let place = |eye: [f64; 3]| eye.map(|part| scale * part);
        let outside = match self.outside {
            Outside::Viewpoint(eye) => Outside::Viewpoint(place(eye)),
            Outside::Frames(eye) => Outside::Frames(eye.map(place)),
            Outside::Given => Outside::Given,
        };
        let scan = if scale.total_cmp(&1.0).is_eq() {
            Arc::clone(&self.scan)
        } else {
            Arc::new(self.scan.scaled(scale)?)
        };
        Ok(Self::new(scan, voxel, self.radii, outside, self.most))
    }

    /// Returns the whole scan with nothing known of its viewpoint, prepared once for all partners.
    pub fn without_viewpoint(&self) -> &Self {
        self.without_viewpoint.get_or_init(|| {
            let scan = Arc::clone(&self.scan);
            Arc::new(Self::new(scan, self.voxel, self.radii, Outside::Frames(None), self.most))
        })
    }

    /// Returns whether the scanner's position is known, and the scan is no part of another.
    pub fn sees(&self) -> bool {
        !self.is_single && matches!(self.outside, Outside::Viewpoint(_) | Outside::Frames(Some(_)))
    }

    /// Returns the cloud before it is downsampled.
    pub fn scan(&self) -> &Arc<Scan> {
        &self.scan
    }

    /// Returns the edge length of the prepared voxels.
    pub fn voxel(&self) -> f64 {
        self.voxel
    }

    /// Returns whether there is one level only.
    pub fn is_single(&self) -> bool {
        self.is_single
    }

    /// Returns the level of a row of `FACTORS`, or the reason why there is none.
    ///
    /// # Errors
    /// As for [`Level::new`].
    pub fn level(
        &self,
        row: usize,
        execution: &Execution,
    ) -> Result<std::result::Result<&Arc<Level>, Refusal>> {
        let found = lazily(&self.levels[row], || {
            let (scan, size) = (Arc::clone(&self.scan), FACTORS[row] * self.voxel);
            let least = if row < PREPARED { LEAST_COARSE } else { FEW_VOXELS };
            match Level::new(scan, size, self.radii, self.outside, least..=self.most, execution) {
                // Only the prepared voxel is the caller's choice.
                Err(Error::InvalidInput { .. }) if row != PREPARED => Ok(Err(Refusal::Few(0))),
                made => Ok(made?.map(Arc::new)),
            }
        })?;
        Ok(found.as_ref().map_err(|refusal| *refusal))
    }

    /// Makes the first level that a search uses, with descriptors and fine surface; returns the reason if there is none.
    ///
    /// # Errors
    /// As for [`Level::new`].
    pub fn begin(&self, execution: &Execution) -> Result<Option<Refusal>> {
        let is_small = self.is_single || self.scan.points().len() < FEW_POINTS;
        let mut level = self.level(if is_small { PREPARED } else { 0 }, execution)?;
        if level.is_err() {
            level = self.level(PREPARED, execution)?;
        }
        match level {
            Ok(level) => level.complete(true, execution).map(|()| None),
            Err(why) => Ok(Some(why)),
        }
    }
}
