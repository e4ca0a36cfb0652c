//! PCL's Hough space: weighted votes in cubic bins, interpolated between neighbouring bins.

use std::ops::Range;

use nalgebra::Vector3;

use super::{Vote, bounding_box, check_bins};
use crate::{Result, memory};

/// A bin by its x, y and z numbers; ordered with x fastest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Bin(i64);

impl Bin {
    const BITS: u32 = 21;

    fn new([x, y, z]: [i64; 3]) -> Self {
        Self(x | (y << Self::BITS) | (z << (2 * Self::BITS)))
    }

    fn coordinates(self) -> [i64; 3] {
        let part = |shift: u32| (self.0 >> shift) & ((1 << Self::BITS) - 1);
        [part(0), part(Self::BITS), part(2 * Self::BITS)]
    }
}

/// Weighted votes in cubic bins.
pub(super) struct HoughSpace {
    /// Bins with votes, in order.
    cells: Vec<Cell>,
    /// Voters, sorted by cell.
    voters: Vec<usize>,
}

struct Cell {
    bin: Bin,
    value: f64,
    /// Range of the cell's voters.
    voters: Range<usize>,
}

/// A vote, or its share in one bin; those of one bin are in the order of casting.
struct Ballot {
    bin: Bin,
    number: usize,
    voter: usize,
    weight: f64,
}

impl HoughSpace {
    pub(super) fn accumulate(
        votes: &[Vote],
        weights: &[f64],
        side: f64,
        interpolate: bool,
    ) -> Result<Option<Self>> {
        let Some((low, range)) = bounding_box(votes) else {
            return Ok(None);
        };
        let mut bins = [1; 3];
        for axis in 0..3 {
            check_bins(range[axis], side)?;
            // A vote on the upper border of an exact multiple is outside, as in PCL.
            bins[axis] = ((range[axis] / side).ceil() as i64).max(1);
        }
        let mut cast = Cast::default();
        for (i, vote) in votes {
            let position = (vote - low) / side;
            let home = [0, 1, 2].map(|axis| position[axis].floor() as i64);
            if !inside(home, bins) {
                continue;
            }
            if interpolate {
                cast.add_interpolated(*i, &position, weights[*i], bins)?;
            } else {
                cast.add(*i, home, weights[*i])?;
            }
        }
        cast.count().map(Some)
    }

    /// Voters of each bin that reaches the threshold and is not below any of its face neighbours.
    pub(super) fn maxima(&self, threshold: f64) -> Result<Vec<&[usize]>> {
        let greatest = self.cells.iter().map(|cell| cell.value).fold(0.0, f64::max);
        let least = if threshold < 0.0 { -threshold * greatest } else { threshold };
        let is_maximum = |cell: &&Cell| {
            cell.value >= least && self.face_neighbors(cell.bin).all(|other| other.value <= cell.value)
        };
        let maxima = self.cells.iter().filter(is_maximum);
        memory::collect(maxima.map(|cell| &self.voters[cell.voters.clone()]))
    }

    fn face_neighbors(&self, bin: Bin) -> impl Iterator<Item = &Cell> {
        let [x, y, z] = bin.coordinates();
        offsets()
            .filter(|(dz, dy, dx)| dx.abs() + dy.abs() + dz.abs() == 1)
            .map(move |(dz, dy, dx)| [x + dx, y + dy, z + dz])
            .filter(|bin| bin.iter().all(|&k| k >= 0))
            .filter_map(|bin| self.cell(Bin::new(bin)))
    }

    fn cell(&self, bin: Bin) -> Option<&Cell> {
        self.cells.binary_search_by_key(&bin, |cell| cell.bin).ok().map(|place| &self.cells[place])
    }
}

/// The votes in the order of casting.
#[derive(Default)]
struct Cast(Vec<Ballot>);

impl Cast {
    fn add(&mut self, voter: usize, bin: [i64; 3], weight: f64) -> Result<()> {
        if weight <= 0.0 {
            return Ok(());
        }
        let number = self.0.len();
        memory::push(&mut self.0, Ballot { bin: Bin::new(bin), number, voter, weight })
    }

    /// Interpolates a vote between the up to 8 bins whose centres surround it.
    fn add_interpolated(
        &mut self,
        voter: usize,
        position: &Vector3<f64>,
        weight: f64,
        bins: [i64; 3],
    ) -> Result<()> {
        let from_centers = position.map(|value| value - 0.5);
        let base = from_centers.map(f64::floor);
        let upper = from_centers - base;
        for corner in 0..8_u8 {
            let is_upper = [0, 1, 2].map(|axis| corner >> axis & 1 == 1);
            let share: f64 =
                (0..3).map(|axis| if is_upper[axis] { upper[axis] } else { 1.0 - upper[axis] }).product();
            let bin = [0, 1, 2].map(|axis| base[axis] as i64 + i64::from(is_upper[axis]));
            if inside(bin, bins) {
                self.add(voter, bin, share * weight)?;
            }
        }
        Ok(())
    }

    /// Sorts the votes into their bins.
    fn count(self) -> Result<HoughSpace> {
        let mut ballots = self.0;
        ballots.sort_unstable_by_key(|ballot| (ballot.bin, ballot.number));
        let voters = memory::collect(ballots.iter().map(|ballot| ballot.voter))?;
        let (mut cells, mut start) = (Vec::new(), 0);
        for here in ballots.chunk_by(|a, b| a.bin == b.bin) {
            let voters = start..start + here.len();
            start = voters.end;
            let value = here.iter().fold(0.0, |sum, ballot| sum + ballot.weight);
            memory::push(&mut cells, Cell { bin: here[0].bin, value, voters })?;
        }
        Ok(HoughSpace { cells, voters })
    }
}

fn inside(bin: [i64; 3], bins: [i64; 3]) -> bool {
    (0..3).all(|axis| (0..bins[axis]).contains(&bin[axis]))
}

/// Offsets to a bin and its 26 neighbours, z slowest.
fn offsets() -> impl Iterator<Item = (i64, i64, i64)> {
    (-1..=1).flat_map(|dz| (-1..=1).flat_map(move |dy| (-1..=1).map(move |dx| (dz, dy, dx))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_pack_and_unpack() {
        let bin = [5, 2_097_151, 77];
        assert_eq!(Bin::new(bin).coordinates(), bin);
    }
}
