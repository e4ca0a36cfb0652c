//! 3DHV: each correspondence votes for where the source's centroid lies in the target; the peak wins.
//!
//! The paper, section 3.2 (after Tombari, Di Stefano, PSIVT 2010). A local reference frame at each
//! end makes a vote independent of the unknown motion. Cost O(n log n).

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::GroupingMethod;
use crate::error::{Error, at_least_one, positive};
use crate::grouping_result::mask_of;
use crate::selection::sample_consensus::SampleConsensus;
use crate::{Correspondences, Execution, Grouping, Result};

/// Votes that spread less than this share of the target's diagonal along an axis fill one bin of it.
const NO_SPREAD: f64 = 1e-9;

/// Bins per axis beyond this can't be told apart in the grid's index.
const MAX_BINS: f64 = 2_097_151.0;

/// A grid of no more bins has a counter for each.
const MOST_COUNTERS: u64 = 1 << 16;

/// So many votes of the grid variant are counted within a millisecond.
const MOST_INSTANT_VOTES: usize = 20_000;

/// How votes are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Variant {
    /// One vote each; the fullest bin and its neighbours are selected. The paper's.
    #[default]
    Grid,
    /// Cubic bins with interpolated votes; each local maximum is filtered by RANSAC, the largest wins. PCL's.
    Pcl,
}

/// Bins around the peak whose voters are selected too.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Neighborhood {
    /// The peak alone.
    None,
    /// The 6 bins that share a face with it.
    #[default]
    Faces,
    /// All 26 around it.
    All,
}

impl Neighborhood {
    /// Whether the bin that lies so many bins away belongs to it.
    fn reaches(self, [x, y, z]: [u32; 3]) -> bool {
        match self {
            Self::None => x + y + z == 0,
            Self::Faces => x + y + z <= 1,
            Self::All => x.max(y).max(z) <= 1,
        }
    }
}

/// Parameters of 3D Hough voting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoughVoting {
    /// How votes are counted.
    pub variant: Variant,
    /// Bins per axis over the votes' bounding box.
    pub bins: usize,
    /// Side of cubic bins, a length, in place of `bins`.
    pub bin_size: Option<f64>,
    /// Grid variant: bins selected around the peak.
    pub neighbors: Neighborhood,
    /// PCL variant: spread each vote over the bins whose centres surround it.
    pub interpolation: bool,
    /// PCL variant: weigh a vote by `1 - d / d_max` with d the descriptor distance.
    pub distance_weight: bool,
    /// PCL variant: least value of a maximum; negative, a share of the greatest value.
    pub vote_threshold: f64,
    /// PCL variant: samples of the RANSAC filter.
    pub iterations: usize,
    /// PCL variant: key of the filter's random numbers.
    pub seed: u64,
}

impl Default for HoughVoting {
    fn default() -> Self {
        Self {
            variant: Variant::default(),
            bins: 15,
            bin_size: None,
            neighbors: Neighborhood::default(),
            interpolation: true,
            distance_weight: false,
            vote_threshold: -1.0,
            iterations: 10_000,
            seed: 0,
        }
    }
}

impl GroupingMethod for HoughVoting {
    fn group(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        self.validate()?;
        let votes = cast_votes(correspondences)?; // v_i
        let group = match self.variant {
            Variant::Grid => self.group_by_peak(correspondences, &votes),
            Variant::Pcl => self.group_by_maxima(correspondences, &votes, execution),
        }?;
        let from_keypoints = correspondences.centered_source_centroid().is_none();
        Ok(group.with("centroid_from_keypoints", f64::from(u8::from(from_keypoints))))
    }

    fn is_instant(&self, correspondences: &Correspondences) -> bool {
        self.variant == Variant::Grid && correspondences.len() <= MOST_INSTANT_VOTES
    }
}

/// Where a correspondence, by its index, puts the source's centroid in the target.
type Vote = (usize, Point3<f64>);

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

