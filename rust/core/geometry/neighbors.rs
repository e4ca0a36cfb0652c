//! Exact nearest neighbours by a balanced k-d tree over a fixed set of points.
//!
//! Splits are by (coordinate, index) and not by coordinate alone, so coincident or axis-aligned points need
//! no special case. Neighbours are ordered by (distance, index), so ties have one result.

use std::collections::BinaryHeap;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;

/// Most points of a leaf.
const LEAF_SIZE: usize = 12;
/// Queries per task.
const QUERIES_PER_TASK: usize = 256;

/// A point found by a search; ordered by distance, then index.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Squared distance from the query.
    pub squared_distance: f64,
    /// Index of the point in the cloud.
    pub index: u32,
}

impl Eq for Neighbor {}

impl PartialOrd for Neighbor {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Neighbor {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        // Non-negative numbers and their bits have the same order; comparing bits is faster.
        let key = |neighbor: &Self| (neighbor.squared_distance.to_bits(), neighbor.index);
        key(self).cmp(&key(other))
    }
}

/// Finds the nearest points of any query. Built once, queried from many threads.
#[derive(Debug, Clone)]
pub struct NearestNeighbors {
    /// Coordinates in tree order: every node owns a contiguous range.
    points: Vec<[f64; 3]>,
    /// Index of each point in the cloud.
    order: Vec<u32>,
    /// Position of each point of the cloud in the tree order.
    position: Vec<u32>,
    /// Inner nodes, heap-like: children of `i` are `2i + 1` and `2i + 2`.
    nodes: Vec<Node>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Node {
    axis: usize,
    split: f64,
    /// Lowest index in the right part; decides a tie in distance without a visit.
    lowest_right: u32,
    /// Lowest index in the left part.
    lowest_left: u32,
}

/// State of one query: the best `count` so far, and the distance of the current box along each axis.
struct Query<'a> {
    center: [f64; 3],
    count: usize,
    own: u32,
    best: &'a mut BinaryHeap<Neighbor>,
}

impl NearestNeighbors {
    /// Builds the tree. Cost O(N log N), memory 40 bytes per point.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn new(cloud: &Points, execution: &Execution) -> Result<Self> {
        let mut entries = memory::collect(cloud.rows().zip(0_u32..))?;
        let mut nodes = Vec::new();
        build(&mut entries, 0, &mut nodes, execution)?;
        let mut position = memory::filled(0, entries.len())?;
        for (place, &(_, index)) in entries.iter().enumerate() {
            position[index as usize] = place as u32;
        }
        let points = memory::collect(entries.iter().map(|entry| entry.0))?;
        let order = memory::collect(entries.iter().map(|entry| entry.1))?;
        Ok(Self { points, order, position, nodes })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Calls `f(index, neighbours)` with the `count` nearest other points of every point of the cloud, on all
    /// threads; returns one result per point, in the order of the cloud. Neighbours are ordered by (distance,
    /// index); there are fewer if the cloud has fewer.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`] if the caller requested a stop; [`crate::Error::OutOfMemory`].
    pub fn map_points<T, F>(&self, count: usize, execution: &Execution, f: F) -> Result<Vec<T>>
    where
        T: Copy + Default + Send,
        F: Fn(usize, &[Neighbor]) -> T + Sync,
    {
        // In the order of the tree, so that the queries of a task share the cache.
        let mut sorted = memory::filled(T::default(), self.len())?;
        let tasks = sorted.par_chunks_mut(QUERIES_PER_TASK).zip(self.order.par_chunks(QUERIES_PER_TASK));
        tasks.try_for_each_init(Vec::new, |found, (results, queries)| {
            execution.check()?;
            for (result, &query) in results.iter_mut().zip(queries) {
                self.search(query, count, found)?;
                *result = f(query as usize, found);
            }
            Ok(())
        })?;
        memory::collect(self.position.iter().map(|&position| sorted[position as usize]))
    }

