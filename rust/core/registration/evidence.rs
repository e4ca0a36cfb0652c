//! Evidence for a pose beside its score: agreeing shape, agreeing planes, violations of free space.
//!
//! A floor and two walls fit any other corner. So each plane counts once, whatever its size, and only from the fifth on.
//! Points off all planes count by cells of four voxels, whose samples have correlated errors.

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::pose_graph::motion::inverse;
use crate::verification::{Alignment, FineSurface, Place, places, plane_distances_of};

use super::level::{FinePair, Level, Pair};
use super::motions::quantile;
use super::planes::NONE;
use super::settings::LEAST_NOISE;

/// Largest distance of a sample's plane from the other surface, in spacings.
const ON: f64 = 0.75;
/// Misfit of a pose under which nothing is paired.
const NOTHING_PAIRED: f64 = 100.0;

/// Evidence for a pose, in both directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {
    /// Cells off all planes in which most of one fine surface agrees with the other; the mean of both directions.
    pub cells: f64,
    /// Independent planes that the pose aligns with planes.
    pub planes: usize,
    /// Share of the voxels seen in both scans that violate the other's free space; none without viewpoints.
    pub crossed: Option<f64>,
}

impl Evidence {
    /// Gathers the evidence for a pose.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn gather(pair: Pair<'_>, fine: FinePair<'_>, pose: &Rigid, execution: &Execution) -> Result<Self> {
        let (back, voxel) = (inverse(pose), pair.voxel());
        let (source, target) = (fine.source, fine.target);
        let forth = count_cells(pair.source, fine.level, (source, target), pose, execution)?;
        let cells = forth + count_cells(pair.target, fine.level, (target, source), &back, execution)?;
        let (one, other) = (pair.source.planes(execution)?, pair.target.planes(execution)?);
        let planes = one.count_agreeing(other, pose, voxel).max(other.count_agreeing(one, &back, voxel));
        let known = pair.source.viewpoint().and(pair.target.viewpoint());
        let crossed = known.map(|_| crossed(pair, pose, execution)).transpose()?;
        Ok(Self { cells: cells as f64 / 2.0, planes, crossed })
    }
}

/// Counts the cells of which most samples near the other surface lie on it.
fn count_cells(
    level: &Level,
    spacing: usize,
    (own, other): (&FineSurface, &FineSurface),
    pose: &Rigid,
    execution: &Execution,
) -> Result<usize> {
    let (cells, count) = level.cells(spacing, own, execution)?;
    let distances = plane_distances_of(own, other, pose, |row| cells[row] != NONE, execution)?;
    let mut counts = memory::filled((0_u32, 0_u32), *count)?;
    for (&cell, distance) in cells.iter().zip(&distances) {
        if distance.is_finite() {
            let (on, near) = &mut counts[cell as usize];
            *near += 1;
            *on += u32::from(*distance < ON * own.spacing());
        }
    }
    Ok(counts.iter().filter(|(on, near)| 2 * on > *near).count())
}

/// Returns the share of the seen voxels of both scans that lie in the other's free space.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn crossed(pair: Pair<'_>, pose: &Rigid, execution: &Execution) -> Result<f64> {
    let back = &inverse(pose);
    let (source, target) = (pair.source.surface(), pair.target.surface());
    let (mut in_front, mut seen) = (0, 0);
    for found in [places(source, target, pose, execution)?, places(target, source, back, execution)?] {
        for place in found {
            in_front += usize::from(place == Place::InFront);
            seen += usize::from(matches!(place, Place::InFront | Place::On | Place::Off));
        }
    }
    Ok(in_front as f64 / seen.max(1) as f64)
}

/// Returns the 9th decile of the residuals, each over the deviation of the points around it.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn misfit(found: &Alignment, voxel: f64) -> Result<f64> {
    if found.residuals.is_empty() {
        return Ok(NOTHING_PAIRED);
    }
    let both = found.residuals.iter().zip(&found.deviations);
    let expected = |deviation: f64| deviation.hypot(LEAST_NOISE * voxel);
    let mut shares =
        memory::collect(both.map(|(residual, &deviation)| residual.abs() / expected(deviation)))?;
    Ok(quantile(&mut shares, 0.9))
}
