//! Voxel downsampling: the mean of the points in every occupied cell of a regular grid.
//!
//! Cells are cubes; the grid begins half a cell below the minimum coordinates, as in `Open3D`'s
//! `voxel_down_sample`. Voxels are numbered in the order of their cells, x fastest, so that neighbours in
//! memory are mostly neighbours in space. Cost O(N), or O(N log N) if there are many more cells than points.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::cloud::Own;
use crate::error::{Error, Result, at_least_one};
use crate::execution::Execution;
use crate::features::voxel_grid::Grid;
use crate::geometry::own_axes::OwnFrame;
use crate::memory;
use crate::points::Points;

/// Candidate sizes per factor of two.
const STEPS_PER_OCTAVE: f64 = 16.0;
/// Steps between the smallest and the largest candidate size: 2^20 cells along a diagonal.
const STEPS: i32 = 320;
/// First size that is tried: a sixteenth of the diagonal, whose grid is small. Trials before bisection.
const FIRST: i32 = -64;
const TRIALS: usize = 8;
/// Octaves by which the number of voxels of a surface falls with a step of the size.
const SLOPE: f64 = 2.0 / STEPS_PER_OCTAVE;
/// Voxels that are counted at most, in multiples of those wanted.
const COUNTED: usize = 4;
/// Fewest points per voxel at which downsampling pays off.
const LEAST_POINTS: usize = 2;

/// A cloud downsampled to one point per cell.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Voxels {
    /// Mean of the points of each voxel, in the data's own coordinates.
    pub points: Vec<[f64; 3]>,
    /// Mean of their normals, scaled to unit length; NaN if they have none or cancel. Empty if none were
    /// given.
    pub normals: Vec<Vector3<f64>>,
    /// Voxel of every point of the cloud.
    pub indices: Vec<u32>,
}

/// Downsamples a cloud. Means are summed in the order of the cloud, for any number of threads.
///
/// # Errors
/// [`Error::InvalidInput`] for a size that is not positive or leads to more than 2^62 cells, or a number of
/// normals other than that of the points; [`Error::Interrupted`], [`Error::OutOfMemory`].
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
    let (indices, count) = Grid::new(points, size)?.number(points, execution)?;
    let mut sums = memory::filled(Vector3::zeros(), count)?;
    let mut members = memory::filled(0_u32, count)?;
    for (i, &voxel) in indices.iter().enumerate() {
        sums[voxel as usize] += points.get(i).coords;
        members[voxel as usize] += 1;
    }
    let mean = |(sum, &count): (&Vector3<f64>, &u32)| (sum / f64::from(count) + points.center()).into();
    let normals = normals.map(|normals| mean_directions(normals, &indices, count)).transpose()?;
    let points = memory::collect(sums.iter().zip(&members).map(mean))?;
    Ok(Voxels { points, normals: normals.unwrap_or_default(), indices })
}

/// As [`voxel_downsample`], by a grid along the cloud's intrinsic axes: the voxels do not depend on the
/// frame, up to rounding.
///
/// # Errors
/// As [`voxel_downsample`].
pub fn thin(
    points: &Points,
    normals: Option<&[Vector3<f64>]>,
    size: f64,
    execution: &Execution,
) -> Result<Voxels> {
    thin_own(&OwnFrame::of(points)?, normals, size, execution)
}

/// As [`thin`], for points along the cloud's own axes.
///
/// # Errors
/// As [`voxel_downsample`].
pub fn thin_own(
    (frame, points): &Own,
    normals: Option<&[Vector3<f64>]>,
    size: f64,
    execution: &Execution,
) -> Result<Voxels> {
    let mut voxels = voxel_downsample(points, normals, size, execution)?;
    voxels.points.iter_mut().for_each(|point| *point = frame.in_data(&Vector3::from(*point)).into());
    Ok(voxels)
}

