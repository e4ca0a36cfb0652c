//! The nearest point of a surface, found by one look into a grid.
//!
//! Each cell names the point nearest to its centre. Within a cell of size c another point may be nearer to the place
//! asked for, by less than `c sqrt(3)`; both lie on the surface, and the distance to its plane hardly differs.
//! Blocks of 8 x 8 x 8 cells exist only near points, so that memory grows with the surface and not with
//! the box around it.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::execution::Execution;

/// Cells along an edge of a block.
const EDGE: usize = 8;
const CELLS: usize = EDGE * EDGE * EDGE;

/// Entries of the table of blocks: 64 MiB.
const MOST_BLOCKS_IN_BOX: f64 = (1 << 24) as f64;
/// Blocks that exist: 512 MiB.
const MOST_BLOCKS: usize = 1 << 18;
/// Blocks computed between two looks for an interruption.
const BATCH: usize = 1024;

const NONE: u32 = u32::MAX;

#[derive(Debug)]
pub(super) struct NearestGrid {
    low: Vector3<f32>,
    cells_per_length: f32,
    /// Cells along each axis, whole blocks.
    size: [usize; 3],
    /// Number of each block of the box, `NONE` where it does not exist.
    blocks: Vec<u32>,
    /// Nearest point of each cell, block after block.
    nearest: Vec<u32>,
}

impl NearestGrid {
    /// Cells of a size, each with the nearest of the points closer to its centre than `reach`, ties to the lower index.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] where the points lie too far apart for cells that small, [`Error::Interrupted`].
    pub fn new(points: &[Vector3<f32>], cell: f32, reach: f32, execution: &Execution) -> Result<Self> {
        let mut grid = Self::around(points, cell, reach)?;
        let touched = grid.touched_blocks(points, reach);
        let runs: Vec<&[(u32, u32)]> = touched.chunk_by(|a, b| a.0 == b.0).collect();
        if runs.len() > MOST_BLOCKS {
            let remedy = "thin the points first (features.voxel_downsample), or give a larger unit";
            return Err(Error::invalid(
                "points",
                format!("{} points over a wide surface", points.len()),
                remedy,
            ));
        }
        for (number, run) in runs.iter().enumerate() {
            grid.blocks[run[0].0 as usize] = number as u32;
        }
        grid.nearest = vec![NONE; runs.len() * CELLS];
        let mut cells = std::mem::take(&mut grid.nearest);
        for (part, runs) in cells.chunks_mut(BATCH * CELLS).zip(runs.chunks(BATCH)) {
            execution.check()?;
            part.par_chunks_mut(CELLS)
                .zip(runs)
                .for_each(|(block, run)| grid.fill(block, run, points, reach));
        }
        grid.nearest = cells;
        Ok(grid)
    }

