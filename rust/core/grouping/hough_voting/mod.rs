//! 3DHV: each correspondence votes for the position of the source's centroid in the target; the peak wins.
//!
//! The paper, section 3.2, Eq. (14) to (16) (after Tombari, Di Stefano, PSIVT 2010). The local reference
//! frames at both ends make a vote independent of the unknown motion. Cost O(n log n).

mod grid;
mod space;

use nalgebra::{Point3, Vector3};

use self::grid::Grid;
use self::space::HoughSpace;
use super::GroupingMethod;
use crate::consensus::SampleConsensus;
use crate::error::Error;
use crate::grouping_result::mask_of;
use crate::options::{self, ROUNDS, Value, at_most, method, number, words};
use crate::rule::{Kind, Rule};
use crate::{Correspondences, Execution, Grouping, Result, memory};

/// Most bins per axis that the grid's linear index can distinguish.
const MAX_BINS: u64 = 2_097_151;

/// Most votes that the grid variant counts within a millisecond.
const MOST_INSTANT_VOTES: usize = 20_000;

/// Range of a maximum's value.
const VOTES: options::Kind = number(
    -1.0,
    f64::INFINITY,
    "give a number of votes, or a share of the maximum as a negative number from -1 to 0",
);

words! {
    /// Counting of the votes.
    pub enum Variant {
        /// One vote per correspondence; the fullest bin and its neighbours are selected, as in the paper.
        Grid = Value::Word("grid"),
        /// Cubic bins with interpolated votes; each local maximum is filtered by RANSAC, the largest wins, as
        /// in PCL.
        Pcl = Value::Word("pcl"),
    }
}

words! {
    /// Neighbourhood of the peak whose voters are also selected.
    pub enum Neighborhood {
        /// The 6 bins that share a face with it.
        Faces = Value::Whole(6),
        /// The peak alone.
        None = Value::Whole(0),
        /// All 26 around it.
        All = Value::Whole(26),
    }
}

impl Neighborhood {
    /// Number of bins besides the peak.
    fn count(self) -> f64 {
        match self {
            Self::None => 0.0,
            Self::Faces => 6.0,
            Self::All => 26.0,
        }
    }

    /// Whether it contains a bin at a given offset from the peak.
    fn reaches(self, [x, y, z]: [u32; 3]) -> bool {
        match self {
            Self::None => x + y + z == 0,
            Self::Faces => x + y + z <= 1,
            Self::All => x.max(y).max(z) <= 1,
        }
    }
}

method! {
    /// Parameters of 3D Hough voting.
    pub struct HoughVoting = "3dhv", ["source", "target", "source_lrf", "target_lrf"],
        optional ["similarity", "source_centroid"], {
        /// Bins per axis over the votes' bounding box.
        pub bins: usize = 15, at_most(MAX_BINS);
        /// Side of cubic bins, a length, in place of `bins`; the "pcl" variant needs it.
        pub bin_size: Option<f64> = None;
        /// Bins around the peak whose voters are also selected.
        pub neighbors: Neighborhood = Neighborhood::default();
        /// "grid", as in the paper: one vote per correspondence, for the bin that contains it. "pcl", as in
        /// PCL: votes are interpolated, and each local maximum is filtered by RANSAC.
        pub variant: Variant = Variant::default();
        /// "pcl" variant: interpolate a vote between the up to 8 bins whose centres surround it.
        pub interpolation: bool = true;
        /// "pcl" variant: weight a vote by `1 - d / d_max`, with d = `1 - similarity`.
        pub distance_weight: bool = false;
        /// "pcl" variant: least value of a maximum; from -1 to 0, relative to the greatest value.
        pub vote_threshold: f64 = -1.0, VOTES;
        /// "pcl" variant: samples of the RANSAC filter.
        pub iterations: usize = 10_000, ROUNDS;
        /// "pcl" variant: seed of the filter's random numbers.
        pub seed: u64 = 0;
    }
}

impl GroupingMethod for HoughVoting {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        self.validate()?;
        let votes = cast_votes(correspondences)?; // Eq. (14) to (16)
        let group = match self.variant {
            Variant::Grid => self.group_by_peak(correspondences, &votes)?,
            Variant::Pcl => self.group_by_maxima(correspondences, &votes, execution)?,
        };
        let from_keypoints = correspondences.centered_source_centroid().is_none();
        Ok(group.with("centroid_from_keypoints", f64::from(u8::from(from_keypoints))))
    }

    fn is_instant(&self, correspondences: &Correspondences) -> bool {
        self.variant == Variant::Grid && correspondences.len() <= MOST_INSTANT_VOTES
    }
}

/// A correspondence's index, and its vote for the position of the source's centroid in the target.
type Vote = (usize, Point3<f64>);

impl HoughVoting {
    fn validate(&self) -> Result<()> {
        if self.bin_size.is_none() && self.variant == Variant::Pcl {
            let remedy = "the pcl variant votes in cubes: give their side, a length in the data's unit";
            return Err(Error::invalid("bin_size", "none", remedy));
        }
        Ok(())
    }