impl HoughVoting {
    fn validate(&self) -> Result<()> {
        at_least_one("iterations", self.iterations)?;
        if at_least_one("bins", self.bins)? as f64 > MAX_BINS {
            return Err(Error::invalid("bins", self.bins, "give at most 2,097,151 bins per axis"));
        }
        if let Some(side) = self.bin_size {
            positive("bin_size", side)?;
        } else if self.variant == Variant::Pcl {
            let remedy = "the pcl variant votes in cubes: give their side, a length in the data's unit";
            return Err(Error::invalid("bin_size", "none", remedy));
        }
        if self.vote_threshold.is_nan() || self.vote_threshold < -1.0 {
            let remedy =
                "give a number of votes, or a share of the maximum as a negative number from -1 to 0";
            return Err(Error::invalid("vote_threshold", self.vote_threshold, remedy));
        }
        Ok(())
    }

    fn group_by_peak(&self, correspondences: &Correspondences, votes: &[Vote]) -> Result<Grouping> {
        let n = correspondences.len();
        let (_, target) = correspondences.positions("hough3d")?;
        let Some(grid) = Grid::over(votes, self.bins, self.bin_size, target.diagonal())? else {
            return Ok(Grouping::empty(n));
        };
        let bins: Vec<[u32; 3]> = votes.iter().map(|(_, vote)| grid.clamped_bin(vote)).collect();
        let Some((peak, most)) = grid.fullest(&bins) else {
            return Ok(Grouping::empty(n));
        };
        let is_selected =
            |bin: &[u32; 3]| self.neighbors.reaches([0, 1, 2].map(|k| bin[k].abs_diff(peak[k])));
        let selected = votes.iter().zip(&bins).filter(|(_, bin)| is_selected(bin)).map(|((i, _), _)| *i);
        Ok(Grouping::from_mask(mask_of(n, selected)).with("peak_votes", most as f64))
    }

    fn group_by_maxima(
        &self,
        correspondences: &Correspondences,
        votes: &[Vote],
        execution: &Execution,
    ) -> Result<Grouping> {
        let n = correspondences.len();
        let (source, target) = correspondences.positions("hough3d")?;
        let weights = self.weights(correspondences)?;
        let side = self.bin_size.unwrap_or_default();
        let Some(space) = HoughSpace::accumulate(votes, &weights, side, self.interpolation)? else {
            return Ok(Grouping::empty(n));
        };
        let filter = SampleConsensus {
            iterations: self.iterations,
            tolerance: side,
            seed: self.seed,
            edge_ratio: None,
            confidence: None,
        };
        let mut largest = Vec::new();
        let maxima = space.maxima(self.vote_threshold);
        let count = maxima.len();
        for (rank, members) in maxima.into_iter().enumerate() {
            execution.report(rank, count)?;
            if members.len() > largest.len() {
                let filtered = filter.consensus_among(members, source, target, execution)?;
                if filtered.len() > largest.len() {
                    largest = filtered;
                }
            }
        }
        Ok(Grouping::from_mask(mask_of(n, largest)).with("maxima", count as f64))
    }

    fn weights(&self, correspondences: &Correspondences) -> Result<Vec<f64>> {
        if !self.distance_weight {
            return Ok(vec![1.0; correspondences.len()]);
        }
        let similarity = correspondences.similarity("hough3d with distance_weight=True")?;
        let distance: Vec<f64> =
            similarity.iter().map(|s| if s.is_finite() { 1.0 - s } else { 0.0 }).collect();
        let greatest = distance.iter().copied().fold(0.0, f64::max);
        if greatest <= 0.0 {
            return Ok(vec![1.0; distance.len()]);
        }
        let weight = |(d, s): (&f64, &f64)| if s.is_finite() { 1.0 - d / greatest } else { 0.0 };
        Ok(distance.iter().zip(similarity).map(weight).collect())
    }
}

