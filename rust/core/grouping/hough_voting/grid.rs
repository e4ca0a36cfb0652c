//! Hough grid: one vote per correspondence in regular bins over the votes' bounding box.

use nalgebra::{Point3, Vector3};

use super::{Vote, bounding_box, check_bins};
use crate::{Result, memory};

/// Votes with a spread below this share of the target's diagonal along an axis fall into one bin of it.
const NO_SPREAD: f64 = 1e-9;

/// A grid of at most this many bins has a counter for each.
const MOST_COUNTERS: u64 = 1 << 16;

/// Regular bins over the votes' bounding box.
pub(super) struct Grid {
    low: Point3<f64>,
    side: Vector3<f64>,
    bins: [i64; 3],
}

impl Grid {
    pub(super) fn over(
        votes: &[Vote],
        bins: usize,
        bin_size: Option<f64>,
        diagonal: f64,
    ) -> Result<Option<Self>> {
        let Some((low, range)) = bounding_box(votes) else {
            return Ok(None);
        };
        let mut grid = Self { low, side: Vector3::repeat(1.0), bins: [1; 3] };
        for axis in 0..3 {
            if range[axis] <= NO_SPREAD * diagonal {
                continue;
            }
            if let Some(side) = bin_size {
                check_bins(range[axis], side)?;
                grid.side[axis] = side;
                grid.bins[axis] = (range[axis] / side) as i64 + 1;
            } else {
                grid.side[axis] = range[axis] / bins as f64;
                grid.bins[axis] = bins as i64;
            }
        }
        Ok(Some(grid))
    }

    pub(super) fn clamped_bin(&self, vote: &Point3<f64>) -> [u32; 3] {
        // The cast rounds down: no vote lies below the lowest.
        let bin = |axis: usize| ((vote[axis] - self.low[axis]) / self.side[axis]) as u32;
        [0, 1, 2].map(|axis| bin(axis).min(self.bins[axis] as u32 - 1))
    }

    /// The fullest bin, the first in linear order of equal ones, and its number of votes.
    pub(super) fn fullest(&self, bins: &[[u32; 3]]) -> Result<Option<([u32; 3], usize)>> {
        // There are at most 2^63 bins, since there are at most 2^21 along an axis.
        let [nx, ny, nz] = self.bins.map(|count| count as u64);
        let indices = bins.iter().map(|bin| bin.map(u64::from)).map(|[x, y, z]| x + nx * (y + ny * z));
        let most = match nx * ny * nz {
            cells @ ..=MOST_COUNTERS => most_frequent_below(cells as usize, indices)?,
            _ => most_frequent(memory::collect(indices)?),
        };
        let bin = |index: u64| [index % nx, index / nx % ny, index / nx / ny].map(|bin| bin as u32);
        Ok(most.map(|(index, count)| (bin(index), count)))
    }
}

/// The most frequent number, the least of several, and its frequency; all numbers are below `end`.
fn most_frequent_below(end: usize, numbers: impl Iterator<Item = u64>) -> Result<Option<(u64, usize)>> {
    let mut counts = memory::filled(0_u32, end)?;
    numbers.for_each(|number| counts[number as usize] += 1);
    let most = counts.iter().copied().max().filter(|&most| most > 0);
    let first = counts.iter().position(|&count| Some(count) == most);
    Ok(first.zip(most).map(|(first, most)| (first as u64, most as usize)))
}

/// The most frequent number, the least of several, and its frequency.
fn most_frequent(mut numbers: Vec<u64>) -> Option<(u64, usize)> {
    numbers.sort_unstable();
    let runs = numbers.chunk_by(|a, b| a == b).map(|run| (run[0], run.len()));
    runs.reduce(|best, run| if run.1 > best.1 { run } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_of_the_most_frequent_wins() -> Result<()> {
        for numbers in [vec![], vec![3], vec![5, 2, 2, 5, 9], vec![9, 0, 9, 7, 7, 0, 0], vec![4, 4, 4]] {
            let counted = most_frequent_below(10, numbers.iter().copied())?;
            assert_eq!(most_frequent(numbers), counted);
        }
        assert_eq!(most_frequent(vec![5, 2, 2, 5, 9]), Some((2, 2)));
        Ok(())
    }
}
