//! Voxel down-sampling: the mean of the points in every occupied cell of a regular grid.
//!
//! Cells are cubes; the grid begins half a cell below the least coordinates, as in `Open3D`'s `voxel_down_sample`.
//! Voxels are numbered in the order of their cells, x fastest, so that neighbours in memory are mostly
//! neighbours in space. Cost O(N log N).

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::{Error, Result, at_least_one, positive};
use crate::execution::Execution;
use crate::points::Points;

/// Cells of a grid that gets one bit per cell, 32 MiB at most.
const MAX_BITS: u64 = 1 << 28;
/// Cells along all axes together; their numbers fit into 64 bits.
const MAX_CELLS: f64 = (1_u64 << 62) as f64;
/// Share of a cell that a point may lie below a face and still belong above it: subtracting the mean rounds
/// coordinates, and points of a raster would fall to either side.
const ON_A_FACE: f64 = 1e-9;
/// Sizes that are tried per factor of two.
const STEPS_PER_OCTAVE: f64 = 4.0;
/// Between the smallest and the largest size that are tried: 2^20 cells along a diagonal.
const STEPS: i32 = 80;
/// Points per voxel that are the least worth a voxel.
const LEAST_POINTS: usize = 2;

/// A cloud thinned out to one point per cell.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Voxels {
    /// Mean of the points of each voxel, in the data's own coordinates.
    pub points: Vec<[f64; 3]>,
    /// Mean of their normals, scaled to unit length; NaN where they have none or cancel. Empty if none were given.
    pub normals: Vec<Vector3<f64>>,
    /// Voxel of every point of the cloud.
    pub indices: Vec<u32>,
}

/// Thins out a cloud. Means are sums in the order of the cloud, whatever the number of threads.
///
/// # Errors
/// [`Error::InvalidInput`] for a size that is not positive or leaves more than 2^62 cells, or normals that are not
/// one per point; [`Error::Interrupted`].
pub fn voxel_downsample(
    points: &Points,
    normals: Option<&[Vector3<f64>]>,
    size: f64,
    execution: &Execution,
) -> Result<Voxels> {
    if let Some(normals) = normals
        && normals.len() != points.len()
    {
        let got = format!("{} rows", normals.len());
        return Err(Error::invalid("normals", got, format!("give one per point, {}", points.len())));
    }
    let grid = Grid::new(points, size)?;
    let mut entries: Vec<(u64, u32)> =
        (0..points.len()).into_par_iter().map(|i| (grid.cell(points, i), i as u32)).collect();
    execution.check()?;
    // No two entries are equal, so that their order does not depend on the threads.
    entries.par_sort_unstable();
    execution.check()?;
    let mut voxels = Voxels { indices: vec![0; points.len()], ..Voxels::default() };
    for members in entries.chunk_by(|a, b| a.0 == b.0) {
        voxels.add(members, points, normals);
    }
    Ok(voxels)
}

impl Voxels {
    fn add(&mut self, members: &[(u64, u32)], points: &Points, normals: Option<&[Vector3<f64>]>) {
        let rows = members.iter().map(|&(_, i)| i as usize);
        let sum: Vector3<f64> = rows.clone().map(|i| points.get(i).coords).sum();
        rows.clone().for_each(|i| self.indices[i] = self.points.len() as u32);
        self.points.push((sum / members.len() as f64 + points.center()).into());
        if let Some(normals) = normals {
            self.normals.push(mean_direction(rows.map(|i| normals[i])));
        }
    }
}

