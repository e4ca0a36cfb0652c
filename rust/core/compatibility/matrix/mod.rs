//! The symmetric matrix of pairwise scores of all correspondences: stored while it fits, else recomputed.
//!
//! Up to [`DOUBLE_LIMIT`] correspondences all is in f64. Beyond, entries are kept rounded to 16 bits, as
//! reading wider ones from memory takes about as long as computing them in f32 for each product.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

pub mod products;
pub mod scores;
mod tiles;

use self::products::{Element, INTERLEAVED, SingleEntry};
use self::scores::{PairPositions, PairScore};
use self::tiles::{Computed, Cut, Part, Stored, TILE};
use crate::error::Result;
use crate::execution::Execution;
use crate::points::Points;
use crate::simd::lanes::{LaneWork, Lanes, SINGLES, with_lanes};

/// Most correspondences whose scores are kept in f64.
pub const DOUBLE_LIMIT: usize = 1024;

/// Entries of 16 bits are multiples of one over this.
const LEVELS: f32 = 65535.0;

/// Added to a number below 2^16, it leaves the nearest integer in the lowest bits of the sum.
const ROUND: f32 = 8_388_608.0;

/// Symmetric matrix of pair scores with a given diagonal.
#[derive(Debug)]
pub struct PairMatrix {
    positions: PairPositions<f64>,
    score: PairScore,
    diagonal: Option<Vec<f64>>,
    form: Form,
}

#[derive(Debug)]
enum Form {
    /// Tile after tile of every band, if all of them fit.
    Double(Option<Vec<Vec<f64>>>),
    /// The same, rounded; and what they are computed from.
    Rounded(PairPositions<f32>, Option<Vec<Vec<u16>>>),
}

impl PairMatrix {
    /// Builds the matrix; `diagonal` is zero where it is not given.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn new(
        source: &Points,
        target: &Points,
        score: PairScore,
        diagonal: Option<Vec<f64>>,
        execution: &Execution,
    ) -> Result<Self> {
        let positions = PairPositions::new(source, target);
        Self::of(positions, score, diagonal, execution)
    }

    fn of(
        mut positions: PairPositions<f64>,
        score: PairScore,
        diagonal: Option<Vec<f64>>,
        execution: &Execution,
    ) -> Result<Self> {
        if matches!(score, PairScore::DistanceDifferenceIndicator { one_to_one: false, .. }) {
            positions.allow_shared_points();
        }
        let cut = Cut::of(positions.len());
        let form = if positions.len() <= DOUBLE_LIMIT {
            Form::Double(cut.fill_if_fits(execution, fill_rows(&positions, score))?)
        } else {
            let singles = positions.to_single();
            let stored = cut.in_whole_groups().fill_if_fits(execution, fill_levels(&singles, score))?;
            Form::Rounded(singles, stored)
        };
        Ok(Self { positions, score, diagonal, form })
    }

    /// The matrix of the correspondences `indices` alone.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn subset(&self, indices: &[usize], execution: &Execution) -> Result<Self> {
        let diagonal = self.diagonal.as_ref().map(|values| indices.iter().map(|&i| values[i]).collect());
        Self::of(self.positions.subset(indices), self.score, diagonal, execution)
    }

    /// The matrix of the correspondences `indices` alone, in place of this one: never both in memory.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn into_subset(mut self, indices: &[usize], execution: &Execution) -> Result<Self> {
        self.form = Form::Double(None);
        self.subset(indices, execution)
    }

    /// Number of correspondences.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// `M x`.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn multiply(&self, x: &[f64], execution: &Execution) -> Result<Vec<f64>> {
        let cut = self.cut();
        let product = match &self.form {
            Form::Double(Some(stored)) => cut.multiply::<f64, _>(&Stored(stored), x, execution),
            Form::Double(None) => {
                let rows = Computed::new(fill_rows(&self.positions, self.score));
                cut.multiply::<f64, _>(&rows, x, execution)
            }
            Form::Rounded(positions, _) => {
                let rows = Computed::new(fill_rows(positions, self.score));
                cut.in_whole_groups().multiply::<f64, _>(&rows, x, execution)
            }
        };
        Ok(self.plus_diagonal(product?, x))
    }

    /// `M x` with the entries that are kept: off by no more than [`Self::rounding`] times the sum of `x`.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn multiply_rounded(&self, x: &[f64], execution: &Execution) -> Result<Vec<f64>> {
        let cut = self.cut().in_whole_groups();
        let levels = match &self.form {
            Form::Double(_) => return self.multiply(x, execution),
            Form::Rounded(_, Some(stored)) => cut.multiply::<f32, _>(&Stored(stored), x, execution),
            Form::Rounded(positions, None) => {
                let rows = Computed::<f32, _>::new(fill_levels(positions, self.score));
                cut.multiply::<f32, _>(&rows, x, execution)
            }
        };
        let product = levels?.into_iter().map(|sum| sum / f64::from(LEVELS)).collect();
        Ok(self.plus_diagonal(product, x))
    }

    fn cut(&self) -> Cut {
        Cut::of(self.len())
    }

    fn plus_diagonal(&self, mut product: Vec<f64>, x: &[f64]) -> Vec<f64> {
        for ((entry, diagonal), x) in product.iter_mut().zip(self.diagonal.iter().flatten()).zip(x) {
            *entry += diagonal * x;
        }
        product
    }

    /// Greatest error of an entry that is kept.
    pub fn rounding(&self) -> f64 {
        match self.form {
            Form::Double(_) => f64::EPSILON,
            Form::Rounded(..) => 0.6 / f64::from(LEVELS),
        }
    }

    /// Row `i` in f64.
    pub fn row(&self, i: usize) -> Vec<f64> {
        let mut row = vec![0.0; self.len()];
        self.positions.fill_row(self.score, i, &mut row);
        if let Some(diagonal) = &self.diagonal {
            row[i] = diagonal[i];
        }
        row
    }
}

