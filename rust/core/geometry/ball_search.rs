//! Search for all points within a fixed radius, by a uniform grid.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::grid::Grid;
use crate::error::{Result, positive};
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;

/// Cells per radius: smaller cells fit the ball better, larger ones need fewer lookups.
const CELLS_PER_RADIUS: f64 = 2.0;
/// Least radius of a query relative to the grid's radius; cells hold too many points for smaller ones.
const LEAST_SHARE: f64 = 0.5;
/// Share of the grid's radius that the nearest point is searched within first.
const FIRST_SHARE: f64 = 0.4;
/// Queries per task.
const QUERIES_PER_TASK: usize = 128;
/// Positions on either side that a search for any point tests first.
const LOOK_AROUND: usize = 6;

/// Finds all points within a radius fixed in advance. Clones share the grid.
#[derive(Debug, Clone)]
pub struct BallSearch {
    radius: f64,
    /// Upper bound of the number of points found, the nearest.
    most: usize,
    /// The radius that the grid was built for.
    made_for: f64,
    grid: Arc<Grid>,
}

/// Result of a query, in grid order: the same for any number of threads.
#[derive(Debug, Clone, Default)]
pub struct Ball {
    // Buffers only grow; the first `len` entries are valid.
    len: usize,
    offsets: Vec<[f64; 3]>,
    squared_distances: Vec<f64>,
    positions: Vec<u32>,
    /// Squared distance, as its bits, and index in the cloud: the sort key if not all points are kept.
    keys: Vec<(u64, u32)>,
    ranked: Vec<(u64, u32)>,
}

/// The point nearest to a query.
#[derive(Debug, Clone, Copy, Default)]
pub struct Nearest {
    place: Point3<f64>,
    point: Option<Point3<f64>>,
    /// Radius around the query within which no other point lies.
    clear: f64,
}

impl Nearest {
    /// Vector from the query to the point.
    pub fn offset(&self) -> Option<Vector3<f64>> {
        self.point.map(|point| point - self.place)
    }

    /// The point nearest to another query, if it is certain without a search; a point beyond `reach` may be
    /// missing.
    pub fn seen_from(&self, place: &Point3<f64>, reach: f64) -> Option<Self> {
        let clear = self.clear - (place - self.place).norm();
        let is_nearest = |point: &Point3<f64>| (point - place).norm() < clear;
        let point = self.point.filter(is_nearest);
        (point.is_some() || reach <= clear).then_some(Self { place: *place, point, clear })
    }
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

    /// Squared lengths of the offsets.
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

    #[cold]
    fn grow(&mut self, needed: usize) -> Result<()> {
        let size = needed.next_power_of_two();
        memory::resize(&mut self.offsets, size, [0.0; 3])?;
        memory::resize(&mut self.squared_distances, size, 0.0)?;
        memory::resize(&mut self.positions, size, 0)
    }

    /// Fills a ball with the given offsets, at positions 0, 1, ...
    #[cfg(test)]
    pub(crate) fn fill(&mut self, offsets: &[[f64; 3]]) {
        self.len = offsets.len();
        self.offsets = offsets.to_vec();
        self.squared_distances = offsets.iter().map(|&v| Vector3::from(v).norm_squared()).collect();
        self.positions = (0..offsets.len() as u32).collect();
    }
}

impl BallSearch {
    /// Sorts the points into cells for queries of `radius`. Cost O(N log N), memory 36 to 70 bytes per point.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] unless the radius is positive; [`crate::Error::OutOfMemory`].
    pub fn new(cloud: &Points, radius: f64) -> Result<Self> {
        positive("radius", radius)?;
        let grid = Arc::new(Grid::new(cloud, radius / CELLS_PER_RADIUS)?);
        Ok(Self { radius, most: usize::MAX, made_for: radius, grid })
    }

    /// As [`BallSearch::new`], with cells that suit [`BallSearch::count`].
    ///
    /// # Errors
    /// Those of [`BallSearch::new`].
    pub fn for_counts(cloud: &Points, radius: f64) -> Result<Self> {
        positive("radius", radius)?;
        let mut grid = Grid::new(cloud, radius)?;
        if !grid.is_sparse() {
            grid = Grid::new(cloud, radius / CELLS_PER_RADIUS)?;
        }
        Ok(Self { radius, most: usize::MAX, made_for: radius, grid: Arc::new(grid.with_table()?) })
    }

    /// Whether the grid was built for this radius.
    pub fn is_made_for(&self, radius: f64) -> bool {
        self.made_for.to_bits() == radius.to_bits()
    }

    /// Whether queries of this radius are about as fast as on their own grid; balls come in another order.
    pub fn serves(&self, radius: f64) -> bool {
        (LEAST_SHARE * self.made_for..=self.made_for).contains(&radius)
    }

