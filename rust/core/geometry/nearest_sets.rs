//! The set of the `count` nearest points of every point of a cloud, unordered: for counts in the hundreds.
//!
//! Points are partitioned into blocks of neighbours, as by a k-d tree. For the queries of one block, the
//! blocks within reach are listed once. Every query then measures whole blocks of that list, with vector
//! instructions, and finds a limit that exactly `count` distances lie below. The reach is predicted from the
//! previous query; if the prediction is too low, a certain bound replaces it.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use std::ops::Range;

use rayon::prelude::*;

use super::neighbors::{Neighbor, widest_axis};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;
use crate::simd::{self, Kernel, Lanes};

/// Points of a block; all blocks but the last are full.
const BLOCK: usize = 16;
/// Blocks per region: near blocks are looked up by region, and a region is a task.
const REGION: usize = 16;
/// Factor on the previous (neighbouring) query's greatest squared distance for the first attempt. On a
/// surface the number of points grows with the squared distance, so 5/4 suffices for densities down to 4/5.
/// It affects the cost, never the result.
const SLACK: f64 = 1.25;
/// Trial limits before ties are examined.
const TRIALS: usize = 10;
/// Index of an unused place.
const NO_POINT: u32 = u32::MAX;

/// Finds the sets of nearest points for the points of a cloud.
#[derive(Debug, Clone)]
pub struct NearestSets {
    len: usize,
    blocks: Vec<Block>,
    boxes: Boxes,
    regions: Boxes,
}

/// Neighbouring points; unused places are infinitely far.
#[derive(Debug, Clone)]
struct Block {
    coordinates: [[f64; BLOCK]; 3],
    indices: [u32; BLOCK],
}

/// An axis-aligned box.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    low: [f64; 3],
    high: [f64; 3],
}

/// Boxes as a struct of arrays.
#[derive(Debug, Clone, Default)]
struct Boxes {
    low: [Vec<f64>; 3],
    high: [Vec<f64>; 3],
}

/// Two limits: fewer than the requested number of points lie below the first, more below the second.
#[derive(Debug, Clone, Copy)]
struct Bracket {
    low: f64,
    below_low: usize,
    high: f64,
    below_high: usize,
}

/// Buffers of one thread.
#[derive(Debug, Default)]
struct Workspace {
    gaps: Vec<f64>,
    region_gaps: Vec<f64>,
    /// Blocks within `reach` (squared) of the queries' block, and their boxes.
    reach: f64,
    listed: Vec<u32>,
    listed_boxes: Boxes,
    /// Blocks within reach of one query, and the squared distances of their points.
    measured: Vec<u32>,
    squared_distances: Vec<[f64; BLOCK]>,
    ties: Vec<Neighbor>,
    members: Vec<u32>,
}

