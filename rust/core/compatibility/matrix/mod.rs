//! The symmetric matrix of the pairwise scores of all correspondences: stored if it fits in memory, else
//! recomputed.
//!
//! Up to [`DOUBLE_LIMIT`] correspondences all entries are f64. Larger matrices store entries rounded to 16
//! bits: reading wider ones from memory takes about as long as computing them in f32 for each product.

mod coordinates;
mod levels;
mod products;
mod scores;
mod tiles;

pub use self::scores::PairScore;

pub(crate) use self::scores::PairPositions;

use self::coordinates::Coordinate;
use self::levels::{LEVELS, interleave};
use self::tiles::{Cut, Part, Rows, TILE};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;
use crate::simd::Aligned;

/// Most correspondences whose scores are stored in f64.
pub const DOUBLE_LIMIT: usize = 1024;

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
    /// Tiles of every band, if all of them fit.
    Double(Option<Vec<Vec<f64>>>),
    /// Rounded tiles, if they fit, and the positions that they are computed from.
    Rounded(PairPositions<f32>, Option<Vec<Vec<u16>>>),
}

impl PairMatrix {
    /// Builds the matrix; `diagonal` is zero if not given.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn new(
        source: &Points,
        target: &Points,
        score: PairScore,
        diagonal: Option<Vec<f64>>,
        execution: &Execution,
    ) -> Result<Self> {
        let positions = PairPositions::new(source, target)?;
        Self::of(positions, score, diagonal, execution)
    }

    fn of(
        mut positions: PairPositions<f64>,
        score: PairScore,
        diagonal: Option<Vec<f64>>,
        execution: &Execution,
    ) -> Result<Self> {
        if score.lets_points_be_shared() {
            positions.allow_shared_points();
        }
        let cut = Cut::of(positions.len());
        let form = if positions.len() <= DOUBLE_LIMIT {
            Form::Double(cut.fill_if_fits(execution, fill_rows(&positions, score))?)
        } else {
            let singles = positions.to_single()?;
            let stored = cut.in_whole_groups().fill_if_fits(execution, fill_levels(&singles, score))?;
            Form::Rounded(singles, stored)
        };
        Ok(Self { positions, score, diagonal, form })
    }

    /// The matrix of the correspondences at `indices`.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn subset(&self, indices: &[usize], execution: &Execution) -> Result<Self> {
        let among = |values: &Vec<f64>| memory::collect(indices.iter().map(|&i| values[i]));
        let diagonal = self.diagonal.as_ref().map(among).transpose()?;
        Self::of(self.positions.subset(indices)?, self.score, diagonal, execution)
    }

    /// The matrix of the correspondences at `indices`, in place of this one: never both in memory.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
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
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn multiply(&self, x: &[f64], execution: &Execution) -> Result<Vec<f64>> {
        let cut = self.cut();
        let product = match &self.form {
            Form::Double(stored) => {
                let fill = fill_rows(&self.positions, self.score);
                cut.multiply(&Rows { stored: stored.as_deref(), fill }, x, execution)
            }
            Form::Rounded(positions, _) => {
                let fill = fill_rows(positions, self.score);
                cut.in_whole_groups().multiply(&Rows { stored: None, fill }, x, execution)
            }
        };
        Ok(self.plus_diagonal(product?, x))
    }

    /// `M x` with the stored entries: the error is about [`Self::rounding`] times the sum of `x`.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn multiply_rounded(&self, x: &[f64], execution: &Execution) -> Result<Vec<f64>> {
        let Form::Rounded(positions, stored) = &self.form else {
            return self.multiply(x, execution);
        };
        let rows = Rows { stored: stored.as_deref(), fill: fill_levels(positions, self.score) };
        let mut product = self.cut().in_whole_groups().multiply(&rows, x, execution)?;
        product.iter_mut().for_each(|sum| *sum /= f64::from(LEVELS));
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

    /// Error of a stored entry: half a level, plus a tenth of a level for f32 scores of points about half the
    /// extent apart. Scores of nearly coincident points have larger errors.
    pub fn rounding(&self) -> f64 {
        match self.form {
            Form::Double(_) => f64::EPSILON,
            Form::Rounded(..) => 0.6 / f64::from(LEVELS),
        }
    }

    /// Row `i` in f64.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn row(&self, i: usize) -> Result<Vec<f64>> {
        let mut row = memory::filled(0.0, self.len())?;
        self.fill_row(i, &mut row);
        Ok(row)
    }

    /// Writes row `i` in f64.
    pub fn fill_row(&self, i: usize, row: &mut [f64]) {
        self.positions.fill_row(self.score, i, row);
        if let Some(diagonal) = &self.diagonal {
            row[i] = diagonal[i];
        }
    }
}