/// One vote per correspondence that has both frames:
/// `V_L = L (c_S - p)`, `v = L'^T V_L + p'` (frames have axes as rows).
fn cast_votes(correspondences: &Correspondences) -> Result<Vec<Vote>> {
    let (source, target) = correspondences.positions("hough3d")?;
    let (source_frames, target_frames) = correspondences.frames("hough3d")?;
    let centroid = correspondences.centered_source_centroid().unwrap_or_else(Point3::origin);
    let mut votes = Vec::with_capacity(source.len());
    for i in 0..source.len() {
        if let (Some(from), Some(to)) = (source_frames.block(i), target_frames.block(i)) {
            let [x, y, z] = (centroid - source.get(i)).into();
            let local = [0, 3, 6].map(|row| from[row] * x + from[row + 1] * y + from[row + 2] * z);
            let global = [0, 1, 2]
                .map(|column| to[column] * local[0] + to[column + 3] * local[1] + to[column + 6] * local[2]);
            votes.push((i, target.get(i) + Vector3::from(global)));
        }
    }
    Ok(votes)
}

/// Regular bins over the votes' bounding box.
struct Grid {
    low: Point3<f64>,
    side: Vector3<f64>,
    bins: [i64; 3],
}

impl Grid {
    fn over(votes: &[Vote], bins: usize, bin_size: Option<f64>, diagonal: f64) -> Result<Option<Self>> {
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

    fn clamped_bin(&self, vote: &Point3<f64>) -> [u32; 3] {
        // The cast rounds down: no vote lies below the lowest.
        let bin = |axis: usize| ((vote[axis] - self.low[axis]) / self.side[axis]) as u32;
        [0, 1, 2].map(|axis| bin(axis).min(self.bins[axis] as u32 - 1))
    }

    /// The bin that most votes fell into, the first in the order of the linear index, and how many they are.
    fn fullest(&self, bins: &[[u32; 3]]) -> Option<([u32; 3], usize)> {
        // There are at most 2^63 bins, since there are at most 2^21 along an axis.
        let [nx, ny, nz] = self.bins.map(|count| count as u64);
        let indices = bins.iter().map(|bin| bin.map(u64::from)).map(|[x, y, z]| x + nx * (y + ny * z));
        let (index, count) = match nx * ny * nz {
            cells @ ..=MOST_COUNTERS => most_frequent_below(cells as usize, indices),
            _ => most_frequent(indices.collect()),
        }?;
        Some(([index % nx, index / nx % ny, index / nx / ny].map(|bin| bin as u32), count))
    }
}

/// The number that comes most often, the least of several, and how often; none reaches `end`.
fn most_frequent_below(end: usize, numbers: impl Iterator<Item = u64>) -> Option<(u64, usize)> {
    let mut counts = vec![0_u32; end];
    numbers.for_each(|number| counts[number as usize] += 1);
    let most = counts.iter().copied().max().filter(|&most| most > 0)?;
    let first = counts.iter().position(|&count| count == most)?;
    Some((first as u64, most as usize))
}

/// The number that comes most often, the least of several, and how often.
fn most_frequent(mut numbers: Vec<u64>) -> Option<(u64, usize)> {
    numbers.sort_unstable();
    let runs = numbers.chunk_by(|a, b| a == b).map(|run| (run[0], run.len()));
    runs.reduce(|best, run| if run.1 > best.1 { run } else { best })
}

fn bounding_box(votes: &[Vote]) -> Option<(Point3<f64>, Vector3<f64>)> {
    let (_, first) = votes.first()?;
    let low = votes.iter().fold(*first, |low, (_, vote)| low.inf(vote));
    let high = votes.iter().fold(*first, |high, (_, vote)| high.sup(vote));
    Some((low, high - low))
}

fn check_bins(range: f64, side: f64) -> Result<()> {
    if range / side < MAX_BINS {
        return Ok(());
    }
    let remedy =
        format!("the votes spread over {range}; give a larger side, or leave it out for 15 bins per axis");
    Err(Error::invalid("bin_size", side, remedy))
}

/// Weighted votes in cubic bins.
struct HoughSpace {
    cells: BTreeMap<Bin, Cell>,
}

#[derive(Default)]
struct Cell {
    value: f64,
    voters: Vec<usize>,
}

impl HoughSpace {
    fn accumulate(votes: &[Vote], weights: &[f64], side: f64, interpolate: bool) -> Result<Option<Self>> {
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
    fn maxima(&self, threshold: f64) -> Vec<&[usize]> {
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
    use nalgebra::Matrix3;

    /// Identity frames: vote i is the target point plus (centroid - source point).
    fn problem(shifts: &[[f64; 3]]) -> Result<Correspondences> {
        let source: Vec<[f64; 3]> =
            (0..shifts.len()).map(|i| [i as f64, (i * i % 5) as f64, (i * 3 % 7) as f64]).collect();
        let target: Vec<[f64; 3]> =
            source.iter().zip(shifts).map(|(p, s)| [p[0] + s[0], p[1] + s[1], p[2] + s[2]]).collect();
        let frames = vec![Some(Matrix3::identity()); shifts.len()];
        Correspondences::new(&source, &target)?.with_frames(frames.clone(), frames)
    }

    #[test]
    fn the_fullest_bin_and_its_faces_win() -> Result<()> {
        // Bins of width 1 over 0..15: votes in bins 0, 0, 1, 14 along x.
        let input = problem(&[[0.0; 3], [0.2, 0.0, 0.0], [1.1, 0.0, 0.0], [15.0, 0.0, 0.0]])?;
        let faces = HoughVoting::default().group(&input, &Execution::default())?;
        assert_eq!(faces.mask, [true, true, true, false]);
        let peak = HoughVoting { neighbors: Neighborhood::None, ..HoughVoting::default() };
        assert_eq!(peak.group(&input, &Execution::default())?.mask, [true, true, false, false]);
        Ok(())
    }

    #[test]
    fn equal_votes_all_win_and_missing_frames_never_do() -> Result<()> {
        let input = problem(&[[3.0, 1.0, 2.0]; 4])?;
        assert_eq!(HoughVoting::default().group(&input, &Execution::default())?.mask, [true; 4]);
        let frames = vec![Some(Matrix3::identity()), None, Some(Matrix3::identity()), None];
        let input = input.with_frames(frames.clone(), frames)?;
        let group = HoughVoting::default().group(&input, &Execution::default())?;
        assert_eq!(group.mask, [true, false, true, false]);
        Ok(())
    }

    #[test]
    fn pcl_variant_filters_the_maximum() -> Result<()> {
        let mut shifts = vec![[0.4, 0.4, 0.4]; 6];
        shifts.extend([[9.0, 0.0, 0.0], [0.0, 8.0, 0.0], [-7.0, 0.0, 5.0]]);
        let input = problem(&shifts)?;
        let expected: Vec<bool> = (0..9).map(|i| i < 6).collect();
        for interpolation in [true, false] {
            let method = HoughVoting {
                variant: Variant::Pcl,
                bin_size: Some(1.0),
                interpolation,
                ..HoughVoting::default()
            };
            assert_eq!(method.group(&input, &Execution::default())?.mask, expected);
        }
        Ok(())
    }

    #[test]
    fn the_least_of_the_most_frequent_counts() {
        for numbers in [vec![], vec![3], vec![5, 2, 2, 5, 9], vec![9, 0, 9, 7, 7, 0, 0], vec![4, 4, 4]] {
            let counted = most_frequent_below(10, numbers.iter().copied());
            assert_eq!(most_frequent(numbers), counted);
        }
        assert_eq!(most_frequent(vec![5, 2, 2, 5, 9]), Some((2, 2)));
    }

    #[test]
    fn fine_grids_select_what_coarse_ones_do() -> Result<()> {
        // Ten votes in each of two far corners, and 0.4 bins of a fine grid between those of a corner.
        let shift = |i: usize| if i < 10 { [4e-7 * i as f64 / 10.0; 3] } else { [1.0; 3] };
        let shifts: Vec<_> = (0..20).map(shift).collect();
        let expected: Vec<bool> = (0..20).map(|i| i < 10).collect();
        for bins in [2, 40, 41, 1_000, 1_000_000, 2_097_151] {
            let method = HoughVoting { bins, ..HoughVoting::default() };
            assert_eq!(method.group(&problem(&shifts)?, &Execution::default())?.mask, expected, "{bins}");
        }
        Ok(())
    }

    #[test]
    fn bins_pack_and_unpack() {
        let bin = [5, 2_097_151, 77];
        assert_eq!(Bin::new(bin).coordinates(), bin);
    }
}