impl NearestSets {
    /// Partitions the points into blocks. Cost O(N log N), memory about 40 bytes per point.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn new(cloud: &Points, execution: &Execution) -> Result<Self> {
        let mut entries = memory::collect(cloud.rows().zip(0_u32..))?;
        arrange(&mut entries, execution)?;
        let bounds = memory::collect(entries.chunks(BLOCK).map(Bounds::of_points))?;
        let regions = bounds.chunks(REGION).map(|boxes| Bounds::of_boxes(boxes.iter().copied()));
        let blocks = memory::collect(entries.chunks(BLOCK).map(Block::new))?;
        let (boxes, regions) = (Boxes::new(bounds.iter().copied())?, Boxes::new(regions)?);
        Ok(Self { len: cloud.len(), blocks, boxes, regions })
    }

    /// Calls `f(index, members)` for every point of the cloud, on all threads; returns one result per point,
    /// in the order of the cloud. `members`, unordered, are the `count` nearest other points, without those
    /// for which `keep` is false; ties in distance go to the lowest index.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`] if the caller requested a stop; [`crate::Error::OutOfMemory`].
    pub fn map<T, F>(&self, count: usize, keep: &[bool], execution: &Execution, f: F) -> Result<Vec<T>>
    where
        T: Copy + Default + Send,
        F: Fn(usize, &[u32]) -> T + Sync,
    {
        let count = count.min(self.len.saturating_sub(1));
        let keep = memory::collect(self.blocks.iter().map(|block| block.bits(keep)))?;
        let mut sorted = memory::filled([T::default(); BLOCK], self.blocks.len())?;
        let tasks = sorted.par_chunks_mut(REGION).enumerate();
        tasks.try_for_each_init(Workspace::default, |workspace, (task, results)| {
            let mut last = None;
            for (block, results) in (task * REGION..).zip(results) {
                let own = &self.blocks[block];
                workspace.list(self, block, self.likely_reach(block, count, last))?;
                for (lane, result) in results.iter_mut().enumerate().take(self.len - block * BLOCK) {
                    execution.check()?;
                    let search = Search { sets: self, workspace, block, lane, count, last, keep: &keep };
                    last = Some(simd::run(search)?);
                    *result = f(own.indices[lane] as usize, &workspace.members);
                }
            }
            Ok(())
        })?;
        let mut results = memory::filled(T::default(), self.len)?;
        for (block, sorted) in self.blocks.iter().zip(&sorted) {
            for (&index, &result) in block.indices.iter().zip(sorted).filter(|(index, _)| **index != NO_POINT)
            {
                results[index as usize] = result;
            }
        }
        Ok(results)
    }

    /// Squared distance within which every point of the block most likely has `count` others, from the
    /// squared distance of the previous query.
    fn likely_reach(&self, block: usize, count: usize, last: Option<f64>) -> f64 {
        let Some(last) = last else {
            return self.certain_reach(block, count);
        };
        let own = self.boxes.get(block);
        let diagonal = squared_norm([0, 1, 2].map(|k| own.high[k] - own.low[k])).sqrt();
        let reach = last.sqrt() + diagonal;
        reach * reach
    }

    /// Squared distance within which every point of the block has `count` others.
    fn certain_reach(&self, block: usize, count: usize) -> f64 {
        let needed = count / BLOCK + 2; // one for the point itself, one for a last block that is not full
        let first = block.saturating_sub(needed / 2).min(self.blocks.len().saturating_sub(needed));
        let around = first..(first + needed).min(self.blocks.len());
        let around = Bounds::of_boxes(around.map(|other| self.boxes.get(other)));
        let own = self.boxes.get(block);
        squared_norm([0, 1, 2].map(|k| (around.high[k] - own.low[k]).max(own.high[k] - around.low[k])))
    }
}

impl Workspace {
    /// Lists the blocks within `reach` of a block.
    fn list(&mut self, sets: &NearestSets, block: usize, reach: f64) -> Result<()> {
        let own = sets.boxes.get(block);
        self.reach = reach;
        self.listed.clear();
        self.listed_boxes.clear();
        sets.regions.gaps(0, sets.regions.len(), &own, &mut self.region_gaps)?;
        let near = self.region_gaps.iter().enumerate().filter(|&(_, &gap)| gap <= reach);
        for (region, _) in near {
            let first = region * REGION;
            let end = (first + REGION).min(sets.blocks.len());
            sets.boxes.gaps(first, end, &own, &mut self.gaps)?;
            for (other, &gap) in (first..end).zip(&self.gaps) {
                if gap <= reach {
                    memory::push(&mut self.listed, other as u32)?;
                    self.listed_boxes.push(&sets.boxes.get(other))?;
                }
            }
        }
        Ok(())
    }

    /// Measures all blocks within `reach` of the point in a lane of a block: squared distances to their
    /// points, and the number within reach. The point itself counts as infinitely far.
    #[inline(always)]
    fn measure(&mut self, sets: &NearestSets, (block, lane): (usize, usize), reach: f64) -> Result<usize> {
        let center = sets.blocks[block].coordinates.map(
            #[inline(always)]
            |axis| axis[lane],
        );
        self.listed_boxes.gaps(
            0,
            self.listed.len(),
            &Bounds { low: center, high: center },
            &mut self.gaps,
        )?;
        memory::resize(&mut self.measured, self.listed.len(), 0)?;
        let mut near = 0;
        for (&other, &gap) in self.listed.iter().zip(&self.gaps) {
            self.measured[near] = other;
            near += usize::from(gap <= reach);
        }
        self.measured.truncate(near);
        memory::resize(&mut self.squared_distances, near, [0.0; BLOCK])?;
        for (&other, squares) in self.measured.iter().zip(&mut self.squared_distances) {
            *squares = sets.blocks[other as usize].squared_distances(center);
            if other as usize == block {
                squares[lane] = f64::INFINITY;
            }
        }
        Ok(self.count_below(reach.next_up()))
    }

    #[inline(always)]
    fn count_below(&self, limit: f64) -> usize {
        let squares = self.squared_distances.as_flattened().iter();
        squares.map(|&square| u64::from(square < limit)).sum::<u64>() as usize
    }