/// The smallest size 2^(k/4), k whole, at which clouds have at most `most` voxels each on average, and at least two
/// points per voxel. Counts fall with the size but for chance, so it is found by bisection: the next smaller size
/// has too many.
///
/// # Errors
/// [`Error::InvalidInput`] for `most` of 0, or clouds without extent; [`Error::Interrupted`].
pub fn choose_voxel(clouds: &[&Points], most: usize, execution: &Execution) -> Result<f64> {
    at_least_one("voxels", most)?;
    let widest = clouds.iter().map(|cloud| cloud.diagonal()).fold(0.0, f64::max);
    if widest <= 0.0 {
        return Err(Error::invalid(
            "clouds",
            "points without extent",
            "give points that do not all coincide",
        ));
    }
    let points: usize = clouds.iter().map(|cloud| cloud.len()).sum();
    let most = most.saturating_mul(clouds.len()).min(points / LEAST_POINTS);
    let size = |k: i32| (f64::from(k) / STEPS_PER_OCTAVE).exp2();
    let fits = |k: i32| -> Result<bool> {
        execution.check()?;
        let counts = clouds.iter().map(|cloud| count_voxels(cloud, size(k)));
        Ok(counts.sum::<Result<usize>>()? <= most)
    };
    // At the highest k each cloud lies in one cell.
    let mut high = (widest.log2() * STEPS_PER_OCTAVE).ceil() as i32 + 2 * STEPS_PER_OCTAVE as i32;
    let mut low = high - STEPS;
    while high - low > 1 {
        let middle = i32::midpoint(low, high);
        if fits(middle)? { high = middle } else { low = middle }
    }
    Ok(size(high))
}

/// Number of voxels of a size.
///
/// # Errors
/// [`Error::InvalidInput`] for a size that is not positive or leaves more than 2^62 cells.
pub fn count_voxels(points: &Points, size: f64) -> Result<usize> {
    let grid = Grid::new(points, size)?;
    if points.is_empty() {
        return Ok(0);
    }
    if grid.total() > MAX_BITS {
        let mut cells: Vec<u64> = (0..points.len()).into_par_iter().map(|i| grid.cell(points, i)).collect();
        cells.par_sort_unstable();
        cells.dedup();
        return Ok(cells.len());
    }
    let mut occupied = vec![0_u64; grid.total().div_ceil(64) as usize];
    for cell in (0..points.len()).map(|i| grid.cell(points, i)) {
        occupied[(cell / 64) as usize] |= 1 << (cell % 64);
    }
    Ok(occupied.iter().map(|word| word.count_ones() as usize).sum())
}

/// Cells numbered along x first.
struct Grid {
    low: [f64; 3],
    size: f64,
    cells: [u64; 3],
}

impl Grid {
    fn new(points: &Points, size: f64) -> Result<Self> {
        positive("voxel", size)?;
        let (low, extent) = points.bounding_box();
        let cells = extent.map(|length| (length / size + 0.5 + ON_A_FACE).floor() + 1.0);
        if cells.iter().product::<f64>() > MAX_CELLS {
            let remedy = format!("the cloud is {:e} across; give a larger voxel", points.diagonal());
            return Err(Error::invalid("voxel", size, remedy));
        }
        Ok(Self { low, size, cells: cells.map(|count| count as u64) })
    }

    fn total(&self) -> u64 {
        self.cells.iter().product()
    }

    #[inline]
    fn cell(&self, points: &Points, i: usize) -> u64 {
        let point = points.get(i);
        let along = |k: usize| {
            let cell = (point[k] - self.low[k]) / self.size + 0.5 + ON_A_FACE;
            (cell as u64).min(self.cells[k] - 1)
        };
        (along(2) * self.cells[1] + along(1)) * self.cells[0] + along(0)
    }
}

