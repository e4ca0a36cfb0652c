//! All points within a fixed radius: a uniform grid whose cells own contiguous runs of points.
//!
//! Cells are numbered along x first, so that the cells a ball touches in one row form a single run of
//! memory. Only occupied cells are stored; rows are found through a table where there are few of them, as
//! on surfaces, and by bisection otherwise. Memory is linear in the number of points.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::error::{Result, positive};
use crate::execution::Execution;
use crate::points::Points;

/// Cells per radius: smaller cells fit the ball better, larger ones need fewer look-ups.
const CELLS_PER_RADIUS: f64 = 2.0;
/// Cells along an axis; the number of a row stays below 2^62.
const MAX_CELLS_PER_AXIS: f64 = (1_u64 << 31) as f64;
/// Rows of the table per point of the cloud.
const ROWS_PER_POINT: u64 = 4;
/// Queries that one task takes.
const QUERIES_PER_TASK: usize = 128;
/// Positions to either side that a search for any one point tries first.
const LOOK_AROUND: usize = 6;

/// Finds all points nearer than a radius fixed in advance.
#[derive(Debug, Clone)]
pub struct BallSearch {
    radius: f64,
    cell_size: f64,
    low: [f64; 3],
    cells: [u64; 3],
    rows: Rows,
    /// Cell along x of every occupied cell, row after row.
    columns: Vec<u32>,
    /// Where the points of each of them begin, and at last their number.
    starts: Vec<u32>,
    /// Coordinates in grid order.
    points: Vec<[f64; 3]>,
    /// Index of each of them in the cloud.
    order: Vec<u32>,
}

/// For every row of cells, where its occupied cells begin.
#[derive(Debug, Clone)]
enum Rows {
    /// One entry per row, and one more.
    Table(Vec<u32>),
    /// One entry per occupied row, and one more in `first`.
    Occupied { rows: Vec<u64>, first: Vec<u32> },
}