    /// An empty grid whose box holds all points and their reach.
    fn around(points: &[Vector3<f32>], cell: f32, reach: f32) -> Result<Self> {
        let (low, high) = points
            .iter()
            .fold((Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY)), |(low, high), p| {
                (low.inf(p), high.sup(p))
            });
        let low = low.map(|number| number - reach - cell);
        let blocks = (high - low)
            .map(|length| f64::from((length + reach + cell) / (cell * EDGE as f32)).floor() + 1.0);
        let fits = blocks.product() <= MOST_BLOCKS_IN_BOX;
        if !fits {
            let spans = (high - low).amax();
            let remedy = "give a larger unit (0.4 of a voxel), or remove stray points";
            return Err(Error::invalid("unit", format!("points that span {spans:.0} units"), remedy));
        }
        let size = [0, 1, 2].map(|k| blocks[k] as usize * EDGE);
        let count = blocks.product() as usize;
        Ok(Self { low, cells_per_length: cell.recip(), size, blocks: vec![NONE; count], nearest: Vec::new() })
    }

    /// Blocks that the ball around each point may reach, with the point, sorted.
    fn touched_blocks(&self, points: &[Vector3<f32>], reach: f32) -> Vec<(u32, u32)> {
        let block = |coordinate: f32, k: usize| self.coordinate(coordinate, k).max(0.0) as usize / EDGE;
        let mut touched = Vec::with_capacity(8 * points.len());
        for (index, point) in points.iter().enumerate() {
            let first = [0, 1, 2].map(|k| block(point[k] - reach, k));
            let last = [0, 1, 2].map(|k| block(point[k] + reach, k).min(self.size[k] / EDGE - 1));
            for z in first[2]..=last[2] {
                for y in first[1]..=last[1] {
                    touched.extend(
                        (first[0]..=last[0]).map(|x| (self.block_at([x, y, z]) as u32, index as u32)),
                    );
                }
            }
        }
        touched.par_sort_unstable();
        touched
    }

    /// Names the nearest of the points of a run in every cell of its block.
    fn fill(&self, cells: &mut [u32], run: &[(u32, u32)], points: &[Vector3<f32>], reach: f32) {
        let mut squares = [reach * reach; CELLS];
        let centers = self.centers(run[0].0 as usize);
        for &(_, index) in run {
            let p = points[index as usize];
            let [x, y, z] = [0, 1, 2].map(|k| centers[k].map(|center| (center - p[k]) * (center - p[k])));
            for (row, zy) in (0..EDGE * EDGE).map(|row| (row, z[row / EDGE] + y[row % EDGE])) {
                if zy >= reach * reach {
                    continue;
                }
                let row = row * EDGE..(row + 1) * EDGE;
                for ((square, cell), x) in squares[row.clone()].iter_mut().zip(&mut cells[row]).zip(x) {
                    let nearer = zy + x < *square;
                    *square = if nearer { zy + x } else { *square };
                    *cell = if nearer { index } else { *cell };
                }
            }
        }
    }

    /// Centres of a block's cells along each axis.
    fn centers(&self, block: usize) -> [[f32; EDGE]; 3] {
        let [across, along] = [self.size[0] / EDGE, self.size[1] / EDGE];
        let corner = [block % across, block / across % along, block / (across * along)];
        std::array::from_fn(|k| {
            std::array::from_fn(|i| {
                self.low[k] + ((corner[k] * EDGE + i) as f32 + 0.5) / self.cells_per_length
            })
        })
    }

    fn coordinate(&self, length: f32, k: usize) -> f32 {
        (length - self.low[k]) * self.cells_per_length
    }

    fn block_at(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * (self.size[1] / EDGE) + y) * (self.size[0] / EDGE) + x
    }

    /// The point nearest to the centre of the cell that a place lies in.
    #[inline]
    pub fn get(&self, place: &Vector3<f32>) -> Option<usize> {
        let c = (place - self.low) * self.cells_per_length;
        if !(c.x >= 0.0 && c.y >= 0.0 && c.z >= 0.0) {
            return None;
        }
        let [x, y, z] = [c.x as usize, c.y as usize, c.z as usize];
        if x >= self.size[0] || y >= self.size[1] || z >= self.size[2] {
            return None;
        }
        let block = self.blocks[self.block_at([x / EDGE, y / EDGE, z / EDGE])];
        if block == NONE {
            return None;
        }
        let cell = (z % EDGE * EDGE + y % EDGE) * EDGE + x % EDGE;
        let found = self.nearest[block as usize * CELLS + cell];
        (found != NONE).then_some(found as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scattered(count: usize) -> Vec<Vector3<f32>> {
        (0..count).map(|i| Vector3::new(1.1, 2.3, 3.7).map(|f| 20.0 * (i as f32 * f).sin())).collect()
    }

    fn nearest_to(points: &[Vector3<f32>], place: &Vector3<f32>, reach: f32) -> Option<(usize, f32)> {
        let distances = points.iter().map(|p| (p - place).norm()).enumerate();
        distances.filter(|d| d.1 < reach).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    #[test]
    fn cells_name_the_point_nearest_to_their_centre() -> Result<()> {
        let points = scattered(300);
        for (cell, reach) in [(1.5, 8.0), (1.0, 4.0)] {
            let grid = NearestGrid::new(&points, cell, reach, &Execution::default())?;
            for place in scattered(2000).iter().map(|p| p * 1.3 + Vector3::repeat(0.37)) {
                let center =
                    (place - grid.low).map(|length| ((length / cell).floor() + 0.5) * cell) + grid.low;
                let distance = |i: usize| (points[i] - center).norm();
                match (grid.get(&place), nearest_to(&points, &center, reach)) {
                    (Some(found), Some((_, least))) => assert!(distance(found) < least + 1e-4),
                    (None, None) => {}
                    (_, Some((_, least))) => assert!(least > reach - 1e-4, "{place:?}"),
                    (Some(found), None) => assert!(distance(found) > reach - 1e-4, "{place:?}"),
                }
            }
        }
        Ok(())
    }

    #[test]
    fn stray_points_are_refused_and_places_outside_are_empty() -> Result<()> {
        let mut points = scattered(30);
        let grid = NearestGrid::new(&points, 1.0, 4.0, &Execution::default())?;
        for far in [1e3, -1e3, f32::INFINITY, f32::NAN] {
            assert_eq!(grid.get(&Vector3::new(far, 0.0, 0.0)), None);
        }
        points.push(Vector3::repeat(1e7));
        assert!(NearestGrid::new(&points, 1.0, 4.0, &Execution::default()).is_err());
        Ok(())
    }

    #[test]
    fn a_wide_thin_scan_takes_memory_by_its_surface() -> Result<()> {
        let points: Vec<_> = (0..2000).map(|i| Vector3::new(i as f32 * 2.0, (i % 7) as f32, 0.0)).collect();
        let grid = NearestGrid::new(&points, 1.0, 4.0, &Execution::default())?;
        assert!(grid.nearest.len() < points.len() * 2 * 24 * 24);
        Ok(())
    }
}
