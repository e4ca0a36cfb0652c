//! Occupied cells of a regular grid: counted and numbered.

use rayon::prelude::*;

use crate::error::{Error, Result, positive};
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;
use crate::simd;

/// Most cells of a grid with one byte per cell: 4 MiB.
const MAX_BYTES: u64 = 1 << 22;
/// Most cells of a grid with one bit per cell: 32 MiB.
const MAX_BITS: u64 = 1 << 28;
/// Most cells per point for a bit set that is scanned completely.
const BITS_PER_POINT: u64 = 1 << 10;
/// Points whose cells are computed at once.
const CHUNK: usize = 64;
/// Stride of the first pass over the chunks.
const STRIDE: usize = 16;
/// Most cells along all axes together: their numbers fit into 64 bits.
const MAX_CELLS: f64 = (1_u64 << 62) as f64;
/// Share of a cell by which a point below a face still counts as above it: subtracting the mean rounds
/// coordinates, and points of a raster would fall to either side.
const ON_A_FACE: f64 = 1e-9;
/// Cells numbered along x first.
pub(super) struct Grid {
    low: [f64; 3],
    per_length: f64,
    cells: [u64; 3],
}

impl Grid {
    /// Grid of cells of a given size.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a size that is not positive or leaves more than 2^62 cells.
    pub fn new(points: &Points, size: f64) -> Result<Self> {
        positive("voxel", size)?;
        let (low, extent) = points.bounding_box();
        let per_length = 1.0 / size;
        let cells = extent.map(|length| (length * per_length + 0.5 + ON_A_FACE).floor() + 1.0);
        if !(per_length.is_finite() && cells.iter().product::<f64>() <= MAX_CELLS) {
            let remedy = format!("the cloud is {:.3e} across; give a larger voxel", points.diagonal());
            return Err(Error::invalid("voxel", format!("{size:e}"), remedy));
        }
        Ok(Self { low, per_length, cells: cells.map(|count| count as u64) })
    }

    fn total(&self) -> u64 {
        self.cells.iter().product()
    }

    /// Cell of every point.
    fn cells_of(&self, points: &Points) -> Result<Vec<u64>> {
        let mut cells = memory::filled(0, points.len())?;
        let chunks = cells.par_chunks_mut(CHUNK).with_min_len(16).enumerate();
        chunks.for_each(|(chunk, cells)| self.fill_cells(points, chunk * CHUNK, cells));
        Ok(cells)
    }

    /// Cells of the points from `first` on.
    fn fill_cells(&self, points: &Points, first: usize, cells: &mut [u64]) {
        let range = first..first + cells.len();
        let axes = [&points.x[range.clone()], &points.y[range.clone()], &points.z[range]];
        simd::run(
            #[inline(always)]
            || {
                cells.fill(0);
                for k in [2, 1, 0] {
                    for (cell, coordinate) in cells.iter_mut().zip(axes[k]) {
                        let along = (coordinate - self.low[k]) * self.per_length + 0.5 + ON_A_FACE;
                        *cell = *cell * self.cells[k] + (along as u64).min(self.cells[k] - 1);
                    }
                }
            },
        );
    }

    /// Number of occupied cells; any number greater than `most` if there are more.
    pub fn count(&self, points: &Points, most: usize) -> Result<usize> {
        if self.total() <= MAX_BYTES {
            // A byte per cell is written without a look at it.
            let mut occupied = memory::filled(0_u8, self.total() as usize)?;
            let mut cells = [0; CHUNK];
            for first in (0..points.len()).step_by(CHUNK) {
                let length = CHUNK.min(points.len() - first);
                self.fill_cells(points, first, &mut cells[..length]);
                cells[..length].iter().for_each(|&cell| occupied[cell as usize] = 1);
            }
            return Ok(occupied.iter().map(|&one| usize::from(one)).sum());
        }
        if self.total() > MAX_BITS {
            let mut cells = self.cells_of(points)?;
            cells.par_sort_unstable();
            cells.dedup();
            return Ok(cells.len());
        }
        let mut occupied = memory::filled(0_u64, self.total().div_ceil(64) as usize)?;
        let mut count = 0;
        // Starts with points from all over the cloud, to detect too many voxels early.
        let chunks = points.len().div_ceil(CHUNK);
        for chunk in (0..STRIDE).flat_map(|first| (first..chunks).step_by(STRIDE)) {
            let (mut cells, length) = ([0; CHUNK], CHUNK.min(points.len() - chunk * CHUNK));
            self.fill_cells(points, chunk * CHUNK, &mut cells[..length]);
            for cell in &cells[..length] {
                let (word, bit) = (&mut occupied[(cell / 64) as usize], 1 << (cell % 64));
                count += usize::from(*word & bit == 0);
                *word |= bit;
            }
            if count > most {
                break;
            }
        }
        Ok(count)
    }