impl Rows {
    fn new(occupied: &[u64], total: u64, points: usize) -> Self {
        let runs = occupied.chunk_by(|a, b| a == b);
        if total > ROWS_PER_POINT * points as u64 + 1024 {
            let rows = runs.clone().map(|run| run[0]).collect();
            let lengths = runs.map(|run| run.len() as u32);
            return Self::Occupied { rows, first: running_total(lengths) };
        }
        let mut lengths = vec![0; total as usize];
        for &row in occupied {
            lengths[row as usize] += 1;
        }
        Self::Table(running_total(lengths.into_iter()))
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

/// 0, a, a + b, ...
fn running_total(lengths: impl Iterator<Item = u32>) -> Vec<u32> {
    let mut total = 0;
    let mut result = vec![0];
    result.extend(lengths.map(|length| {
        total += length;
        total
    }));
    result
}

/// What one query found. Order: that of the grid, the same for any number of threads.
#[derive(Debug, Clone, Default)]
pub struct Ball {
    // Buffers only grow; the first `len` entries are valid.
    len: usize,
    offsets: Vec<[f64; 3]>,
    squared_distances: Vec<f64>,
    positions: Vec<u32>,
}

impl Ball {
    /// Number of points found.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether nothing was found.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Vector from the centre to each point found.
    pub fn offsets(&self) -> &[[f64; 3]] {
        &self.offsets[..self.len]
    }

    /// Squared length of each of them.
    pub fn squared_distances(&self) -> &[f64] {
        &self.squared_distances[..self.len]
    }

    /// Position of each point in grid order (see [`BallSearch::reorder`]).
    pub fn positions(&self) -> &[u32] {
        &self.positions[..self.len]
    }

    /// Offset of point `i` from the centre.
    #[inline]
    pub fn vector(&self, i: usize) -> Vector3<f64> {
        Vector3::from(self.offsets()[i])
    }

    fn reserve(&mut self, more: usize) {
        let needed = self.len + more;
        if self.positions.len() < needed {
            let size = needed.next_power_of_two();
            self.offsets.resize(size, [0.0; 3]);
            self.squared_distances.resize(size, 0.0);
            self.positions.resize(size, 0);
        }
    }

    /// A ball of the given offsets, at positions 0, 1, ...
    #[cfg(test)]
    pub(crate) fn fill(&mut self, offsets: &[[f64; 3]]) {
        self.len = offsets.len();
        self.offsets = offsets.to_vec();
        self.squared_distances = offsets.iter().map(|&v| Vector3::from(v).norm_squared()).collect();
        self.positions = (0..offsets.len() as u32).collect();
    }
}

impl BallSearch {
    /// Sorts the points into cells for queries of `radius`. Cost O(N), memory about 60 bytes per point.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] unless the radius is positive.
    pub fn new(cloud: &Points, radius: f64) -> Result<Self> {
        positive("radius", radius)?;
        let (low, extent) = bounding_box(cloud);
        let widest = extent.iter().copied().fold(0.0, f64::max);
        let cell_size = (radius / CELLS_PER_RADIUS).max(widest / (MAX_CELLS_PER_AXIS - 1.0));
        let cells = extent.map(|length| (length / cell_size) as u64 + 1);
        let mut grid = Self {
            radius,
            cell_size,
            low,
            cells,
            rows: Rows::Table(Vec::new()),
            columns: Vec::new(),
            starts: Vec::new(),
            points: Vec::new(),
            order: Vec::new(),
        };
        grid.fill(&cloud.rows());
        Ok(grid)
    }

    /// Radius of the queries.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Index in the cloud of the point at a position in grid order.
    #[inline]
    pub fn index(&self, position: u32) -> u32 {
        self.order[position as usize]
    }

    /// Puts one value per point of the cloud into grid order, so that a ball reads them in runs.
    pub fn reorder<T: Copy>(&self, values: &[T]) -> Vec<T> {
        self.order.iter().map(|&index| values[index as usize]).collect()
    }

    /// Finds the points whose distance from `center` is **less than** the radius (as FLANN, which PCL
    /// uses, does). A point of the cloud finds itself.
    pub fn within(&self, center: &Point3<f64>, ball: &mut Ball) {
        let center = [center.x, center.y, center.z];
        let limit = self.radius * self.radius;
        ball.len = 0;
        self.visit_runs(center, |start, end| {
            ball.reserve(end - start);
            let mut found = ball.len;
            for (point, position) in self.points[start..end].iter().zip(start as u32..) {
                let offset = [point[0] - center[0], point[1] - center[1], point[2] - center[2]];
                let square = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
                ball.offsets[found] = offset;
                ball.squared_distances[found] = square;
                ball.positions[found] = position;
                // Written first and counted only if inside: no branch to mispredict.
                found += usize::from(square < limit);
            }
            ball.len = found;
            None::<()>
        });
    }

    /// Whether any point nearer than the radius to the one at `position` satisfies `test`, which is given
    /// the positions of such points.
    pub fn any_near(&self, position: u32, test: impl Fn(u32) -> bool) -> bool {
        let center = self.points[position as usize];
        let limit = self.radius * self.radius;
        let is_hit = |other: usize| {
            let point = &self.points[other];
            let offset = [point[0] - center[0], point[1] - center[1], point[2] - center[2]];
            let square = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
            square < limit && test(other as u32)
        };
        // Neighbours in grid order are mostly neighbours in space, and often settle the question.
        let own = position as usize;
        let around = own.saturating_sub(LOOK_AROUND)..(own + LOOK_AROUND + 1).min(self.len());
        around.into_iter().any(is_hit)
            || self.visit_runs(center, |start, end| (start..end).any(is_hit).then_some(())).is_some()
    }

    /// Calls `f(position, ball)` for every point of the cloud, on all threads; one result per point, in
    /// the order of the cloud.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`] where the caller asked to stop.
    pub fn map_points<T, F>(&self, execution: &Execution, f: F) -> Result<Vec<T>>
    where
        T: Copy + Default + Send,
        F: Fn(u32, &Ball) -> T + Sync,
    {
        let mut sorted = vec![T::default(); self.len()];
        sorted.par_chunks_mut(QUERIES_PER_TASK).enumerate().try_for_each_init(
            Ball::default,
            |ball, (task, results)| {
                execution.check()?;
                for (result, position) in results.iter_mut().zip((task * QUERIES_PER_TASK) as u32..) {
                    self.within(&Point3::from(self.points[position as usize]), ball);
                    *result = f(position, ball);
                }
                Ok(())
            },
        )?;
        let mut results = vec![T::default(); self.len()];
        for (&index, &value) in self.order.iter().zip(&sorted) {
            results[index as usize] = value;
        }
        Ok(results)
    }

    /// Calls `f(i, ball)` for the ball around `centers[i]`, on all threads; one result per centre.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`] where the caller asked to stop.
    pub fn map_at<T, F>(&self, centers: &[Point3<f64>], execution: &Execution, f: F) -> Result<Vec<T>>
    where
        T: Send,
        F: Fn(usize, &Ball) -> T + Sync,
    {
        let query = |ball: &mut Ball, i: usize| {
            execution.check()?;
            self.within(&centers[i], ball);
            Ok(f(i, ball))
        };
        (0..centers.len()).into_par_iter().with_min_len(4).map_init(Ball::default, query).collect()
    }

    /// Calls `f` with every non-empty run of points that may lie within the radius, until it returns
    /// something.
    fn visit_runs<R>(&self, center: [f64; 3], mut f: impl FnMut(usize, usize) -> Option<R>) -> Option<R> {
        let low: [u64; 3] = std::array::from_fn(|k| self.cell(center[k] - self.radius, k));
        let high: [u64; 3] = std::array::from_fn(|k| self.cell(center[k] + self.radius, k));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                let (first, end) = self.rows.get(z * self.cells[1] + y);
                let columns = &self.columns[first..end];
                let from = first + columns.partition_point(|&x| u64::from(x) < low[0]);
                let to = first + columns.partition_point(|&x| u64::from(x) <= high[0]);
                if from < to
                    && let Some(result) = f(self.starts[from] as usize, self.starts[to] as usize)
                {
                    return Some(result);
                }
            }
        }
        None
    }

