//! Agreement of correspondences in distance with a condition on the edge lengths, as rows of bits.
//!
//! Decided as in [`agreement`](super::agreement): in f32 if rounding cannot change the result, else in f64.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use super::agreement::{Block, DistanceAgreement, ROUNDING, RowLanes, RowTerms};
use crate::simd::{self, Kernel, Lanes, SINGLES};

/// Blocks per word.
const BLOCKS: usize = u64::BITS as usize / SINGLES;

/// Error bound of a squared length in f32, in units of [`ROUNDING`], for points within 1 of the origin: the
/// rounding of the points adds 8, the norm and the products 12, the norm of the row 1, the rounded bound 5.
const SQUARE_ERROR: f64 = 64.0;

/// Condition on the lengths of the edges between two correspondences: short edges keep their length under any
/// motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum EdgeLengths {
    /// Any length: coincident points agree, and so does a correspondence with itself.
    Any,
    /// `min(ds, dt)` exceeds this length.
    EachAbove(f64),
    /// `ds + dt` exceeds this length.
    SumAbove(f64),
}

impl EdgeLengths {
    fn hold(self, [ds, dt]: [f64; 2]) -> bool {
        match self {
            Self::Any => true,
            Self::EachAbove(shortest) => ds.min(dt) > shortest,
            Self::SumAbove(shortest) => ds + dt > shortest,
        }
    }

    /// Two bounds: edges are too short if either is below the first, which may be negative, and long enough
    /// if both exceed the second. The bounds differ by less than `tolerance`.
    fn bounds(self, tolerance: f64) -> [f64; 2] {
        match self {
            Self::Any => [f64::NEG_INFINITY; 2],
            Self::EachAbove(shortest) => [shortest; 2],
            Self::SumAbove(shortest) => [(shortest - tolerance) / 2.0, shortest / 2.0],
        }
    }
}

/// The test `|ds - dt| < tolerance` on pairs whose edges are long enough.
#[derive(Debug)]
pub struct LongAgreement<'a> {
    agreement: DistanceAgreement<'a>,
    lengths: EdgeLengths,
    /// Squared scaled lengths of the two bounds.
    squared_bounds: [f64; 2],
}

impl<'a> LongAgreement<'a> {
    /// Adds a condition on lengths to an agreement test.
    pub fn new(agreement: DistanceAgreement<'a>, lengths: EdgeLengths) -> Self {
        // After scaling no length exceeds 2.
        let scaled = |length: f64| (length * agreement.scale).min(4.0);
        let square = |length: f64| if length < 0.0 { f64::NEG_INFINITY } else { scaled(length).powi(2) };
        let squared_bounds = lengths.bounds(agreement.tolerance()).map(square);
        Self { agreement, lengths, squared_bounds }
    }

    /// Whether a pair passes, in f64.
    pub fn agree(&self, i: usize, j: usize) -> bool {
        self.lengths.hold(self.agreement.lengths(i, j)) && self.agreement.agree(i, j)
    }

    /// Writes one bit for each correspondence: whether it passes with `i`. `unsure` is as long as the row.
    pub fn fill_row(&self, i: usize, row: &mut [u64], unsure: &mut [u64]) {
        let terms = self.agreement.terms(i);
        let bounds = |square: f64, error: f64| {
            [terms[6], terms[7]].map(|norm| (square - f64::from(norm) + error) as f32)
        };
        let error = ROUNDING * SQUARE_ERROR;
        simd::run(FindLong {
            terms: self.agreement.row_terms(i),
            blocks: &self.agreement.blocks,
            slack: self.agreement.slack(),
            possible: bounds(self.squared_bounds[0], -error),
            sure: bounds(self.squared_bounds[1], error),
            row: &mut *row,
            unsure: &mut *unsure,
        });
        for (word, bits) in unsure.iter().enumerate() {
            let mut left = *bits;
            while left != 0 {
                let bit = left.trailing_zeros() as usize;
                left &= left - 1;
                row[word] |= u64::from(self.agree(i, word * u64::BITS as usize + bit)) << bit;
            }
        }
    }
}

/// Finds the correspondences that pass according to f32, and those that f32 cannot decide.
struct FindLong<'a> {
    terms: RowTerms,
    blocks: &'a [Block],
    slack: f32,
    /// A partial square below this, on either side, is too short.
    possible: [f32; 2],
    /// A partial square of at least this, on both sides, is long enough.
    sure: [f32; 2],
    row: &'a mut [u64],
    unsure: &'a mut [u64],
}