    /// The voxel of every point, numbered in the order of cells, and the number of voxels.
    pub fn number(&self, points: &Points, execution: &Execution) -> Result<(Vec<u32>, usize)> {
        let cells = self.cells_of(points)?;
        execution.check()?;
        if self.total() <= MAX_BITS.min(BITS_PER_POINT * points.len() as u64) {
            return number_by_bits(&cells, self.total());
        }
        let mut entries = memory::collect(cells.into_iter().zip(0_u32..))?;
        entries.par_sort_unstable();
        let (mut indices, mut count) = (memory::filled(0, points.len())?, 0);
        for members in entries.chunk_by(|a, b| a.0 == b.0) {
            members.iter().for_each(|&(_, i)| indices[i as usize] = count);
            count += 1;
        }
        Ok((indices, count as usize))
    }
}

/// The rank of every cell among the occupied ones, and their number.
fn number_by_bits(cells: &[u64], total: u64) -> Result<(Vec<u32>, usize)> {
    let mut occupied = memory::filled(0_u64, total.div_ceil(64) as usize)?;
    cells.iter().for_each(|cell| occupied[(cell / 64) as usize] |= 1 << (cell % 64));
    let mut count = 0;
    let before = memory::collect(occupied.iter().map(|word| {
        count += word.count_ones();
        count - word.count_ones()
    }))?;
    let rank = |cell: &u64| {
        let word = (cell / 64) as usize;
        before[word] + (occupied[word] & ((1 << (cell % 64)) - 1)).count_ones()
    };
    Ok((memory::collect(cells.iter().map(rank))?, count as usize))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(n: usize) -> Result<Points> {
        let rows: Vec<[f64; 3]> = (0..n).map(|i| [1.1, 2.3, 3.7].map(|f| (i as f64 * f).sin())).collect();
        Points::from_rows("points", &rows)
    }

    #[test]
    fn cells_are_numbered_in_order_for_any_number() -> Result<()> {
        let points = wave(3000)?;
        for size in [1e-3, 0.02, 0.3, 5.0] {
            let grid = Grid::new(&points, size)?;
            let cells = grid.cells_of(&points)?;
            let mut sorted = cells.clone();
            sorted.sort_unstable();
            sorted.dedup();
            let (indices, count) = grid.number(&points, &Execution::default())?;
            assert!(indices.iter().zip(&cells).all(|(&i, cell)| sorted[i as usize] == *cell));
            assert_eq!((count, grid.count(&points, usize::MAX)?), (sorted.len(), sorted.len()));
        }
        assert!(Grid::new(&points, 1e-3)?.total() > MAX_BITS && Grid::new(&points, 5.0)?.total() < 9);
        Ok(())
    }

    #[test]
    fn counting_ends_beyond_the_limit() -> Result<()> {
        let grid = Grid::new(&wave(3000)?, 0.02)?;
        let all = grid.count(&wave(3000)?, usize::MAX)?;
        for most in [0, 1, 500, all - 1, all, all + 1] {
            let count = grid.count(&wave(3000)?, most)?;
            assert!(if most < all { count > most && count <= all } else { count == all });
        }
        Ok(())
    }
}
