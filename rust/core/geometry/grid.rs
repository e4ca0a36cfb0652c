//! A uniform grid whose cells own contiguous runs of points.
//!
//! Cells are numbered along x first, so that the cells of a ball in one row form a single run of memory. Only
//! occupied cells are stored. Rows are found through a table if there are few of them, as on surfaces, and by
//! bisection otherwise. Memory is linear in the number of points.

use rayon::prelude::*;

use crate::error::Result;
use crate::memory;
use crate::points::Points;

/// Cells along an axis; the number of a row stays below 2^62.
const MAX_CELLS_PER_AXIS: f64 = (1_u64 << 31) as f64;
/// Most rows of the table per point of the cloud.
const ROWS_PER_POINT: u64 = 4;

/// Most cells of the table of all cells, per point and besides.
const CELLS_PER_POINT: usize = 16;
const CELLS: usize = 1 << 16;

/// Points per occupied cell of a sparse grid, at most.
const FEW: usize = 8;

/// Factor of a reach that rounding may have reduced.
const ROUNDED_UP: f64 = 1.0 + 1e-9;

/// Points sorted into cells.
#[derive(Debug)]
pub(super) struct Grid {
    cell_size: f64,
    low: [f64; 3],
    cells: [u64; 3],
    rows: Rows,
    /// Cell along x of every occupied cell, row after row.
    columns: Vec<u32>,
    /// Start of each cell's points, then the number of points.
    starts: Vec<u32>,
    /// Start of the points of every cell, occupied or not, then the number of points; empty without
    /// [`Grid::with_table`].
    table: Vec<u32>,
    /// Coordinates in grid order.
    pub points: Vec<[f64; 3]>,
    /// Index of each point in the cloud.
    pub order: Vec<u32>,
}

/// Start of the occupied cells of every row of cells.
#[derive(Debug, Clone)]
enum Rows {
    /// One entry per row, plus one.
    Table(Vec<u32>),
    /// One entry per occupied row, plus one in `first`.
    Occupied { rows: Vec<u64>, first: Vec<u32> },
}

impl Rows {
    fn new(occupied: &[u64], total: u64, points: usize) -> Result<Self> {
        let runs = occupied.chunk_by(|a, b| a == b);
        if total > ROWS_PER_POINT * points as u64 + 1024 {
            let rows = memory::collect(runs.clone().map(|run| run[0]))?;
            let first = running_total(runs.map(|run| run.len() as u32))?;
            return Ok(Self::Occupied { rows, first });
        }
        let mut lengths = memory::filled(0, total as usize)?;
        for &row in occupied {
            lengths[row as usize] += 1;
        }
        running_total(lengths.into_iter()).map(Self::Table)
    }

    /// Calls `f` with the occupied rows between two rows and the ranges of their cells, until it returns a value.
    #[inline]
    fn visit<R>(&self, low: u64, high: u64, mut f: impl FnMut(u64, usize, usize) -> Option<R>) -> Option<R> {
        match self {
            Self::Table(first) => {
                let ends = &first[low as usize..=high as usize + 1];
                let some = ends.windows(2).zip(low..).filter(|(ends, _)| ends[0] < ends[1]);
                some.into_iter().find_map(|(ends, row)| f(row, ends[0] as usize, ends[1] as usize))
            }
            Self::Occupied { rows, first } => {
                let start = rows.partition_point(|&row| row < low);
                let some = rows[start..].iter().zip(first[start..].windows(2));
                some.take_while(|&(&row, _)| row <= high)
                    .find_map(|(&row, ends)| f(row, ends[0] as usize, ends[1] as usize))
            }
        }
    }

    /// Range of occupied cells of a row.
    #[inline]
    fn get(&self, row: u64) -> (usize, usize) {
        match self {
            Self::Table(first) => (first[row as usize] as usize, first[row as usize + 1] as usize),
            Self::Occupied { rows, first } => match rows.binary_search(&row) {
                Ok(place) => (first[place] as usize, first[place + 1] as usize),
                Err(_) => (0, 0),
            },
        }
    }
}

/// Running sums: 0, a, a + b, ...
fn running_total(lengths: impl Iterator<Item = u32>) -> Result<Vec<u32>> {
    let mut total = 0;
    memory::collect(std::iter::once(0).chain(lengths).map(|length| {
        total += length;
        total
    }))
}