/// Writes a part, row after row.
fn fill_rows<T: Element>(
    positions: &PairPositions<T>,
    score: PairScore,
) -> impl Fn(&Part, &mut [T]) + Sync + '_ {
    move |part, entries| {
        for (i, row) in part.rows.clone().zip(entries.chunks_exact_mut(part.columns.len())) {
            positions.fill_part(score, i, part.columns.start, row);
        }
    }
}

/// Writes a part rounded to 16 bits, its rows interleaved.
fn fill_levels<T: Level>(
    positions: &PairPositions<f32>,
    score: PairScore,
) -> impl Fn(&Part, &mut [T]) + Sync + '_ {
    move |part, entries| {
        let mut scores = [0.0; TILE];
        let scores = &mut scores[..part.columns.len()];
        for (row, i) in part.rows.clone().enumerate() {
            positions.fill_part(score, i, part.columns.start, scores);
            let groups = entries.as_chunks_mut::<INTERLEAVED>().0;
            with_lanes(Interleave { scores, groups, row });
        }
    }
}

/// Rounds the scores of one row, and spreads them over interleaved ones.
struct Interleave<'a, T> {
    scores: &'a [f32],
    groups: &'a mut [[T; INTERLEAVED]],
    row: usize,
}

impl<T: Level> LaneWork for Interleave<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let (levels, round) = (lanes.splat_singles(LEVELS), lanes.splat_singles(ROUND));
        for (scores, group) in self.scores.as_chunks::<SINGLES>().0.iter().zip(self.groups) {
            let rounded = lanes.multiply_add_singles(lanes.load_singles(scores), levels, round);
            T::store(lanes, rounded, &mut group.as_chunks_mut::<SINGLES>().0[self.row]);
        }
    }
}

/// A multiple of 1 / [`LEVELS`], in these units.
trait Level: SingleEntry {
    /// From sums of levels and [`ROUND`].
    fn store<L: Lanes>(lanes: L, rounded: L::Singles, entries: &mut [Self; SINGLES]);
}

impl Level for f32 {
    #[inline(always)]
    fn store<L: Lanes>(lanes: L, rounded: L::Singles, entries: &mut [Self; SINGLES]) {
        lanes.store_singles(lanes.subtract_singles(rounded, lanes.splat_singles(ROUND)), entries);
    }
}

