//! Poses that align the centres of small separate parts of two clouds.

use nalgebra::{Matrix3, Vector3};

use crate::correspondences::Correspondences;
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::grouping::GroupingMethod;
use crate::grouping::sc2pcr::Sc2Pcr;
use crate::memory;
use crate::pose_graph::components;

use super::proposals::poses_of;

/// Edge of the cells whose neighbours belong to one part, in voxels.
const LINKED: f64 = 2.0;
/// Least and largest number of parts.
const LEAST_PARTS: usize = 5;
const MOST_PARTS: usize = 60;
/// Largest share of the voxels in one part, and least share in all such parts together.
const SMALL: f64 = 0.25;
const LEAST_SHARE: f64 = 0.5;
/// Largest ratio of the voxels of two matched parts.
const ALIKE: f64 = 2.0;
/// Largest distance of the centres of matched parts, in voxels.
const TOLERANCE: f64 = 1.5;

/// A small separate part: its centre, and its number of voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Mean of its voxels.
    pub center: Vector3<f64>,
    /// Number of voxels.
    pub size: usize,
}

/// Proposes poses at which the centres of separate parts coincide; none unless both clouds consist of such parts.
///
/// Parts of the same shape have the same descriptors, so each is matched with all of similar size, and SC2-PCR groups these
/// matches.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn propose_by_parts(
    source: &[Part],
    target: &[Part],
    voxel: f64,
    execution: &Execution,
) -> Result<Vec<Rigid>> {
    if source.len().min(target.len()) < LEAST_PARTS {
        return Ok(Vec::new());
    }
    let (mut from, mut to) = (Vec::new(), Vec::new());
    for one in source {
        for other in target {
            let ratio = (one.size as f64 / other.size as f64).ln().abs();
            if ratio < ALIKE.ln() {
                memory::push(&mut from, one.center.into())?;
                memory::push(&mut to, other.center.into())?;
            }
        }
    }
    let method = Sc2Pcr { tolerance: Some(TOLERANCE * voxel), ..Sc2Pcr::default() };
    let matches = Correspondences::new(&from, &to)?;
    poses_of(&method.group(&matches, execution)?, &matches)
}

/// Returns the largest small parts of a cloud; none if it does not consist of such parts.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn find_parts(points: &[Vector3<f64>], axes: &Matrix3<f64>, voxel: f64) -> Result<Vec<Part>> {
    let along = memory::collect(points.iter().map(|point| axes * point))?;
    let low = along.iter().fold(Vector3::repeat(f64::INFINITY), |low, point| low.inf(point));
    let cell =
        |point: &Vector3<f64>| <[i64; 3]>::from(((point - low) / (LINKED * voxel)).map(|x| x.floor() as i64));
    let of_points = memory::collect(along.iter().map(cell))?;
    let mut cells = memory::copied(&of_points)?;
    cells.sort_unstable();
    cells.dedup();
    let mut links = Vec::new();
    for (row, cell) in cells.iter().enumerate() {
        for step in 14..27 {
            let other = [cell[0] + step / 9 - 1, cell[1] + step / 3 % 3 - 1, cell[2] + step % 3 - 1];
            if let Ok(neighbor) = cells.binary_search(&other) {
                memory::push(&mut links, (row, neighbor))?;
            }
        }
    }
    let found = components(cells.len(), links.into_iter())?;
    let mut part_of = memory::filled(0, cells.len())?;
    found.iter().enumerate().for_each(|(part, rows)| rows.iter().for_each(|&row| part_of[row] = part));
    let mut sums = memory::filled((Vector3::zeros(), 0_usize), found.len())?;
    for (point, cell) in points.iter().zip(&of_points) {
        let (sum, size) = &mut sums[part_of[cells.binary_search(cell).unwrap_or(0)]];
        *sum += point;
        *size += 1;
    }
    let parts = sums.iter().filter(|(_, size)| *size as f64 <= SMALL * points.len() as f64);
    let mut parts = memory::collect(parts.map(|&(sum, size)| Part { center: sum / size as f64, size }))?;
    let together: usize = parts.iter().map(|part| part.size).sum();
    if found.len() < LEAST_PARTS || (together as f64) < LEAST_SHARE * points.len() as f64 {
        return Ok(Vec::new());
    }
    parts.sort_by_key(|part| std::cmp::Reverse(part.size));
    parts.truncate(MOST_PARTS);
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of 3 x 3 x 3 points at some places.
    fn blocks(places: &[[f64; 3]]) -> Vec<Vector3<f64>> {
        let block = |place: &[f64; 3]| {
            let place = Vector3::from(*place);
            (0..27)
                .map(move |i| place + Vector3::new(f64::from(i % 3), f64::from(i / 3 % 3), f64::from(i / 9)))
        };
        places.iter().flat_map(block).collect()
    }

    const PLACES: [[f64; 3]; 6] = [
        [0.0; 3],
        [30.0, 0.0, 0.0],
        [0.0, 41.0, 0.0],
        [55.0, 20.0, 9.0],
        [12.0, 70.0, 33.0],
        [80.0, 80.0, 5.0],
    ];

    #[test]
    fn separate_blocks_are_parts() -> Result<()> {
        let points = blocks(&PLACES);
        let parts = find_parts(&points, &Matrix3::identity(), 1.0)?;
        assert_eq!(parts.len(), 6);
        assert!(parts.iter().all(|part| part.size == 27));
        assert!(parts.iter().any(|part| (part.center - Vector3::new(31.0, 1.0, 1.0)).amax() < 1e-12));
        assert!(find_parts(&blocks(&PLACES[..4]), &Matrix3::identity(), 1.0)?.is_empty());
        assert!(find_parts(&[], &Matrix3::identity(), 1.0)?.is_empty());
        Ok(())
    }

    #[test]
    fn their_centres_propose_the_pose() -> Result<()> {
        let parts = find_parts(&blocks(&PLACES), &Matrix3::identity(), 1.0)?;
        let shift = Vector3::new(7.0, -3.0, 100.0);
        let moved: Vec<_> = parts.iter().map(|part| Part { center: part.center + shift, ..*part }).collect();
        let poses = propose_by_parts(&parts, &moved, 1.0, &Execution::default())?;
        assert!(poses.iter().any(|pose| (pose.translation - shift).amax() < 0.5));
        assert!(propose_by_parts(&parts[..4], &moved, 1.0, &Execution::default())?.is_empty());
        Ok(())
    }
}