impl Grid {
    /// Sorts the points into cells of about `cell_size`. Cost O(N log N), memory 36 to 70 bytes per point.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(cloud: &Points, cell_size: f64) -> Result<Self> {
        let (low, extent) = cloud.bounding_box();
        let widest = extent.iter().copied().fold(0.0, f64::max);
        let cell_size = cell_size.max(widest / (MAX_CELLS_PER_AXIS - 1.0));
        let cells = extent.map(|length| (length / cell_size) as u64 + 1);
        let mut grid = Self {
            cell_size,
            low,
            cells,
            rows: Rows::Table(Vec::new()),
            columns: Vec::new(),
            starts: Vec::new(),
            table: Vec::new(),
            points: Vec::new(),
            order: Vec::new(),
        };
        grid.fill(cloud)?;
        Ok(grid)
    }

    /// Reorders one value per point of the cloud into grid order.
    pub fn reorder<T: Copy>(&self, values: &[T]) -> Result<Vec<T>> {
        memory::collect(self.order.iter().map(|&index| values[index as usize]))
    }

    /// Calls `f` with every non-empty run of points that may lie within the radius, until it returns a value.
    pub fn visit_runs<R>(
        &self,
        center: [f64; 3],
        radius: f64,
        mut f: impl FnMut(usize, usize) -> Option<R>,
    ) -> Option<R> {
        let low: [u64; 3] = std::array::from_fn(|k| self.cell(center[k] - radius, k));
        let high: [u64; 3] = std::array::from_fn(|k| self.cell(center[k] + radius, k));
        for z in low[2]..=high[2] {
            let across = radius * radius - self.square_gap(center[2], z, 2);
            let base = z * self.cells[1];
            let found = self.rows.visit(base + low[1], base + high[1], |row, first, end| {
                let along = across - self.square_gap(center[1], row - base, 1);
                if along < 0.0 {
                    return None;
                }
                let reach = ROUNDED_UP * along.sqrt();
                let ends = [center[0] - reach, center[0] + reach].map(|x| self.cell(x, 0));
                let (start, end) = self.run((first, end), ends[0], ends[1])?;
                f(start, end)
            });
            if found.is_some() {
                return found;
            }
        }
        None
    }

    /// Adds a table of all cells for [`Grid::visit_box`], unless there are too many.
    pub fn with_table(mut self) -> Result<Self> {
        let [along, across, up] = self.cells;
        let total = u128::from(along) * u128::from(across * up);
        if total > (CELLS_PER_POINT * self.points.len() + CELLS) as u128 {
            return Ok(self);
        }
        memory::reserve(&mut self.table, total as usize + 1)?;
        let last = (across * up).saturating_sub(1);
        self.rows.visit(0, last, |row, first, end| {
            for cell in first..end {
                let place = row * along + u64::from(self.columns[cell]);
                self.table.resize(place as usize + 1, self.starts[cell]);
            }
            None::<()>
        });
        self.table.resize(total as usize + 1, self.points.len() as u32);
        Ok(self)
    }

    /// Calls `f` with the runs of all cells that a box around the ball touches: more points than with
    /// [`Grid::visit_runs`], found faster.
    pub fn visit_box(&self, center: [f64; 3], radius: f64, mut f: impl FnMut(usize, usize)) {
        let [low, high] = [-radius, radius].map(|shift| [0, 1, 2].map(|k| self.cell(center[k] + shift, k)));
        for z in low[2]..=high[2] {
            let base = z * self.cells[1];
            if !self.table.is_empty() {
                for row in base + low[1]..=base + high[1] {
                    let [start, end] =
                        [low[0], high[0] + 1].map(|x| self.table[(row * self.cells[0] + x) as usize]);
                    f(start as usize, end as usize);
                }
                continue;
            }
            self.rows.visit(base + low[1], base + high[1], |_, first, end| {
                if let Some((start, end)) = self.run((first, end), low[0], high[0]) {
                    f(start, end);
                }
                None::<()>
            });
        }
    }

    /// Calls `f` with every non-empty run of points that may lie within the radius, that of the centre's own row first; `f`
    /// returns the square of the radius for the runs that follow.
    pub fn visit_nearest(&self, center: [f64; 3], radius: f64, mut f: impl FnMut(usize, usize) -> f64) {
        let low: [u64; 3] = std::array::from_fn(|k| self.cell(center[k] - radius, k));
        let high: [u64; 3] = std::array::from_fn(|k| self.cell(center[k] + radius, k));
        let (own_y, own_z) = (self.cell(center[1], 1), self.cell(center[2], 2));
        let mut limit = radius * radius;
        let own = self.rows.get(own_z * self.cells[1] + own_y);
        if let Some((start, end)) = self.run(own, low[0], high[0]) {
            limit = f(start, end);
        }
        for z in low[2]..=high[2] {
            let across = self.square_gap(center[2], z, 2);
            for y in low[1]..=high[1] {
                if (y, z) != (own_y, own_z)
                    && across + self.square_gap(center[1], y, 1) <= limit
                    && let Some((start, end)) =
                        self.run(self.rows.get(z * self.cells[1] + y), low[0], high[0])
                {
                    limit = f(start, end);
                }
            }
        }
    }

    /// Whether a cell holds few points.
    pub fn is_sparse(&self) -> bool {
        self.points.len() <= FEW * self.columns.len()
    }

    /// Points of the occupied cells of a row between two columns.
    #[inline]
    fn run(&self, (first, end): (usize, usize), low: u64, high: u64) -> Option<(usize, usize)> {
        let columns = &self.columns[first..end];
        let from = columns.partition_point(|&x| u64::from(x) < low);
        // Few cells lie within a radius.
        let count = columns[from..].iter().take_while(|&&x| u64::from(x) <= high).count();
        let start = |cell: usize| self.starts[first + cell] as usize;
        (count > 0).then(|| (start(from), start(from + count)))
    }

    /// Lower bound of the squared distance of a coordinate from a cell along axis `k`.
    #[inline]
    fn square_gap(&self, coordinate: f64, cell: u64, k: usize) -> f64 {
        let from_middle = (coordinate - self.low[k]) / self.cell_size - (cell as f64 + 0.5);
        // Rounding moves no point by more than a thousandth of a cell.
        let gap = (from_middle.abs() - 0.501).max(0.0) * self.cell_size;
        gap * gap
    }

    /// Cell of a coordinate along axis `k`; coordinates outside the box map to its outermost cells.
    #[inline]
    fn cell(&self, coordinate: f64, k: usize) -> u64 {
        let cell = ((coordinate - self.low[k]) / self.cell_size).max(0.0) as u64;
        cell.min(self.cells[k] - 1)
    }

    fn fill(&mut self, cloud: &Points) -> Result<()> {
        let cell_of = |index: usize| {
            let point = cloud.get(index);
            let [x, y, z] = [0, 1, 2].map(|k| self.cell(point[k], k));
            (z * self.cells[1] + y, x as u32, index as u32)
        };
        let mut keyed: Vec<(u64, u32, u32)> = memory::collect((0..cloud.len()).map(cell_of))?;
        keyed.par_sort_unstable();
        let occupied = keyed.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1));
        let rows = memory::collect(occupied.clone().map(|cell| cell[0].0))?;
        self.columns = memory::collect(occupied.clone().map(|cell| cell[0].1))?;
        self.starts = running_total(occupied.map(|cell| cell.len() as u32))?;
        self.rows = Rows::new(&rows, self.cells[1] * self.cells[2], cloud.len())?;
        self.order = memory::collect(keyed.iter().map(|&(_, _, index)| index))?;
        self.points = memory::collect(self.order.iter().map(|&index| cloud.get(index as usize).into()))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;

    #[test]
    fn a_far_outlier_needs_no_table() -> Result<()> {
        let mut rows: Vec<[f64; 3]> =
            (0..300).map(|i| [1.1, 2.3, 3.7].map(|f| (f64::from(i) * f).sin())).collect();
        let near = Grid::new(&Points::from_rows("points", &rows)?, 0.15)?;
        assert!(matches!(near.rows, Rows::Table(_)));
        rows.push([1e9, -1e9, 1e9]);
        let far = Grid::new(&Points::from_rows("points", &rows)?, 0.15)?;
        assert!(matches!(far.rows, Rows::Occupied { .. }));
        Ok(())
    }
}