    fn group_by_peak(&self, correspondences: &Correspondences, votes: &[Vote]) -> Result<Grouping> {
        let (_, target) = correspondences.positions("3dhv")?;
        let mut group = Grouping::empty(target.len())?;
        let mut steps = memory::filled(None, target.len())?;
        if let Some(grid) = Grid::over(votes, self.bins, self.bin_size, target.diagonal())? {
            let bins = memory::collect(votes.iter().map(|(_, vote)| grid.clamped_bin(vote)))?;
            let (peak, most) = grid.fullest(&bins)?.unwrap_or_default();
            for ((i, _), bin) in votes.iter().zip(&bins) {
                group.mask[*i] = self.neighbors.reaches([0, 1, 2].map(|k| bin[k].abs_diff(peak[k])));
                steps[*i] = Some([0, 1, 2].map(|k| f64::from(bin[k]) - f64::from(peak[k])));
            }
            group = group.with("peak_votes", most as f64);
        }
        let rule = Rule::bounded(Kind::FullestBin, self.neighbors.count());
        Ok(group.by(Rule { votes: Some(steps), ..rule }))
    }

    fn group_by_maxima(
        &self,
        correspondences: &Correspondences,
        votes: &[Vote],
        execution: &Execution,
    ) -> Result<Grouping> {
        let (source, target) = correspondences.positions("3dhv")?;
        let n = source.len();
        let weights = self.weights(correspondences)?;
        let side = self.bin_size.unwrap_or_default();
        let mut places = memory::filled(None, n)?;
        votes.iter().for_each(|(i, vote)| places[*i] = Some(vote.coords.into()));
        let rule = Rule { votes: Some(places), ..Rule::bounded(Kind::Maximum, side) };
        let Some(space) = HoughSpace::accumulate(votes, &weights, side, self.interpolation)? else {
            return Ok(Grouping::empty(n)?.by(rule));
        };
        let filter = SampleConsensus {
            iterations: self.iterations,
            tolerance: side,
            seed: self.seed,
            edge_ratio: None,
            confidence: None,
        };
        let mut largest = Vec::new();
        let maxima = space.maxima(self.vote_threshold)?;
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
        Ok(Grouping::from_mask(mask_of(n, largest)?).with("maxima", count as f64).by(rule))
    }

    fn weights(&self, correspondences: &Correspondences) -> Result<Vec<f64>> {
        if !self.distance_weight {
            return memory::filled(1.0, correspondences.len());
        }
        let similarity = correspondences.similarity("3dhv with distance_weight=True")?;
        let distances = similarity.iter().map(|s| if s.is_finite() { 1.0 - s } else { 0.0 });
        let greatest = distances.clone().fold(0.0, f64::max);
        if greatest <= 0.0 {
            return memory::filled(1.0, similarity.len());
        }
        let weight = |(d, s): (f64, &f64)| if s.is_finite() { 1.0 - d / greatest } else { 0.0 };
        memory::collect(distances.zip(similarity).map(weight))
    }
}

/// One vote per correspondence that has both frames:
/// `V_L = L (c_S - p)`, `v = L'^T V_L + p'` (frames have axes as rows).
fn cast_votes(correspondences: &Correspondences) -> Result<Vec<Vote>> {
    let (source, target) = correspondences.positions("3dhv")?;
    let (source_frames, target_frames) = correspondences.frames("3dhv")?;
    let centroid = correspondences.centered_source_centroid().unwrap_or_else(Point3::origin);
    let mut votes = memory::with_capacity(source.len())?;
    for i in 0..source.len() {
        if let (Some(from), Some(to)) = (source_frames.block(i), target_frames.block(i)) {
            let [x, y, z] = (centroid - source.get(i)).into(); // V_G, Eq. (14)
            let local = [0, 3, 6].map(|row| from[row] * x + from[row + 1] * y + from[row + 2] * z); // V_L, Eq. (15)
            let global = [0, 1, 2]
                .map(|column| to[column] * local[0] + to[column + 3] * local[1] + to[column + 6] * local[2]);
            votes.push((i, target.get(i) + Vector3::from(global))); // V'_G, Eq. (16)
        }
    }
    Ok(votes)
}

fn bounding_box(votes: &[Vote]) -> Option<(Point3<f64>, Vector3<f64>)> {
    let (_, first) = votes.first()?;
    let low = votes.iter().fold(*first, |low, (_, vote)| low.inf(vote));
    let high = votes.iter().fold(*first, |high, (_, vote)| high.sup(vote));
    Some((low, high - low))
}

fn check_bins(range: f64, side: f64) -> Result<()> {
    if range / side < MAX_BINS as f64 {
        return Ok(());
    }
    let remedy =
        format!("the votes spread over {range}; give a larger side, or leave it out for 15 bins per axis");
    Err(Error::invalid("bin_size", side, remedy))
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
    fn fine_grids_select_the_same_as_coarse_ones() -> Result<()> {
        // Ten votes in each of two far corners, spaced by 0.4 bins of a fine grid.
        let shift = |i: usize| if i < 10 { [4e-7 * i as f64 / 10.0; 3] } else { [1.0; 3] };
        let shifts: Vec<_> = (0..20).map(shift).collect();
        let expected: Vec<bool> = (0..20).map(|i| i < 10).collect();
        for bins in [2, 40, 41, 1_000, 1_000_000, 2_097_151] {
            let method = HoughVoting { bins, ..HoughVoting::default() };
            assert_eq!(method.group(&problem(&shifts)?, &Execution::default())?.mask, expected, "{bins}");
        }
        Ok(())
    }
}
