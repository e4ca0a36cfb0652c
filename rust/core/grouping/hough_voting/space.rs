//! PCL's counting: weighted votes in cubic bins, spread over those around them.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::{Vote, bounding_box, check_bins};
use crate::Result;

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
    cells: BTreeMap<Bin, Cell>,
}

#[derive(Default)]
struct Cell {
    value: f64,
    voters: Vec<usize>,
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
            // A vote on the upper border of an exact multiple falls outside, as in PCL.
            bins[axis] = ((range[axis] / side).ceil() as i64).max(1);
        }
        let mut space = Self { cells: BTreeMap::new() };
        for (i, vote) in votes {
            let position = (vote - low) / side;
            let home = [0, 1, 2].map(|axis| position[axis].floor() as i64);
            if !inside(home, bins) {
                continue;
            }
            if interpolate {
                space.add_interpolated(*i, &position, weights[*i], bins);
            } else {
                space.add(*i, home, weights[*i]);
            }
        }
        Ok(Some(space))
    }

    fn add(&mut self, voter: usize, bin: [i64; 3], weight: f64) {
        if weight <= 0.0 {
            return;
        }
        let cell = self.cells.entry(Bin::new(bin)).or_default();
        cell.value += weight;
        cell.voters.push(voter);
    }

    /// Spreads a vote over the up to 8 bins whose centres surround it.
    fn add_interpolated(&mut self, voter: usize, position: &Vector3<f64>, weight: f64, bins: [i64; 3]) {
        let from_centers = position.map(|value| value - 0.5);
        let base = from_centers.map(f64::floor);
        let upper = from_centers - base;
        for corner in 0..8_u8 {
            let is_upper = [0, 1, 2].map(|axis| corner >> axis & 1 == 1);
            let share: f64 =
                (0..3).map(|axis| if is_upper[axis] { upper[axis] } else { 1.0 - upper[axis] }).product();
            let bin = [0, 1, 2].map(|axis| base[axis] as i64 + i64::from(is_upper[axis]));
            if inside(bin, bins) {
                self.add(voter, bin, share * weight);
            }
        }
    }

    /// Voters of each bin that reaches the threshold and is not below any of its face neighbours.
    pub(super) fn maxima(&self, threshold: f64) -> Vec<&[usize]> {
        let greatest = self.cells.values().map(|cell| cell.value).fold(0.0, f64::max);
        let least = if threshold < 0.0 { -threshold * greatest } else { threshold };
        let is_maximum = |(bin, cell): &(&Bin, &Cell)| {
            cell.value >= least && self.face_neighbors(**bin).all(|other| other.value <= cell.value)
        };
        self.cells.iter().filter(is_maximum).map(|(_, cell)| cell.voters.as_slice()).collect()
    }

    fn face_neighbors(&self, bin: Bin) -> impl Iterator<Item = &Cell> {
        let [x, y, z] = bin.coordinates();
        offsets()
            .filter(|(dz, dy, dx)| dx.abs() + dy.abs() + dz.abs() == 1)
            .map(move |(dz, dy, dx)| [x + dx, y + dy, z + dz])
            .filter(|bin| bin.iter().all(|&k| k >= 0))
            .filter_map(|bin| self.cells.get(&Bin::new(bin)))
    }
}

fn inside(bin: [i64; 3], bins: [i64; 3]) -> bool {
    (0..3).all(|axis| (0..bins[axis]).contains(&bin[axis]))
}

/// Steps to a bin and its 26 neighbours, z slowest.
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