    /// Cell of a coordinate along axis `k`; places outside the box belong to its outermost cells.
    #[inline]
    fn cell(&self, coordinate: f64, k: usize) -> u64 {
        let cell = ((coordinate - self.low[k]) / self.cell_size).max(0.0) as u64;
        cell.min(self.cells[k] - 1)
    }

    fn fill(&mut self, points: &[[f64; 3]]) {
        let cell_of = |point: &[f64; 3], index: u32| {
            let [x, y, z] = [0, 1, 2].map(|k| self.cell(point[k], k));
            (z * self.cells[1] + y, x as u32, index)
        };
        let mut keyed: Vec<(u64, u32, u32)> =
            points.iter().zip(0..).map(|(point, index)| cell_of(point, index)).collect();
        keyed.par_sort_unstable();
        let occupied = keyed.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1));
        let rows: Vec<u64> = occupied.clone().map(|cell| cell[0].0).collect();
        self.columns = occupied.clone().map(|cell| cell[0].1).collect();
        self.starts = running_total(occupied.map(|cell| cell.len() as u32));
        self.rows = Rows::new(&rows, self.cells[1] * self.cells[2], points.len());
        self.order = keyed.iter().map(|&(_, _, index)| index).collect();
        self.points = self.reorder(points);
    }
}

fn bounding_box(cloud: &Points) -> ([f64; 3], [f64; 3]) {
    if cloud.is_empty() {
        return ([0.0; 3], [0.0; 3]);
    }
    let axes = [&cloud.x, &cloud.y, &cloud.z];
    let low = axes.map(|axis| axis.iter().copied().fold(f64::INFINITY, f64::min));
    let high = axes.map(|axis| axis.iter().copied().fold(f64::NEG_INFINITY, f64::max));
    (low, std::array::from_fn(|k| high[k] - low[k]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scattered(count: u32, scale: f64) -> Vec<[f64; 3]> {
        (0..count).map(|i| [1.1, 2.3, 3.7].map(|f| scale * (f64::from(i) * f).sin())).collect()
    }

    fn check(rows: &[[f64; 3]], radius: f64) -> Result<()> {
        let points = Points::from_rows("points", rows)?;
        let search = BallSearch::new(&points, radius)?;
        let mut ball = Ball::default();
        for query in 0..rows.len() {
            search.within(&points.get(query), &mut ball);
            let mut found: Vec<_> = ball.positions().iter().map(|&p| search.index(p) as usize).collect();
            found.sort_unstable();
            let expected: Vec<_> = (0..rows.len())
                .filter(|&i| (points.get(i) - points.get(query)).norm_squared() < radius * radius)
                .collect();
            assert_eq!(found, expected, "query {query}, radius {radius}");
            for (i, &position) in ball.positions().iter().enumerate() {
                let index = search.index(position) as usize;
                assert_eq!(ball.vector(i), points.get(index) - points.get(query));
            }
        }
        Ok(())
    }

    #[test]
    fn agrees_with_brute_force() -> Result<()> {
        for radius in [0.05, 0.3, 1.0, 5.0] {
            check(&scattered(300, 1.0), radius)?;
        }
        Ok(())
    }

    #[test]
    fn a_far_outlier_needs_no_table() -> Result<()> {
        let mut rows = scattered(300, 1.0);
        rows.push([1e9, -1e9, 1e9]);
        check(&rows, 0.3)?;
        let search = BallSearch::new(&Points::from_rows("points", &rows)?, 0.3)?;
        assert!(matches!(search.rows, Rows::Occupied { .. }));
        Ok(())
    }

    #[test]
    fn coincident_and_single_points() -> Result<()> {
        check(&[[1.0, 2.0, 3.0]; 20], 0.5)?;
        check(&[[1.0, 2.0, 3.0]], 0.5)?;
        check(&[], 0.5)
    }

    #[test]
    fn the_boundary_is_outside() -> Result<()> {
        let points = Points::from_rows("points", &[[0.0; 3], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])?;
        let search = BallSearch::new(&points, 1.0)?;
        let mut ball = Ball::default();
        search.within(&points.get(0), &mut ball);
        assert_eq!(ball.len(), 1);
        Ok(())
    }

    #[test]
    fn radius_must_be_positive() -> Result<()> {
        let points = Points::from_rows("points", &[])?;
        assert!(BallSearch::new(&points, 0.0).is_err() && BallSearch::new(&points, f64::NAN).is_err());
        Ok(())
    }
}