/// Writes a part by rows.
fn fill_rows<T: Coordinate>(
    positions: &PairPositions<T>,
    score: PairScore,
) -> impl Fn(&Part, &mut [T]) + Sync + '_ {
    move |part, entries| {
        for (i, row) in part.rows.clone().zip(entries.chunks_exact_mut(part.columns.len())) {
            positions.fill_part(score, i, part.columns.start, row);
        }
    }
}

/// Writes a part rounded to 16 bits, with its rows interleaved.
fn fill_levels(positions: &PairPositions<f32>, score: PairScore) -> impl Fn(&Part, &mut [u16]) + Sync + '_ {
    move |part, entries| {
        let mut scores = Aligned([0.0; TILE]);
        let scores = &mut scores.0[..part.columns.len()];
        for (row, i) in part.rows.clone().enumerate() {
            positions.fill_part(score, i, part.columns.start, scores);
            interleave(scores, row, entries);
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
        for (got, want) in matrix.row(0)?.iter().zip(expected) {
            assert!((got - want).abs() < 1e-15, "{got} {want}");
        }
        assert!(matrix.row(2)?[3].abs() < 1e-15, "coincident source points score 0");
        Ok(())
    }

    #[test]
    fn a_ratio_equal_to_the_least_is_accepted() -> Result<()> {
        let (source, target) = sides()?;
        let execution = Execution::default();
        for (score, expected) in
            [(PairScore::DistanceRatioFrom(0.5), 0.5), (PairScore::DistanceRatioIndicator(0.5), 1.0)]
        {
            let matrix = PairMatrix::new(&source, &target, score, None, &execution)?;
            assert!((matrix.row(0)?[1] - expected).abs() < 1e-15, "{score:?}");
        }
        Ok(())
    }

    #[test]
    fn shared_points_may_score() -> Result<()> {
        let (source, target) = sides()?;
        let execution = Execution::default();
        for (one_to_one, expected) in [(true, 0.0), (false, 1.0)] {
            let score = PairScore::DistanceDifferenceIndicator { tolerance: 1.5, one_to_one };
            let matrix = PairMatrix::new(&source, &target, score, None, &execution)?;
            assert!((matrix.row(2)?[3] - expected).abs() < 1e-15);
            assert!(matrix.row(2)?[2].abs() < 1e-15, "no score with itself");
        }
        Ok(())
    }

    #[test]
    fn hand_computed_squared_differences() -> Result<()> {
        let (source, target) = sides()?;
        let execution = Execution::default();
        let score = PairScore::SquaredDistanceDifference { tolerance: 4.0 };
        let matrix = PairMatrix::new(&source, &target, score, Some(vec![1.0; 4]), &execution)?;
        // The edges 0-1 and 2-3 have the lengths 2 and 4, and 0 and 1.
        assert!((matrix.row(0)?[1] - 0.75).abs() < 1e-15);
        assert!((matrix.row(2)?[3] - 0.9375).abs() < 1e-15);
        assert!((matrix.row(2)?[2] - 1.0).abs() < 1e-15);
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
            let squared = PairScore::SquaredDistanceDifference { tolerance: 0.5 };
            for score in [ratio, from, indicator, difference, squared] {
                let mut products = Vec::new();
                for max_memory in [0, usize::MAX] {
                    let execution = Execution::new(max_memory);
                    let matrix = PairMatrix::new(&source, &target, score, diagonal.clone(), &execution)?;
                    let (product, rounded) =
                        (matrix.multiply(&x, &execution)?, matrix.multiply_rounded(&x, &execution)?);
                    // Rounding of entries, and a pair in a million at a threshold.
                    let bound = if n <= DOUBLE_LIMIT { 1e-9 } else { 1.5 + 1e-5 * n as f64 };
                    for (i, (entry, rounded)) in product.iter().zip(&rounded).enumerate() {
                        let plain: f64 = matrix.row(i)?.iter().zip(&x).map(|(a, b)| a * b).sum();
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
            let plain: f64 = matrix.row(i)?.iter().zip(&x).map(|(a, b)| a * b).sum();
            assert!((entry - plain).abs() < 2e-7 * plain, "{i} {entry} {plain}");
            assert!((rounded - plain).abs() < 2e-6 * plain, "{i} {rounded} {plain}");
        }
        Ok(())
    }
}