impl Kernel for FindLong<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let row = RowLanes::new(lanes, self.terms);
        let (possible, sure) = (splat(lanes, self.possible), splat(lanes, self.sure));
        let [minus_slack, slack] = splat(lanes, [-self.slack, self.slack]);
        let words = self.row.iter_mut().zip(self.unsure.iter_mut());
        for ((word, unsure), blocks) in words.zip(self.blocks.chunks(BLOCKS)) {
            (*word, *unsure) = (0, 0);
            for (place, block) in blocks.iter().enumerate() {
                let squares = row.partial_squares(lanes, &block.load(lanes));
                let left = row.left_side_of(lanes, squares);
                let passes = lanes.at_most(left, minus_slack) & both_at_least(lanes, squares, sure);
                let may_pass = lanes.at_most(left, slack) & both_at_least(lanes, squares, possible);
                *word |= u64::from(passes) << (place * SINGLES);
                *unsure |= u64::from(may_pass & !passes) << (place * SINGLES);
            }
        }
    }
}

#[inline(always)]
fn splat<L: Lanes>(lanes: L, values: [f32; 2]) -> [L::Singles; 2] {
    [lanes.splat_singles(values[0]), lanes.splat_singles(values[1])]
}

/// One bit per lane: whether both squares reach their bounds.
#[inline(always)]
fn both_at_least<L: Lanes>(lanes: L, squares: [L::Singles; 2], bounds: [L::Singles; 2]) -> u16 {
    lanes.at_most(bounds[0], squares[0]) & lanes.at_most(bounds[1], squares[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Result;
    use crate::points::Points;

    fn check(source: &[[f64; 3]], target: &[[f64; 3]], tolerance: f64, shortest: f64) -> Result<()> {
        let (source, target) = (Points::from_rows("source", source)?, Points::from_rows("target", target)?);
        let words = source.len().div_ceil(64);
        let (mut row, mut unsure) = (vec![u64::MAX; words], vec![u64::MAX; words]);
        for lengths in
            [EdgeLengths::Any, EdgeLengths::EachAbove(shortest), EdgeLengths::SumAbove(2.0 * shortest)]
        {
            let test = LongAgreement::new(DistanceAgreement::new(&source, &target, tolerance)?, lengths);
            for i in 0..source.len() {
                test.fill_row(i, &mut row, &mut unsure);
                for j in 0..64 * words {
                    let bit = row[j / 64] >> (j % 64) & 1 == 1;
                    assert_eq!(bit, j < source.len() && test.agree(i, j), "{i} {j} {tolerance} {lengths:?}");
                }
            }
        }
        Ok(())
    }

    #[test]
    fn bits_are_those_of_f64_for_any_size() -> Result<()> {
        let place = |i: usize, k: f64| [(i as f64 * k).sin(), (i as f64 * 1.7 * k).cos(), (i as f64).cos()];
        for n in [0, 1, 2, 15, 16, 17, 63, 64, 65, 300] {
            let rows = |k: f64| (0..n).map(|i| place(i, k)).collect::<Vec<_>>();
            for tolerance in [1e-300, 1e-9, 0.1, 1.0, 1e3] {
                check(&rows(0.37), &rows(0.53), tolerance, 2.0 * tolerance)?;
            }
        }
        Ok(())
    }

    #[test]
    fn pairs_at_the_bounds_are_decided_in_f64() -> Result<()> {
        // On a line, lengths and differences are multiples of 0.1, some rounded up and some down.
        for scale in [1e-30, 1.0, 1e30] {
            let source: Vec<_> = (0..300).map(|i| [0.1 * f64::from(i) * scale, 0.0, 0.0]).collect();
            let target: Vec<_> = (0..300).map(|i| [f64::from(i) * 0.09 * scale, 0.0, 0.0]).collect();
            for tenths in [0.1, 0.3, 0.7] {
                check(&source, &target, tenths * scale, 2.0 * tenths * scale)?;
            }
        }
        Ok(())
    }

    #[test]
    fn coincident_and_far_points() -> Result<()> {
        let mut rows = vec![[1.0, 2.0, 3.0]; 40];
        rows.extend((0..40).map(|i| [1e8 + f64::from(i), 2.0, 3.0]));
        let turned: Vec<_> = rows.iter().map(|row| [row[2], row[0], row[1]]).collect();
        for (tolerance, shortest) in [(1e-12, 0.0), (1.0, 2.0), (5.0, 39.0), (1e8, 1.0)] {
            check(&rows, &turned, tolerance, shortest)?;
        }
        Ok(())
    }
}