    /// Concatenated indices of the `count` nearest other points of some points of the cloud; all others per
    /// point if there are fewer.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] for a row out of range; [`crate::Error::Interrupted`],
    /// [`crate::Error::OutOfMemory`].
    pub fn of_rows(&self, rows: &[usize], count: usize, execution: &Execution) -> Result<Vec<u32>> {
        if let Some(row) = rows.iter().find(|&&row| row >= self.len()) {
            return Err(Error::invalid("rows", row, format!("the cloud has {} points", self.len())));
        }
        let count = count.min(self.len().saturating_sub(1));
        let mut nearest = memory::filled(0, count * rows.len())?;
        let tasks = nearest.par_chunks_mut(count.max(1)).zip(rows).with_min_len(QUERIES_PER_TASK / 16);
        tasks.try_for_each_init(Vec::new, |found, (indices, &row)| {
            execution.check()?;
            self.search(row as u32, count, found)?;
            indices.iter_mut().zip(found).for_each(|(index, neighbor)| *index = neighbor.index);
            Ok(())
        })?;
        Ok(nearest)
    }

    /// The nearest points of point `own`, without the point itself.
    fn search(&self, own: u32, count: usize, found: &mut Vec<Neighbor>) -> Result<()> {
        found.clear();
        if count == 0 {
            return Ok(());
        }
        memory::reserve(found, count.min(self.len()))?;
        let center = self.points[self.position[own as usize] as usize];
        let mut best = BinaryHeap::from(std::mem::take(found));
        let mut query = Query { center, count, own, best: &mut best };
        self.visit(0, 0, self.len(), [0.0; 3], &mut query);
        *found = best.into_sorted_vec();
        Ok(())
    }

    fn visit(&self, node: usize, start: usize, end: usize, offset: [f64; 3], query: &mut Query) {
        if end - start <= LEAF_SIZE {
            return self.scan(start, end, query);
        }
        let Node { axis, split, lowest_left, lowest_right } = self.nodes[node];
        let middle = usize::midpoint(start, end);
        let delta = query.center[axis] - split;
        let mut beyond = offset;
        beyond[axis] = delta;
        let left = (2 * node + 1, start, middle, lowest_left);
        let right = (2 * node + 2, middle, end, lowest_right);
        let (near, far) = if delta <= 0.0 { (left, right) } else { (right, left) };
        self.visit(near.0, near.1, near.2, offset, query);
        if query.may_hold(squared_norm(beyond), far.3) {
            self.visit(far.0, far.1, far.2, beyond, query);
        }
    }

    fn scan(&self, start: usize, end: usize, query: &mut Query) {
        for (point, &index) in self.points[start..end].iter().zip(&self.order[start..end]) {
            if query.own == index {
                continue;
            }
            let delta = std::array::from_fn(|k| query.center[k] - point[k]);
            query.offer(Neighbor { squared_distance: squared_norm(delta), index });
        }
    }
}

impl Query<'_> {
    /// Whether a box at this distance, with no index below `lowest`, may improve the result.
    fn may_hold(&self, squared_distance: f64, lowest: u32) -> bool {
        self.best.len() < self.count || self.best.peek() > Some(&Neighbor { squared_distance, index: lowest })
    }

    fn offer(&mut self, candidate: Neighbor) {
        if self.best.len() < self.count {
            self.best.push(candidate);
        } else if let Some(mut worst) = self.best.peek_mut()
            && candidate < *worst
        {
            *worst = candidate;
        }
    }
}

/// The same sum for boxes and points: rounding then cannot place a point nearer than its box.
#[inline]
fn squared_norm(v: [f64; 3]) -> f64 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

fn build(
    entries: &mut [([f64; 3], u32)],
    node: usize,
    nodes: &mut Vec<Node>,
    execution: &Execution,
) -> Result<()> {
    if entries.len() <= LEAF_SIZE {
        return Ok(());
    }
    execution.check()?;
    let axis = widest_axis(entries);
    let middle = entries.len() / 2;
    entries.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    let lowest = |part: &[([f64; 3], u32)]| part.iter().map(|entry| entry.1).min().unwrap_or(0);
    let (left, right) = entries.split_at_mut(middle);
    if nodes.len() <= node {
        memory::resize(nodes, node + 1, Node::default())?;
    }
    nodes[node] =
        Node { axis, split: right[0].0[axis], lowest_right: lowest(right), lowest_left: lowest(left) };
    build(left, 2 * node + 1, nodes, execution)?;
    build(right, 2 * node + 2, nodes, execution)
}