    /// Finds a limit with `count` points below it.
    #[inline(always)]
    fn limit(
        &mut self,
        sets: &NearestSets,
        count: usize,
        guess: Option<f64>,
        mut bracket: Bracket,
    ) -> Result<f64> {
        if bracket.below_high == count {
            return Ok(bracket.high);
        }
        let mut trial = guess.filter(|&guess| bracket.contains(guess)).unwrap_or(bracket.interpolate(count));
        for _ in 0..TRIALS {
            if !bracket.contains(trial) {
                break; // no number lies between the two
            }
            let found = self.count_below(trial);
            if found == count {
                return Ok(trial);
            }
            if found < count {
                (bracket.low, bracket.below_low) = (trial, found);
            } else {
                (bracket.high, bracket.below_high) = (trial, found);
            }
            trial = bracket.interpolate(count);
        }
        self.settle(sets, count - bracket.below_low, bracket.low..bracket.high)
    }

    /// The limit that holds the first `count` of the points whose squared distance is in a range, by
    /// (distance, index). Moves all points after the last to infinity, ties with it included.
    #[cold]
    fn settle(&mut self, sets: &NearestSets, count: usize, range: Range<f64>) -> Result<f64> {
        self.ties.clear();
        for (&block, squares) in self.measured.iter().zip(&self.squared_distances) {
            let points = squares.iter().zip(&sets.blocks[block as usize].indices);
            let between = points.filter(|&(square, _)| range.contains(square));
            memory::reserve(&mut self.ties, BLOCK)?;
            self.ties.extend(between.map(|(&squared_distance, &index)| Neighbor { squared_distance, index }));
        }
        let (_, &mut last, _) = self.ties.select_nth_unstable(count - 1);
        for (&block, squares) in self.measured.iter().zip(&mut self.squared_distances) {
            for (square, &index) in squares.iter_mut().zip(&sets.blocks[block as usize].indices) {
                if (Neighbor { squared_distance: *square, index }) > last {
                    *square = f64::INFINITY;
                }
            }
        }
        Ok(last.squared_distance.next_up())
    }

    /// Writes the points below the limit that `keep` selects.
    #[inline(always)]
    fn gather(&mut self, sets: &NearestSets, limit: f64, keep: &[u32]) -> Result<()> {
        memory::resize(&mut self.members, self.measured.len() * BLOCK, 0)?;
        let all = self.members.as_mut_slice();
        let mut found = 0;
        for (&block, squares) in self.measured.iter().zip(&self.squared_distances) {
            let indices = &sets.blocks[block as usize].indices;
            let mut members = bits_below(squares, limit) & keep[block as usize];
            while members != 0 {
                all[found] = indices[members.trailing_zeros() as usize];
                found += 1;
                members &= members - 1;
            }
        }
        self.members.truncate(found);
        Ok(())
    }
}

/// The search for the members of one point's set.
struct Search<'a> {
    sets: &'a NearestSets,
    workspace: &'a mut Workspace,
    block: usize,
    lane: usize,
    count: usize,
    /// Squared distance of the previous query.
    last: Option<f64>,
    keep: &'a [u32],
}

impl Kernel for Search<'_> {
    type Output = Result<f64>;

    /// Writes the members to the workspace; returns the squared distance needed.
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) -> Result<f64> {
        let Self { sets, workspace, block, lane, count, last, keep } = self;
        workspace.members.clear();
        if count == 0 {
            return Ok(0.0);
        }
        let mut reach = last.map_or(workspace.reach, |last| workspace.reach.min(last * SLACK));
        let mut found = workspace.measure(sets, (block, lane), reach)?;
        if found < count && reach < workspace.reach {
            reach = workspace.reach;
            found = workspace.measure(sets, (block, lane), reach)?;
        }
        if found < count {
            workspace.list(sets, block, sets.certain_reach(block, count))?;
            reach = workspace.reach;
            found = workspace.measure(sets, (block, lane), reach)?;
        }
        let bracket = Bracket { low: 0.0, below_low: 0, high: reach.next_up(), below_high: found };
        let limit = workspace.limit(sets, count.min(found), last, bracket)?;
        workspace.gather(sets, limit, keep)?;
        Ok(limit)
    }
}

impl Bracket {
    #[inline(always)]
    fn contains(&self, trial: f64) -> bool {
        self.low < trial && trial < self.high
    }

