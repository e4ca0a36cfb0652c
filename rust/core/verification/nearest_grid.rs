//! Nearest point of a surface by one grid lookup.
//!
//! Each cell stores the point nearest to its centre. Within a cell of size c another point may be nearer to
//! the query by less than `c sqrt(3)`; both lie on the surface, and their distances to its plane hardly
//! differ. Blocks of 8 x 8 x 8 cells exist only near points, so memory grows with the surface and not with
//! its bounding box. A block is filled at its first lookup.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]
#![expect(clippy::needless_bitwise_bool, reason = "without branches all lanes are computed at once")]

use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::Vector3;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;
use crate::simd;
use crate::verification::group::{Coordinates, LANES};

/// Cells along an edge of a block.
const EDGE: usize = 8;
const CELLS: usize = EDGE * EDGE * EDGE;
/// Cells along an edge of the parts that a block is filled by.
const PART: usize = 4;
/// Radius, in cells, of a ball around the middle of a part that holds the centres of all its cells:
/// `1.5 sqrt(3)` and room for rounding.
const PART_RADIUS: f32 = 3.0;

/// Most blocks along an axis of the box: `f32` then resolves positions to a sixteenth of a cell.
const MOST_BLOCKS_ALONG: f64 = (1 << 17) as f64;
/// Most blocks of the box: 64 MiB of pages.
const MOST_BLOCKS_IN_BOX: f64 = (1 << 30) as f64;
/// Entries per page of the table of blocks.
const PAGE: usize = 64;
/// Points between two checks for an interruption.
const STRETCH: usize = 1 << 16;
/// Most blocks that exist: 512 MiB once all are filled.
const MOST_BLOCKS: usize = 1 << 18;

/// No point.
pub(super) const NONE: u32 = u32::MAX;
/// No cell.
const OUTSIDE: u32 = u32::MAX;

/// The error for a block whose memory the system refused.
pub(super) fn refused() -> Error {
    Error::OutOfMemory { bytes: size_of::<[u32; CELLS]>() }
}

/// A point with its number.
type Member = (Vector3<f32>, u32);

#[derive(Debug)]
pub(super) struct NearestGrid {
    low: Vector3<f32>,
    cells_per_length: f32,
    reach: f32,
    /// Blocks along each axis.
    size: [usize; 3],
    /// Number of each block of the box plus one; 0 if it does not exist.
    blocks: Table,
    /// Start of each block's points among the members, then the number of members.
    starts: Vec<u32>,
    /// The points, sorted by block.
    members: Vec<Member>,
    /// Nearest point of each cell of a block.
    nearest: Vec<OnceLock<Box<[u32; CELLS]>>>,
    /// Number of blocks that could not be filled because memory was refused.
    refusals: AtomicUsize,
}

/// A number for each block of a box, in pages: pages near points exist, all others share the first, of zeros.
#[derive(Debug)]
struct Table {
    pages: Vec<u32>,
    numbers: Vec<u32>,
}

impl Table {
    fn new(blocks: usize) -> Result<Self> {
        Ok(Self { pages: memory::filled(0, blocks.div_ceil(PAGE))?, numbers: memory::filled(0, PAGE)? })
    }

    #[inline(always)]
    fn get(&self, block: usize) -> u32 {
        self.numbers[self.pages[block / PAGE] as usize * PAGE + block % PAGE]
    }

    fn entry(&mut self, block: usize) -> Result<&mut u32> {
        let page = &mut self.pages[block / PAGE];
        if *page == 0 {
            *page = (self.numbers.len() / PAGE) as u32;
            memory::resize(&mut self.numbers, (*page as usize + 1) * PAGE, 0)?;
        }
        Ok(&mut self.numbers[*page as usize * PAGE + block % PAGE])
    }
}

impl NearestGrid {
    /// Builds a grid with cells of a given size, each with the nearest of the points within `reach` of its
    /// centre, ties to the lower index. The reach must not exceed 8 cells.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if the points lie too far apart for cells of this size;
    /// [`Error::Interrupted`], [`Error::OutOfMemory`].
    pub fn new(points: &[Vector3<f32>], (cell, reach): (f32, f32), execution: &Execution) -> Result<Self> {
        let mut grid = Self::around(points, cell, reach)?;
        let count = grid.number_blocks(points, execution)?;
        grid.nearest = memory::collect((0..count).map(|_| OnceLock::new()))?;
        grid.sort(points, execution)?;
        Ok(grid)
    }