fn mean_direction(normals: impl Iterator<Item = Vector3<f64>>) -> Vector3<f64> {
    let sum: Vector3<f64> = normals.filter(|normal| !normal.x.is_nan()).sum();
    sum.try_normalize(f64::EPSILON).unwrap_or_else(|| Vector3::repeat(f64::NAN))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(n: usize) -> Result<Points> {
        let rows: Vec<[f64; 3]> = (0..n).map(|i| [1.1, 2.3, 3.7].map(|f| (i as f64 * f).sin())).collect();
        Points::from_rows("points", &rows)
    }

    #[test]
    fn every_voxel_is_the_mean_of_its_points() -> Result<()> {
        let points = wave(2000)?;
        let voxels = voxel_downsample(&points, None, 0.3, &Execution::default())?;
        assert_eq!(voxels.points.len(), count_voxels(&points, 0.3)?);
        for (voxel, mean) in voxels.points.iter().enumerate() {
            let own: Vec<usize> = (0..2000).filter(|&i| voxels.indices[i] as usize == voxel).collect();
            let sum: Vector3<f64> = own.iter().map(|&i| points.get(i).coords).sum();
            assert!((sum / own.len() as f64 + points.center() - Vector3::from(*mean)).amax() < 1e-14);
        }
        Ok(())
    }

    #[test]
    fn normals_are_averaged_and_opposite_ones_cancel() -> Result<()> {
        let points = Points::from_rows("points", &[[0.0; 3], [0.1; 3], [5.0; 3], [5.1; 3]])?;
        let (x, z) = (Vector3::x(), Vector3::z());
        let voxels = voxel_downsample(&points, Some(&[x, z, z, -z]), 1.0, &Execution::default())?;
        assert!((voxels.normals[0] - (x + z).normalize()).amax() < 1e-15);
        assert!(voxels.normals[1].x.is_nan());
        Ok(())
    }

    #[test]
    fn the_chosen_size_is_the_smallest_that_fits() -> Result<()> {
        let points = wave(3000)?;
        let size = choose_voxel(&[&points], 500, &Execution::default())?;
        assert!(count_voxels(&points, size)? <= 500);
        assert!(count_voxels(&points, size / 2.0_f64.powf(0.25))? > 500);
        Ok(())
    }

    #[test]
    fn few_points_are_thinned_out_too() -> Result<()> {
        let points = wave(300)?;
        let size = choose_voxel(&[&points], 5000, &Execution::default())?;
        assert!((50..=150).contains(&count_voxels(&points, size)?));
        Ok(())
    }

    #[test]
    fn a_raster_on_faces_is_cut_evenly() -> Result<()> {
        // The mean is no multiple of the spacing, so that subtracting it rounds every coordinate.
        let rows: Vec<[f64; 3]> =
            (0..64).map(|i| [f64::from(i % 32) * 0.25, 0.1, f64::from(i / 32) * 1e5]).collect();
        let points = Points::from_rows("points", &rows)?;
        let voxels = voxel_downsample(&points, None, 0.5, &Execution::default())?;
        let sizes: Vec<usize> =
            (0..34).map(|voxel| voxels.indices.iter().filter(|&&i| i == voxel).count()).collect();
        assert!(
            sizes.iter().enumerate().all(|(voxel, &size)| size == if voxel % 17 % 16 == 0 { 1 } else { 2 })
        );
        Ok(())
    }

    #[test]
    fn a_sparse_grid_is_counted_alike() -> Result<()> {
        let points = wave(3000)?;
        let size = 1e-3;
        assert!(Grid::new(&points, size)?.total() > MAX_BITS);
        let voxels = voxel_downsample(&points, None, size, &Execution::default())?;
        assert_eq!(voxels.points.len(), count_voxels(&points, size)?);
        Ok(())
    }

    #[test]
    fn bad_input_is_refused() -> Result<()> {
        let points = wave(10)?;
        for size in [0.0, -1.0, f64::NAN, 1e-30] {
            assert!(voxel_downsample(&points, None, size, &Execution::default()).is_err());
        }
        assert!(voxel_downsample(&points, Some(&[Vector3::x()]), 1.0, &Execution::default()).is_err());
        assert!(choose_voxel(&[&points], 0, &Execution::default()).is_err());
        assert!(choose_voxel(&[&Points::default()], 5, &Execution::default()).is_err());
        Ok(())
    }
}