    /// The limit below which `count` points would lie if their squared distances were uniformly distributed.
    #[inline(always)]
    fn interpolate(&self, count: usize) -> f64 {
        let (wanted, all) = (count - self.below_low, self.below_high - self.below_low);
        self.low + (wanted as f64 + 0.5) / (all as f64 + 1.0) * (self.high - self.low)
    }
}

/// Bit mask of the values below the limit.
#[inline(always)]
fn bits_below(values: &[f64; BLOCK], limit: f64) -> u32 {
    let mut bits = [0_u64; BLOCK];
    for l in 0..BLOCK {
        bits[l] = u64::from(values[l] < limit) << l;
    }
    bits.iter().fold(0, |all, bit| all | bit) as u32
}

impl Block {
    fn new(entries: &[([f64; 3], u32)]) -> Self {
        let mut block = Self { coordinates: [[f64::INFINITY; BLOCK]; 3], indices: [NO_POINT; BLOCK] };
        for (lane, (point, index)) in entries.iter().enumerate() {
            for (axis, &coordinate) in block.coordinates.iter_mut().zip(point) {
                axis[lane] = coordinate;
            }
            block.indices[lane] = *index;
        }
        block
    }

    #[inline(always)]
    fn squared_distances(&self, center: [f64; 3]) -> [f64; BLOCK] {
        let [x, y, z] = &self.coordinates;
        let mut squares = [0.0; BLOCK];
        for l in 0..BLOCK {
            squares[l] = squared_norm([center[0] - x[l], center[1] - y[l], center[2] - z[l]]);
        }
        squares
    }

    /// Bit mask of the points for which `values` is true.
    fn bits(&self, values: &[bool]) -> u32 {
        let holds = |index: u32| index != NO_POINT && values[index as usize];
        (0..BLOCK).fold(0, |bits, l| bits | u32::from(holds(self.indices[l])) << l)
    }
}

impl Bounds {
    fn of_points(entries: &[([f64; 3], u32)]) -> Self {
        Self::of_boxes(entries.iter().map(|&(point, _)| Self { low: point, high: point }))
    }

    fn of_boxes(boxes: impl Iterator<Item = Self>) -> Self {
        let nothing = Self { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };
        boxes.fold(nothing, |all, part| Self {
            low: [0, 1, 2].map(|k| all.low[k].min(part.low[k])),
            high: [0, 1, 2].map(|k| all.high[k].max(part.high[k])),
        })
    }
}

impl Boxes {
    fn new(boxes: impl Iterator<Item = Bounds>) -> Result<Self> {
        let mut result = Self::default();
        for bounds in boxes {
            result.push(&bounds)?;
        }
        Ok(result)
    }

    fn len(&self) -> usize {
        self.low[0].len()
    }

    fn get(&self, i: usize) -> Bounds {
        Bounds { low: [0, 1, 2].map(|k| self.low[k][i]), high: [0, 1, 2].map(|k| self.high[k][i]) }
    }

    fn clear(&mut self) {
        self.low.iter_mut().chain(&mut self.high).for_each(Vec::clear);
    }

    fn push(&mut self, bounds: &Bounds) -> Result<()> {
        for k in 0..3 {
            memory::push(&mut self.low[k], bounds.low[k])?;
            memory::push(&mut self.high[k], bounds.high[k])?;
        }
        Ok(())
    }

    /// Squared distances of the boxes `first..end` from `place`. They are rounded like those of points, so
    /// none exceeds the distance of any two points in the boxes.
    #[inline(always)]
    fn gaps(&self, first: usize, end: usize, place: &Bounds, gaps: &mut Vec<f64>) -> Result<()> {
        memory::resize(gaps, end - first, 0.0)?;
        let [low_x, low_y, low_z] = [0, 1, 2].map(
            #[inline(always)]
            |k| &self.low[k][first..end],
        );
        let [high_x, high_y, high_z] = [0, 1, 2].map(
            #[inline(always)]
            |k| &self.high[k][first..end],
        );
        for (i, gap) in gaps[..end - first].iter_mut().enumerate() {
            *gap = squared_norm([
                greater(greater(low_x[i] - place.high[0], place.low[0] - high_x[i]), 0.0),
                greater(greater(low_y[i] - place.high[1], place.low[1] - high_y[i]), 0.0),
                greater(greater(low_z[i] - place.high[2], place.low[2] - high_z[i]), 0.0),
            ]);
        }
        Ok(())
    }
}

/// As `f64::max`, without handling NaN.
#[inline(always)]
fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[inline(always)]
fn squared_norm(v: [f64; 3]) -> f64 {
    v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
}