    /// Empty grid whose box holds all points and their reach.
    fn around(points: &[Vector3<f32>], cell: f32, reach: f32) -> Result<Self> {
        let (low, high) = points
            .iter()
            .fold((Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY)), |(low, high), p| {
                (low.inf(p), high.sup(p))
            });
        let low = low.map(|number| number - reach - cell);
        let blocks = (high - low)
            .map(|length| f64::from((length + reach + cell) / (cell * EDGE as f32)).floor() + 1.0);
        let fits = blocks.product() <= MOST_BLOCKS_IN_BOX && blocks.amax() <= MOST_BLOCKS_ALONG;
        if !fits {
            let spans = (high - low).amax();
            let remedy = "give a larger unit (0.4 of a voxel), or remove distant outliers";
            return Err(Error::invalid("unit", format!("points that span {spans:.0} units"), remedy));
        }
        Ok(Self {
            low,
            cells_per_length: cell.recip(),
            reach,
            size: [0, 1, 2].map(|k| blocks[k] as usize),
            blocks: Table::new(blocks.product() as usize)?,
            starts: Vec::new(),
            members: Vec::new(),
            nearest: Vec::new(),
            refusals: AtomicUsize::new(0),
        })
    }

    /// Numbers the blocks that intersect the ball around any point; returns their count.
    fn number_blocks(&mut self, points: &[Vector3<f32>], execution: &Execution) -> Result<usize> {
        let mut count = 0;
        for (i, point) in points.iter().enumerate() {
            if i.is_multiple_of(STRETCH) {
                execution.check()?;
            }
            if count as usize > MOST_BLOCKS {
                let remedy = "downsample the points first (features.voxel_downsample), or give a larger unit";
                let got = format!("{} points over a wide surface", points.len());
                return Err(Error::invalid("points", got, remedy));
            }
            let [first, last] =
                [-self.reach, self.reach].map(|shift| self.block_of(&point.add_scalar(shift)));
            for (z, y) in (first[2]..=last[2]).flat_map(|z| (first[1]..=last[1]).map(move |y| (z, y))) {
                for block in self.block_at([first[0], y, z])..=self.block_at([last[0], y, z]) {
                    let number = self.blocks.entry(block)?;
                    if *number == 0 {
                        count += 1;
                        *number = count;
                    }
                }
            }
        }
        Ok(count as usize)
    }

    /// Sorts the points into the blocks.
    fn sort(&mut self, points: &[Vector3<f32>], execution: &Execution) -> Result<()> {
        let number = |point: &Vector3<f32>| self.blocks.get(self.block_at(self.block_of(point))) as usize;
        let mut starts = memory::filled(0, self.nearest.len() + 1)?;
        points.iter().for_each(|point| starts[number(point)] += 1);
        for block in 1..starts.len() {
            starts[block] += starts[block - 1];
        }
        execution.check()?;
        let mut members = memory::filled((Vector3::zeros(), NONE), points.len())?;
        for (index, point) in points.iter().enumerate().rev() {
            let place = &mut starts[number(point)];
            *place -= 1;
            members[*place as usize] = (*point, index as u32);
        }
        starts[0] = points.len() as u32;
        starts.rotate_left(1);
        (self.starts, self.members) = (starts, members);
        Ok(())
    }

    fn block_of(&self, place: &Vector3<f32>) -> [usize; 3] {
        [0, 1, 2].map(|k| {
            let cell = ((place[k] - self.low[k]) * self.cells_per_length).max(0.0) as usize;
            (cell / EDGE).min(self.size[k] - 1)
        })
    }

    fn block_at(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// Number of blocks whose memory was refused so far; results since then may be wrong.
    pub fn refusals(&self) -> usize {
        self.refusals.load(Ordering::Relaxed)
    }

    /// Nearest points of a block, which is filled at its first lookup; `None` if memory was refused.
    #[inline(always)]
    fn block(&self, number: usize, at: usize) -> Option<&[u32; CELLS]> {
        let slot = &self.nearest[number - 1];
        slot.get().map_or_else(|| self.fill_slot(slot, at), |filled| Some(filled))
    }

    #[cold]
    fn fill_slot<'a>(&self, slot: &'a OnceLock<Box<[u32; CELLS]>>, at: usize) -> Option<&'a [u32; CELLS]> {
        // Two threads may fill it at the same time, with the same numbers.
        let filled = self.fill(at);
        if filled.is_err() {
            self.refusals.fetch_add(1, Ordering::Relaxed);
        }
        filled.ok().map(|filled| &**slot.get_or_init(|| filled))
    }

    /// Nearest point of every cell of the block at a place in the table.
    fn fill(&self, at: usize) -> Result<Box<[u32; CELLS]>> {
        let corner =
            [at % self.size[0], at / self.size[0] % self.size[1], at / (self.size[0] * self.size[1])];
        let around = self.members_around(corner)?;
        let cells = memory::filled(NONE, CELLS)?.into_boxed_slice();
        let mut cells = Box::<[u32; CELLS]>::try_from(cells).map_err(|_| refused())?;
        for part in 0..(EDGE / PART).pow(3) {
            let first = [part % 2, part / 2 % 2, part / 4].map(|half| half * PART);
            let nearest = self.fill_part([0, 1, 2].map(|k| corner[k] * EDGE + first[k]), &around);
            for (row, values) in nearest.as_chunks::<PART>().0.iter().enumerate() {
                let start = ((first[2] + row / PART) * EDGE + first[1] + row % PART) * EDGE + first[0];
                cells[start..start + PART].copy_from_slice(values);
            }
        }
        Ok(cells)
    }

    /// Points of a block and of its neighbours.
    fn members_around(&self, corner: [usize; 3]) -> Result<Vec<Member>> {
        let [x, y, z] =
            [0, 1, 2].map(|k| corner[k].saturating_sub(1)..=(corner[k] + 1).min(self.size[k] - 1));
        let rows = z.flat_map(|z| y.clone().map(move |y| (z, y)));
        let blocks =
            rows.flat_map(|(z, y)| self.block_at([*x.start(), y, z])..=self.block_at([*x.end(), y, z]));
        let numbers = blocks.map(|block| self.blocks.get(block) as usize);
        let members = numbers
            .filter(|&number| number > 0)
            .flat_map(|number| &self.members[self.starts[number - 1] as usize..self.starts[number] as usize]);
        memory::collect(members.copied())
    }

    /// Nearest member to the centre of every cell of a part, given the part's first cell.
    fn fill_part(&self, first: [usize; 3], members: &[Member]) -> [u32; PART * PART * PART] {
        let cell = self.cells_per_length.recip();
        let center = |k: usize, i: usize| self.low[k] + ((first[k] + i) as f32 + 0.5) / self.cells_per_length;
        let middle = Vector3::from([0, 1, 2].map(|k| self.low[k] + (first[k] + PART / 2) as f32 * cell));
        let squared_distance = |(point, _): &Member| (point - middle).norm_squared();
        let least = members.iter().map(squared_distance).fold(f32::INFINITY, f32::min).sqrt();
        // A point beyond this distance from the middle is farther from every centre than the nearest point or
        // the reach.
        let limit = (least + 2.0 * PART_RADIUS * cell).min(self.reach + PART_RADIUS * cell);
        let [x, y] = [0, 1].map(|k| {
            std::array::from_fn::<f32, LANES, _>(|lane| {
                center(k, if k == 0 { lane % PART } else { lane / PART })
            })
        });
        let z: [f32; PART] = std::array::from_fn(|i| center(2, i));
        let nearest = simd::run(
            #[inline(always)]
            || {
                let (x, y, z) = (x, y, z);
                // A squared distance equal to the squared reach is too far.
                let mut squares = [[(self.reach * self.reach).next_down(); LANES]; PART];
                let mut nearest = [[NONE; LANES]; PART];
                for &(point, index) in members {
                    if squared_distance(&(point, index)) > limit * limit {
                        continue;
                    }
                    for layer in 0..PART {
                        let dz = (z[layer] - point.z) * (z[layer] - point.z);
                        for lane in 0..LANES {
                            let dy = (y[lane] - point.y) * (y[lane] - point.y);
                            let square = dz + dy + (x[lane] - point.x) * (x[lane] - point.x);
                            let (least, holder) = (squares[layer][lane], nearest[layer][lane]);
                            let is_tie = square.to_bits() == least.to_bits();
                            let is_nearer = (square < least) | (is_tie & (index < holder));
                            squares[layer][lane] = if is_nearer { square } else { least };
                            nearest[layer][lane] = if is_nearer { index } else { holder };
                        }
                    }
                }
                nearest
            },
        );
        std::array::from_fn(|cell| nearest[cell / LANES][cell % LANES])
    }

    /// Points nearest to the centres of the cells that hold the queries, `NONE` if there is none.
    #[inline(always)]
    pub fn get(&self, places: &Coordinates) -> [u32; LANES] {
        let (mut blocks, mut cells) = ([OUTSIDE; LANES], [0; LANES]);
        let edge = EDGE as u32;
        let size = self.size.map(|count| count as u32);
        for lane in 0..LANES {
            let c = [0, 1, 2].map(|k| (places[k][lane] - self.low[k]) * self.cells_per_length);
            let is_inside = (c[0] >= 0.0 && c[0] < (size[0] * edge) as f32)
                & (c[1] >= 0.0 && c[1] < (size[1] * edge) as f32)
                & (c[2] >= 0.0 && c[2] < (size[2] * edge) as f32);
            let [x, y, z] = c.map(|c| c as i32 as u32);
            let row = (z / edge).wrapping_mul(size[1]).wrapping_add(y / edge);
            let block = row.wrapping_mul(size[0]).wrapping_add(x / edge);
            blocks[lane] = if is_inside { block } else { OUTSIDE };
            cells[lane] = (z % edge * edge + y % edge) * edge + x % edge;
        }
        let mut nearest = [NONE; LANES];
        for lane in 0..LANES {
            if blocks[lane] == OUTSIDE {
                continue;
            }
            let number = self.blocks.get(blocks[lane] as usize) as usize;
            if number > 0 {
                let filled = self.block(number, blocks[lane] as usize);
                nearest[lane] = filled.map_or(NONE, |filled| filled[cells[lane] as usize % CELLS]);
            }
        }
        nearest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scattered(count: usize) -> Vec<Vector3<f32>> {
        (0..count).map(|i| Vector3::new(1.1, 2.3, 3.7).map(|f| 20.0 * (i as f32 * f).sin())).collect()
    }

    /// Looks up one place, repeated in all lanes.
    fn look(grid: &NearestGrid, place: &Vector3<f32>) -> Option<usize> {
        let found = grid.get(&[0, 1, 2].map(|k| [place[k]; LANES]));
        assert!(found.iter().all(|&index| index == found[0]));
        (found[0] != NONE).then_some(found[0] as usize)
    }

    fn nearest_to(points: &[Vector3<f32>], place: &Vector3<f32>, reach: f32) -> Option<(usize, f32)> {
        let distances = points.iter().map(|p| (p - place).norm()).enumerate();
        distances.filter(|d| d.1 < reach).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    #[test]
    fn cells_name_the_point_nearest_to_their_centre() -> Result<()> {
        let points = scattered(300);
        for (cell, reach) in [(1.5, 8.0), (1.0, 4.0)] {
            let grid = NearestGrid::new(&points, (cell, reach), &Execution::default())?;
            for place in scattered(2000).iter().map(|p| p * 1.3 + Vector3::repeat(0.37)) {
                let center =
                    (place - grid.low).map(|length| ((length / cell).floor() + 0.5) * cell) + grid.low;
                let distance = |i: usize| (points[i] - center).norm();
                match (look(&grid, &place), nearest_to(&points, &center, reach)) {
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
    fn distant_points_are_refused_and_places_outside_are_empty() -> Result<()> {
        let mut points = scattered(30);
        let grid = NearestGrid::new(&points, (1.0, 4.0), &Execution::default())?;
        for far in [1e3, -1e3, f32::INFINITY, f32::NAN] {
            assert_eq!(look(&grid, &Vector3::new(far, 0.0, 0.0)), None);
        }
        points.push(Vector3::repeat(1e7));
        assert!(NearestGrid::new(&points, (1.0, 4.0), &Execution::default()).is_err());
        Ok(())
    }

    #[test]
    fn a_wide_box_takes_memory_by_its_surface() -> Result<()> {
        let parts = scattered(40).into_iter().map(|place| place * 200.0);
        let points: Vec<_> =
            parts.flat_map(|place| scattered(50).into_iter().map(move |p| place + p / 10.0)).collect();
        let grid = NearestGrid::new(&points, (1.0, 4.0), &Execution::default())?;
        assert!(grid.blocks.pages.len() * PAGE > 1 << 26);
        assert!(grid.blocks.numbers.len() < 40 * 64 * PAGE);
        for (i, point) in points.iter().enumerate() {
            let found = look(&grid, point).ok_or_else(refused)?;
            assert!((points[found] - points[i]).norm() < 3.0);
        }
        Ok(())
    }

    #[test]
    fn a_wide_thin_scan_takes_memory_by_its_surface() -> Result<()> {
        let points: Vec<_> = (0..2000).map(|i| Vector3::new(i as f32 * 2.0, (i % 7) as f32, 0.0)).collect();
        let grid = NearestGrid::new(&points, (1.0, 4.0), &Execution::default())?;
        assert!(grid.nearest.len() * CELLS < points.len() * 2 * 24 * 24);
        assert!(grid.nearest.iter().all(|block| block.get().is_none()));
        assert_eq!(look(&grid, &points[70]), Some(70));
        assert_eq!(grid.nearest.iter().filter(|block| block.get().is_some()).count(), 1);
        Ok(())
    }
}