impl Level for u16 {
    #[inline(always)]
    fn store<L: Lanes>(lanes: L, rounded: L::Singles, entries: &mut [Self; SINGLES]) {
        let mut sums = [0.0_f32; SINGLES];
        lanes.store_singles(rounded, &mut sums);
        for (entry, sum) in entries.iter_mut().zip(sums) {
            *entry = sum.to_bits() as Self;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sides() -> Result<(Points, Points)> {
        let source = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 3.0, 0.0]];
        let target = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], [1.0, 3.0, 0.0]];
        Ok((Points::from_rows("source", &source)?, Points::from_rows("target", &target)?))
    }

    #[test]
    fn hand_computed_ratios() -> Result<()> {
        let (source, target) = sides()?;
        let execution = Execution::default();
        let matrix = PairMatrix::new(&source, &target, PairScore::DistanceRatio, None, &execution)?;
        let expected = [0.0, 0.5, 1.0, 3.0 / 10.0_f64.sqrt()];
        for (got, want) in matrix.row(0).iter().zip(expected) {
            assert!((got - want).abs() < 1e-15, "{got} {want}");
        }
        assert!(matrix.row(2)[3].abs() < 1e-15, "coincident source points score 0");
        Ok(())
    }

    #[test]
    fn shared_points_may_score() -> Result<()> {
        let (source, target) = sides()?;
        let execution = Execution::default();
        for (one_to_one, expected) in [(true, 0.0), (false, 1.0)] {
            let score = PairScore::DistanceDifferenceIndicator { tolerance: 1.5, one_to_one };
            let matrix = PairMatrix::new(&source, &target, score, None, &execution)?;
            assert!((matrix.row(2)[3] - expected).abs() < 1e-15);
            assert!(matrix.row(2)[2].abs() < 1e-15, "no score with itself");
        }
        Ok(())
    }

    fn turning(n: usize, k: f64) -> Result<Points> {
        let place = |i: usize| [(i as f64 * k).sin(), (i as f64 * 1.7).cos(), (i as f64 * k).cos()];
        Points::from_rows("points", &(0..n).map(place).collect::<Vec<_>>())
    }

    #[test]
    fn products_equal_those_of_whole_rows() -> Result<()> {
        let ratio = PairScore::DistanceRatio;
        let difference = PairScore::DistanceDifferenceIndicator { tolerance: 0.5, one_to_one: false };
        let from = PairScore::DistanceRatioFrom(0.6);
        let indicator = PairScore::DistanceRatioIndicator(0.6);
        for n in [1, 3, 64, 65, 300, DOUBLE_LIMIT, DOUBLE_LIMIT + 1, 2500] {
            let (source, target) = (turning(n, 0.37)?, turning(n, 0.53)?);
            let diagonal = Some((0..n).map(|i| i as f64).collect());
            let x: Vec<f64> = (0..n).map(|i| (i as f64 * 0.9).sin()).collect();
            for score in [ratio, from, indicator, difference] {
                let mut products = Vec::new();
                for max_memory in [0, usize::MAX] {
                    let execution = Execution::new(max_memory);
                    let matrix = PairMatrix::new(&source, &target, score, diagonal.clone(), &execution)?;
                    let (product, rounded) =
                        (matrix.multiply(&x, &execution)?, matrix.multiply_rounded(&x, &execution)?);
                    // Rounding of entries, and a pair in a million at a threshold.
                    let bound = if n <= DOUBLE_LIMIT { 1e-9 } else { 1.5 + 1e-5 * n as f64 };
                    for (i, (entry, rounded)) in product.iter().zip(&rounded).enumerate() {
                        let plain: f64 = matrix.row(i).iter().zip(&x).map(|(a, b)| a * b).sum();
                        assert!((entry - plain).abs() < bound, "{n} {i} {entry} {plain}");
                        assert!((rounded - plain).abs() < bound, "{n} {i} {rounded} {plain}");
                    }
                    products.push((product, rounded));
                }
                assert_eq!(products[0], products[1]);
            }
        }
        Ok(())
    }

    #[test]
    fn errors_of_large_products_are_those_of_rounded_entries() -> Result<()> {
        let n = 3000;
        let (source, target) = (turning(n, 0.37)?, turning(n, 0.53)?);
        let x: Vec<f64> = (0..n).map(|i| (i as f64 * 0.9).sin().abs()).collect();
        let execution = Execution::default();
        let matrix = PairMatrix::new(&source, &target, PairScore::DistanceRatio, None, &execution)?;
        let (product, rounded) = (matrix.multiply(&x, &execution)?, matrix.multiply_rounded(&x, &execution)?);
        for (i, (entry, rounded)) in product.iter().zip(rounded).enumerate() {
            let plain: f64 = matrix.row(i).iter().zip(&x).map(|(a, b)| a * b).sum();
            assert!((entry - plain).abs() < 2e-7 * plain, "{i} {entry} {plain}");
            assert!((rounded - plain).abs() < 2e-6 * plain, "{i} {rounded} {plain}");
        }
        Ok(())
    }
}