/// The smallest size d 2^(k/16), k an integer and d the longest diagonal of the clouds, at which the clouds
/// have at most `most` voxels each on average, and at least two points per voxel. Counts fall with the size
/// up to chance, so a search between bounds finds it: the next smaller size has too many voxels.
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
    let size = |k: i32| widest * (f64::from(k) / STEPS_PER_OCTAVE).exp2();
    let count = |k: i32| -> Result<usize> {
        execution.check()?;
        let counts = clouds
            .par_iter()
            .map(|cloud| Grid::new(cloud, size(k))?.count(cloud, most.saturating_mul(COUNTED)));
        Ok(counts.collect::<Result<Vec<usize>>>()?.iter().sum())
    };
    // At the highest k each cloud lies in one cell.
    let mut high = 2 * STEPS_PER_OCTAVE as i32;
    let mut low = high - STEPS;
    let (mut tried, mut last) = (FIRST, None);
    for trial in 0.. {
        let found = count(tried)?;
        if found <= most {
            high = tried;
        } else {
            low = tried;
        }
        if high - low <= 1 {
            break;
        }
        // The number of voxels falls with a power of their size, about the second; bisection ends any other case.
        let excess = (found as f64 / most as f64).log2();
        let slope = last.map_or(SLOPE, |(k, other): (i32, f64)| (other - excess) / f64::from(tried - k));
        last = Some((tried, excess));
        let steps = (excess / slope.clamp(SLOPE / 2.0, SLOPE * 1.5)).round() as i32;
        let next = if trial < TRIALS { tried + steps } else { i32::midpoint(low, high) };
        tried = next.clamp(low + 1, high - 1);
    }
    Ok(size(high))
}

/// Number of voxels of a size.
///
/// # Errors
/// [`Error::InvalidInput`] for a size that is not positive or leads to more than 2^62 cells;
/// [`Error::OutOfMemory`].
pub fn count_voxels(points: &Points, size: f64) -> Result<usize> {
    Grid::new(points, size)?.count(points, usize::MAX)
}

fn mean_directions(normals: &[Vector3<f64>], indices: &[u32], count: usize) -> Result<Vec<Vector3<f64>>> {
    let mut sums = memory::filled(Vector3::zeros(), count)?;
    for (normal, &voxel) in normals.iter().zip(indices).filter(|(normal, _)| !normal.x.is_nan()) {
        sums[voxel as usize] += normal;
    }
    // A normal that is infinite, or longer than f64 can represent, has no direction: scaled, it is zero or
    // NaN.
    let direction =
        |sum: &Vector3<f64>| sum.try_normalize(f64::EPSILON).filter(|unit| unit.norm_squared() > 0.5);
    for sum in &mut sums {
        *sum = direction(sum).unwrap_or_else(|| Vector3::repeat(f64::NAN));
    }
    Ok(sums)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(n: usize) -> Result<Points> {
        let rows: Vec<[f64; 3]> = (0..n).map(|i| [1.1, 2.3, 3.7].map(|f| (i as f64 * f).sin())).collect();
        Points::from_rows("points", &rows)
    }

    #[test]
    fn infinite_normals_have_no_mean_direction() -> Result<()> {
        let points = Points::from_rows("points", &[[0.0; 3], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0]])?;
        let normals = [f64::INFINITY, 1e200, 1.0].map(|x| Vector3::new(x, 0.0, 0.0));
        let found = voxel_downsample(&points, Some(&normals), 1.0, &Execution::default())?.normals;
        let missing: Vec<bool> = found.iter().map(|normal| normal.iter().all(|x| x.is_nan())).collect();
        assert_eq!(missing, [true, true, false]);
        Ok(())
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
        assert!(count_voxels(&points, size / 2.0_f64.powf(1.0 / 16.0))? > 500);
        Ok(())
    }

    #[test]
    fn few_points_are_downsampled_too() -> Result<()> {
        let points = wave(300)?;
        let size = choose_voxel(&[&points], 5000, &Execution::default())?;
        assert!((50..=150).contains(&count_voxels(&points, size)?));
        Ok(())
    }

    #[test]
    fn a_raster_on_faces_is_divided_evenly() -> Result<()> {
        // The mean is not a multiple of the spacing, so that subtracting it rounds every coordinate.
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