    /// A search in the same grid for a smaller radius.
    #[must_use]
    pub fn narrowed(&self, radius: f64) -> Self {
        Self { radius, ..self.clone() }
    }

    /// As this search, limited to the `most` nearest points of a ball; of equally near points to those of
    /// lower index.
    #[must_use]
    pub fn of_nearest(&self, most: usize) -> Self {
        Self { most, ..self.clone() }
    }

    /// Whether both searches share a grid.
    #[cfg(test)]
    pub(crate) fn shares_grid(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.grid, &other.grid)
    }

    /// Radius of the queries.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.grid.points.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.grid.points.is_empty()
    }

    /// Index in the cloud of every point, in grid order.
    pub fn order(&self) -> &[u32] {
        &self.grid.order
    }

    /// Index in the cloud of the point at a position in grid order.
    #[inline]
    pub fn index(&self, position: u32) -> u32 {
        self.grid.order[position as usize]
    }

    /// Reorders one value per point of the cloud into grid order, so that a ball reads contiguous runs.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn reorder<T: Copy>(&self, values: &[T]) -> Result<Vec<T>> {
        self.grid.reorder(values)
    }

    /// Finds the points whose distance from `center` is **less than** the radius (as FLANN, which PCL
    /// uses, does). A point of the cloud finds itself.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn within(&self, center: &Point3<f64>, ball: &mut Ball) -> Result<()> {
        let center = [center.x, center.y, center.z];
        let limit = self.radius * self.radius;
        ball.len = 0;
        let mut grown = Ok(());
        self.grid.visit_runs(center, self.radius, |start, end| {
            let needed = ball.len + (end - start);
            if ball.positions.len() < needed {
                grown = ball.grow(needed);
                if grown.is_err() {
                    return Some(());
                }
            }
            let mut found = ball.len;
            for (point, position) in self.grid.points[start..end].iter().zip(start as u32..) {
                let offset = [point[0] - center[0], point[1] - center[1], point[2] - center[2]];
                let square = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
                ball.offsets[found] = offset;
                ball.squared_distances[found] = square;
                ball.positions[found] = position;
                // Written first and counted only if inside: avoids a branch that would be mispredicted.
                found += usize::from(square < limit);
            }
            ball.len = found;
            None
        });
        grown?;
        if ball.len > self.most { self.keep_nearest(ball) } else { Ok(()) }
    }

    /// Number of points nearer than the radius.
    pub fn count(&self, center: &Point3<f64>) -> usize {
        let center = [center.x, center.y, center.z];
        let limit = self.radius * self.radius;
        let mut found = 0;
        self.grid.visit_box(center, self.radius, |start, end| {
            for point in &self.grid.points[start..end] {
                let offset = [point[0] - center[0], point[1] - center[1], point[2] - center[2]];
                let square = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
                found += usize::from(square < limit);
            }
        });
        found
    }

    /// The point nearest to a query, if nearer than the radius; ties to the first in grid order.
    pub fn nearest(&self, center: &Point3<f64>) -> Nearest {
        let place = [center.x, center.y, center.z];
        let mut radius = self.radius.min(FIRST_SHARE * self.made_for);
        loop {
            let (mut least, mut second, mut found) = (radius * radius, radius * radius, None);
            self.grid.visit_nearest(place, radius, |start, end| {
                for (point, position) in self.grid.points[start..end].iter().zip(start..) {
                    let offset = [point[0] - place[0], point[1] - place[1], point[2] - place[2]];
                    let square = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
                    let is_first = || found.is_some_and(|first| position < first);
                    if square < least || (square <= least && is_first()) {
                        (least, second, found) = (square, least, Some(position));
                    } else if square < second {
                        second = square;
                    }
                }
                second
            });
            if found.is_some() || radius >= self.radius {
                let point = found.map(|position| Point3::from(self.grid.points[position]));
                return Nearest { place: *center, point, clear: second.sqrt() };
            }
            radius = self.radius.min(2.0 * radius);
        }
    }

    /// Reduces the ball to the nearest points, in their order.
    fn keep_nearest(&self, ball: &mut Ball) -> Result<()> {
        let near = ball.squared_distances[..ball.len].iter().zip(&ball.positions);
        // Non-negative numbers and their bits have the same order; comparing bits is faster.
        let key = |(square, &position): (&f64, &u32)| (square.to_bits(), self.index(position));
        ball.keys.clear();
        memory::reserve(&mut ball.keys, ball.len)?;
        ball.keys.extend(near.map(key));
        ball.ranked.clear();
        memory::reserve(&mut ball.ranked, ball.len)?;
        ball.ranked.extend_from_slice(&ball.keys);
        let Some(place) = self.most.checked_sub(1) else {
            ball.len = 0;
            return Ok(());
        };
        let last = *ball.ranked.select_nth_unstable(place).1;
        let mut kept = 0;
        for i in 0..ball.len {
            ball.offsets[kept] = ball.offsets[i];
            ball.squared_distances[kept] = ball.squared_distances[i];
            ball.positions[kept] = ball.positions[i];
            kept += usize::from(ball.keys[i] <= last);
        }
        ball.len = kept;
        Ok(())
    }

    /// Whether any point nearer than the radius to the one at `position` satisfies `test`, a predicate on
    /// positions.
    pub fn any_near(&self, position: u32, test: impl Fn(u32) -> bool) -> bool {
        let center = self.grid.points[position as usize];
        let limit = self.radius * self.radius;
        let is_hit = |other: usize| {
            let point = &self.grid.points[other];
            let offset = [point[0] - center[0], point[1] - center[1], point[2] - center[2]];
            let square = offset[0] * offset[0] + offset[1] * offset[1] + offset[2] * offset[2];
            square < limit && test(other as u32)
        };
        // Neighbours in grid order are mostly neighbours in space, and often decide the query.
        let own = position as usize;
        let around = own.saturating_sub(LOOK_AROUND)..(own + LOOK_AROUND + 1).min(self.len());
        around.into_iter().any(is_hit)
            || self
                .grid
                .visit_runs(center, self.radius, |start, end| (start..end).any(is_hit).then_some(()))
                .is_some()
    }

    /// Calls `f(position, ball)` for every point of the cloud, on all threads; one result per point, in
    /// the order of the cloud.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`] if the caller requested a stop; [`crate::Error::OutOfMemory`].
    pub fn map_points<T, F>(&self, execution: &Execution, f: F) -> Result<Vec<T>>
    where
        T: Copy + Default + Send,
        F: Fn(u32, &Ball) -> T + Sync,
    {
        let mut sorted = memory::filled(T::default(), self.len())?;
        sorted.par_chunks_mut(QUERIES_PER_TASK).enumerate().try_for_each_init(
            Ball::default,
            |ball, (task, results)| {
                execution.check()?;
                for (result, position) in results.iter_mut().zip((task * QUERIES_PER_TASK) as u32..) {
                    self.within(&Point3::from(self.grid.points[position as usize]), ball)?;
                    *result = f(position, ball);
                }
                Ok(())
            },
        )?;
        let mut results = memory::filled(T::default(), self.len())?;
        for (&index, &value) in self.grid.order.iter().zip(&sorted) {
            results[index as usize] = value;
        }
        Ok(results)
    }

    /// Calls `f(i, ball)` for the ball around `centers[i]`, on all threads; returns one result per centre,
    /// with `value` as the placeholder.
    ///
    /// # Errors
    /// Those of `f`; [`crate::Error::Interrupted`] if the caller requested a stop;
    /// [`crate::Error::OutOfMemory`].
    pub fn map_at<T, F>(
        &self,
        centers: &[Point3<f64>],
        value: T,
        execution: &Execution,
        f: F,
    ) -> Result<Vec<T>>
    where
        T: Clone + Send,
        F: Fn(usize, &Ball) -> Result<T> + Sync,
    {
        let query = |ball: &mut Ball, i: usize| {
            execution.check()?;
            self.within(&centers[i], ball)?;
            f(i, ball)
        };
        let queries = (0..centers.len()).into_par_iter().with_min_len(4).map_init(Ball::default, query);
        memory::par_try_fill(value, queries)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scattered(count: u32, scale: f64) -> Vec<[f64; 3]> {
        (0..count).map(|i| [1.1, 2.3, 3.7].map(|f| scale * (f64::from(i) * f).sin())).collect()
    }

    fn check(rows: &[[f64; 3]], radius: f64) -> Result<()> {
        let points = Points::from_rows("points", rows)?;
        let (search, counts) = (BallSearch::new(&points, radius)?, BallSearch::for_counts(&points, radius)?);
        let mut ball = Ball::default();
        for query in 0..rows.len() {
            search.within(&points.get(query), &mut ball)?;
            let mut found: Vec<_> = ball.positions().iter().map(|&p| search.index(p) as usize).collect();
            found.sort_unstable();
            let expected: Vec<_> = (0..rows.len())
                .filter(|&i| (points.get(i) - points.get(query)).norm_squared() < radius * radius)
                .collect();
            assert_eq!(found, expected, "query {query}, radius {radius}");
            assert_eq!(counts.count(&points.get(query)), found.len());
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
    fn a_grid_for_a_larger_radius_finds_the_same() -> Result<()> {
        let mut rows = scattered(300, 1.0);
        rows.push([1e9, -1e9, 1e9]);
        check(&rows, 0.3)?;
        let points = Points::from_rows("points", &rows)?;
        let (fitting, wide) = (BallSearch::new(&points, 0.3)?, BallSearch::new(&points, 0.5)?);
        assert!(wide.serves(0.3) && !wide.serves(0.2) && !wide.serves(0.6));
        let wide = wide.narrowed(0.3);
        for query in 0..rows.len() {
            let sorted = |search: &BallSearch| -> Result<Vec<u32>> {
                let mut ball = Ball::default();
                search.within(&points.get(query), &mut ball)?;
                let mut found: Vec<_> = ball.positions().iter().map(|&p| search.index(p)).collect();
                found.sort_unstable();
                Ok(found)
            };
            assert_eq!(sorted(&fitting)?, sorted(&wide)?, "query {query}");
        }
        Ok(())
    }

    #[test]
    fn the_nearest_of_a_ball_by_distance_and_index() -> Result<()> {
        // Duplicated rows, so that distances tie.
        let rows = [scattered(150, 1.0), scattered(150, 1.0)].concat();
        let points = Points::from_rows("points", &rows)?;
        let all = BallSearch::new(&points, 0.5)?;
        for most in [0, 1, 2, 7, 20, 1000] {
            let (search, mut ball) = (all.of_nearest(most), Ball::default());
            for query in 0..rows.len() {
                search.within(&points.get(query), &mut ball)?;
                let mut found: Vec<_> = ball.positions().iter().map(|&p| search.index(p)).collect();
                assert!(ball.positions().is_sorted(), "the order of the grid is kept");
                found.sort_unstable();
                all.within(&points.get(query), &mut ball)?;
                let near = ball.squared_distances().iter().zip(ball.positions());
                let mut keys: Vec<_> = near.map(|(square, &p)| (square.to_bits(), all.index(p))).collect();
                keys.sort_unstable();
                let mut expected: Vec<_> = keys.iter().take(most).map(|key| key.1).collect();
                expected.sort_unstable();
                assert_eq!(found, expected, "query {query}, most {most}");
            }
        }
        Ok(())
    }

    #[test]
    fn the_nearest_is_that_of_the_ball() -> Result<()> {
        let points = Points::from_rows("points", &scattered(300, 1.0))?;
        let wide = BallSearch::new(&points, 0.8)?;
        let (mut ball, mut counts) = (Ball::default(), [0, 0]);
        for search in [wide.clone(), wide.narrowed(0.4), wide.narrowed(0.1)] {
            for place in scattered(500, 1.7) {
                let place = Point3::from([place[2], place[0], place[1]]);
                search.within(&place, &mut ball)?;
                let squares = ball.squared_distances().iter().enumerate();
                let expected = squares.min_by(|a, b| a.1.total_cmp(b.1)).map(|(i, _)| ball.vector(i));
                assert_eq!(search.nearest(&place).offset(), expected);
                counts[usize::from(expected.is_some())] += 1;
            }
        }
        assert!(counts.iter().all(|&count| count > 100), "{counts:?}");
        Ok(())
    }

    #[test]
    fn coincident_and_single_points() -> Result<()> {
        check(&[[1.0, 2.0, 3.0]; 20], 0.5)?;
        check(&[[1.0, 2.0, 3.0]], 0.5)?;
        check(&[], 0.5)
    }

    #[test]
    fn the_nearest_point_is_known_from_places_near_by() -> Result<()> {
        let points = Points::from_rows("points", &scattered(300, 1.0))?;
        let search = BallSearch::new(&points, 0.5)?;
        let (mut certain, mut uncertain) = (0, 0);
        for (i, shift) in scattered(600, 1.2).into_iter().enumerate() {
            let from = Point3::from(shift);
            let place = from + Vector3::from(shift).yzx() * (i % 30) as f64 * 0.01;
            let reach = 0.01 * (i % 50) as f64;
            let Some(seen) = search.nearest(&from).seen_from(&place, reach) else {
                uncertain += 1;
                continue;
            };
            let within = |offset: &Vector3<f64>| offset.norm() < reach;
            assert_eq!(seen.offset().filter(within), search.nearest(&place).offset().filter(within));
            certain += 1;
        }
        assert!(certain > 100 && uncertain > 100, "{certain}, {uncertain}");
        assert!(Nearest::default().seen_from(&Point3::origin(), 0.1).is_none());
        Ok(())
    }

    #[test]
    fn the_boundary_is_outside() -> Result<()> {
        let points = Points::from_rows("points", &[[0.0; 3], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])?;
        let search = BallSearch::new(&points, 1.0)?;
        let mut ball = Ball::default();
        search.within(&points.get(0), &mut ball)?;
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