/// Axis with the largest extent of the points.
pub(super) fn widest_axis(entries: &[([f64; 3], u32)]) -> usize {
    let extent = |k: usize| {
        let values = entries.iter().map(|entry| entry.0[k]);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        high - low
    };
    let extents = [extent(0), extent(1), extent(2)];
    (1..3).fold(0, |widest, k| if extents[k] > extents[widest] { k } else { widest })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn brute_force(points: &Points, query: usize, count: usize) -> Vec<Neighbor> {
        let mut all: Vec<_> = (0..points.len())
            .filter(|&i| i != query)
            .map(|i| {
                let d = points.get(query) - points.get(i);
                Neighbor { squared_distance: d.x * d.x + d.y * d.y + d.z * d.z, index: i as u32 }
            })
            .collect();
        all.sort();
        all.truncate(count);
        all
    }

    fn check(rows: &[[f64; 3]], counts: &[usize]) -> Result<()> {
        let points = Points::from_rows("points", rows)?;
        let neighbors = NearestNeighbors::new(&points, &Execution::default())?;
        for &count in counts {
            let agrees = |query: usize, found: &[Neighbor]| found == brute_force(&points, query, count);
            let agreed = neighbors.map_points(count, &Execution::default(), agrees)?;
            assert_eq!(agreed, vec![true; rows.len()], "count {count}");
        }
        Ok(())
    }

    fn scattered(count: u32) -> Vec<[f64; 3]> {
        (0..count).map(|i| [1.1, 2.3, 3.7].map(|f| (f64::from(i) * f).sin())).collect()
    }

    #[test]
    fn agrees_with_brute_force_on_a_lattice_full_of_ties() -> Result<()> {
        let rows: Vec<[f64; 3]> =
            (0..1000).map(|i| [f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100)]).collect();
        check(&rows, &[1, 6, 7, 20, 2000])?;
        // Steps of a tenth, a third and a seventh are rounded: ties are not exact.
        let rounded: Vec<[f64; 3]> = rows.iter().map(|&[x, y, z]| [x / 10.0, y / 3.0, z / 7.0]).collect();
        check(&rounded, &[1, 2, 6, 7, 20])
    }

    #[test]
    fn agrees_with_brute_force_on_scattered_points() -> Result<()> {
        check(&scattered(500), &[0, 1, 30])
    }

    #[test]
    fn agrees_with_brute_force_on_planes_lines_and_duplicates() -> Result<()> {
        let plane: Vec<[f64; 3]> = (0..600).map(|i| [f64::from(i % 30), f64::from(i / 30), 0.0]).collect();
        let line: Vec<[f64; 3]> = (0..300).map(|i| [0.0, f64::from(i * i % 301), 0.0]).collect();
        let mut doubled = scattered(200);
        doubled.extend(scattered(90));
        doubled.extend([[0.0, -0.0, 0.0], [-0.0, 0.0, 0.0], [0.0; 3]]);
        for rows in [plane, line, doubled] {
            check(&rows, &[1, 3, 8, 40])?;
        }
        Ok(())
    }

    #[test]
    fn coincident_points_are_ordered_by_index() -> Result<()> {
        check(&[[1.0, 2.0, 3.0]; 300], &[1, 5, 299])?;
        let points = Points::from_rows("points", &vec![[1.0, 2.0, 3.0]; 20_000])?;
        let lowest = |_, found: &[Neighbor]| found.len() == 3 && found[2].index <= 3;
        let all = NearestNeighbors::new(&points, &Execution::default())?.map_points(
            3,
            &Execution::default(),
            lowest,
        )?;
        assert!(all.into_iter().all(|is_lowest| is_lowest));
        Ok(())
    }

    #[test]
    fn selected_points_have_the_same_neighbours_as_among_all() -> Result<()> {
        let (points, execution) = (Points::from_rows("points", &scattered(300))?, Execution::default());
        let neighbors = NearestNeighbors::new(&points, &execution)?;
        let rows = [7, 299, 7, 0];
        let expected = rows.map(|row| brute_force(&points, row, 5));
        let indices: Vec<u32> = expected.concat().iter().map(|neighbor| neighbor.index).collect();
        assert_eq!(neighbors.of_rows(&rows, 5, &execution)?, indices);
        assert_eq!(neighbors.of_rows(&rows, 900, &execution)?.len(), 4 * 299);
        assert!(neighbors.of_rows(&rows, 0, &execution)?.is_empty());
        assert!(neighbors.of_rows(&[300], 5, &execution).is_err());
        Ok(())
    }

    #[test]
    fn few_points_have_few_neighbours() -> Result<()> {
        check(&[], &[3])?;
        check(&[[1.0, 2.0, 3.0]], &[3])?;
        check(&[[1.0, 2.0, 3.0], [4.0, 0.0, 0.0]], &[0, 1, 3])
    }
}