/// Sorts neighbouring points into the same blocks, and neighbouring blocks into the same regions.
fn arrange(entries: &mut [([f64; 3], u32)], execution: &Execution) -> Result<()> {
    if entries.len() <= BLOCK {
        return Ok(());
    }
    execution.check()?;
    let unit = if entries.len() > BLOCK * REGION { BLOCK * REGION } else { BLOCK };
    let middle = (entries.len() / 2).next_multiple_of(unit).min((entries.len() - 1) / unit * unit);
    let axis = widest_axis(entries);
    entries.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    let (left, right) = entries.split_at_mut(middle);
    let (left, right) = rayon::join(|| arrange(left, execution), || arrange(right, execution));
    left.and(right)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn brute_force(points: &Points, query: usize, count: usize, keep: &[bool]) -> Vec<u32> {
        let mut all: Vec<_> = (0..points.len())
            .filter(|&i| i != query)
            .map(|i| {
                let d = points.get(query) - points.get(i);
                Neighbor { squared_distance: squared_norm(d.into()), index: i as u32 }
            })
            .collect();
        all.sort_unstable();
        let nearest = all.iter().take(count).map(|neighbor| neighbor.index);
        let mut members: Vec<u32> = nearest.filter(|&index| keep[index as usize]).collect();
        members.sort_unstable();
        members
    }

    fn check(rows: &[[f64; 3]], counts: &[usize]) -> Result<()> {
        let points = Points::from_rows("points", rows)?;
        let sets = NearestSets::new(&points, &Execution::default())?;
        for &count in counts {
            for keep in [vec![true; rows.len()], (0..rows.len()).map(|i| i % 5 == 2).collect()] {
                let agrees = sets.map(count, &keep, &Execution::default(), |query, members| {
                    let mut members = members.to_vec();
                    members.sort_unstable();
                    members == brute_force(&points, query, count, &keep)
                })?;
                assert_eq!(agrees, vec![true; rows.len()], "{count} of {}", rows.len());
            }
        }
        Ok(())
    }

    fn scattered(n: u32) -> Vec<[f64; 3]> {
        (0..n).map(|i| [1.1, 2.3, 3.7].map(|f| (f64::from(i) * f).sin())).collect()
    }

    #[test]
    fn agrees_for_any_number_of_points() -> Result<()> {
        for n in [0, 1, 2, 15, 16, 17, 33, 255, 256, 257, 513, 700] {
            check(&scattered(n), &[0, 1, 5, 30, 255, 256, 900])?;
        }
        Ok(())
    }

    #[test]
    fn a_lattice_full_of_ties() -> Result<()> {
        let lattice = |i: u32| [f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100)];
        check(&(0..700).map(lattice).collect::<Vec<_>>(), &[1, 6, 7, 20, 250, 698, 699])
    }

    #[test]
    fn coincident_and_collinear_points() -> Result<()> {
        check(&[[1.0, 2.0, 3.0]; 300], &[1, 5, 250, 299])?;
        check(&(0..400).map(|i| [f64::from(i / 8 % 25), 1.0, 0.0]).collect::<Vec<_>>(), &[3, 40, 250])?;
        check(&(0..400).map(|i| [f64::from(i * 7 % 400); 3]).collect::<Vec<_>>(), &[1, 2, 39, 250])
    }

    #[test]
    fn density_that_changes_abruptly() -> Result<()> {
        let mut rows = scattered(300);
        rows.extend(scattered(300).iter().map(|row| row.map(|x| x * 1e-6 + 3.0)));
        rows.extend(scattered(40).iter().map(|row| row.map(|x| x * 1e9)));
        check(&rows, &[1, 20, 250, 330])
    }

    #[test]
    fn distances_with_underflowing_squares() -> Result<()> {
        let tiny = (1..150).flat_map(|i| [1e-170 * f64::from(i), -1e-170 * f64::from(i)]);
        let rows: Vec<[f64; 3]> = [1.0, -1.0].into_iter().chain(tiny).map(|x| [x, 0.0, 0.0]).collect();
        check(&rows, &[1, 30, 250])
    }

    #[test]
    fn an_interrupted_search_is_an_error() -> Result<()> {
        let sets = NearestSets::new(&Points::from_rows("points", &scattered(50))?, &Execution::default())?;
        let execution = Execution::default();
        execution.interrupt();
        assert_eq!(sets.map(3, &[true; 50], &execution, |_, _| ()), Err(crate::Error::Interrupted));
        Ok(())
    }
}
