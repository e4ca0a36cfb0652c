//! Agreement of correspondences in distance: `|ds - dt| < tolerance`, Eq. (13) of the paper (GC).
//!
//! Decided in f32 without square roots if rounding cannot change the result, else in f64 with them; the
//! result is that of f64 throughout. Each pair is evaluated once, for both of its correspondences.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use std::hint::black_box;
use std::ops::Range;

use rayon::prelude::*;

use super::distance::distance_difference;
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;
use crate::selection::top_k::largest_in_order;
use crate::simd::{self, Aligned, Kernel, Lanes, SINGLES};

/// Columns that are searched together for pairs that f32 cannot decide.
const STRIP: usize = 256;

/// Columns of a tile: few enough for the second-level cache.
const TILE: usize = 4096;

/// Rows compared with a column at a time.
const ROWS: usize = 4;

/// Fewest rows of a band.
const MIN_BAND: usize = 64;

/// Number of bands of rows, the unit of parallel work.
const BANDS: usize = 64;

/// u, half a unit in the last place of 1 in f32.
pub(super) const ROUNDING: f64 = f32::EPSILON as f64 / 2.0;

/// Scaled points are within 1 of the origin, so no two lengths differ by more than 2.
const BEYOND_ALL: f64 = 4.0;

/// Source x, y, z, target x, y, z, and the squared norms of these two points.
pub(super) type Terms<T> = [T; 8];

/// The terms of adjacent correspondences; bands and strips are whole blocks.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Block(Terms<[f32; SINGLES]>);

/// The test `|ds - dt| < tolerance` on pairs of correspondences.
#[derive(Debug)]
pub struct DistanceAgreement<'a> {
    source: &'a Points,
    target: &'a Points,
    tolerance: f64,
    /// The power of two that scales all points to within 1 of the origin.
    pub(super) scale: f64,
    /// Scaled to at most 1; padded with NaN, which agrees with nothing.
    pub(super) blocks: Vec<Block>,
    criterion: Criterion,
}

/// With a, b the squared lengths and t the tolerance, `|sqrt a - sqrt b| < t` exactly if
/// `(a - b)^2 + min(t^4 - 2 t^2 (a + b), -t^2 (a + b)) < 0`: the first term of the minimum applies if
/// `a + b > t^2`; otherwise the inequality always holds, and the second term applies. Lengths are computed
/// from norms and products, `|p - q|^2 = |p|^2 - 2 p q + |q|^2`, of points at most R from the origin.
///
/// In f32 the error of the left side is at most `slack` wherever it could change the sign: near
/// `|sqrt a - sqrt b| = t`, where `|a - b|` is at most about `4 R t`. With u = 2^-24, and to first order, the
/// errors are:
///
/// - A rounded point: u R, a length: 2 u R, its square: 8 u R^2.
/// - `|q|^2 - 2 p q`: 12 u R^2, from the norm (1), the products (2), and three sums of at most 3 R^2 (9).
/// - `a - b`: 44 u R^2 + 8 u R t, from two squares (16), two of the former (24), the norms of the row and
///   their difference (3), and the two last differences (1 and 8 u R t).
/// - Its square: `2 * 4 R t` times that, 352 u R^3 t + 64 u R^2 t^2, and its product 16 u R^2 t^2; the terms
///   of second order without t are `3 (44 u R^2)^2 = 5808 u^2 R^4`.
/// - `a + b`: 48 u R^2, from 16 and 24 as before, its last sum (6), and the norms of the row (2). The minimum
///   changes by `2 t^2` times that, 96 u R^2 t^2; the rounding of t^2 adds 16 u R^2 t^2 + 2 u t^4, that of
///   the row's term 4 u R^2 t^2 + u t^4, that of the product 12 u R^2 t^2, and that of the sum 16 u R^2 t^2 +
///   u t^4.
///
/// The total is 352 u R^3 t + 224 u R^2 t^2 + 4 u t^4 + 5808 u^2 R^4. The slack uses the next powers of two,
/// whose excess covers all higher orders and the rounding of f64.
#[derive(Debug, Clone, Copy)]
struct Criterion {
    squared_tolerance: f32,
    slack: f32,
}

impl Criterion {
    fn new(tolerance: f64, radius: f64) -> Self {
        let (t, r) = (tolerance, radius);
        let slack = 512.0 * t * r.powi(3) + 256.0 * (t * r).powi(2) + 8.0 * t.powi(4);
        let slack = slack + 8192.0 * ROUNDING * r.powi(4);
        Self { squared_tolerance: (t * t) as f32, slack: (ROUNDING * slack) as f32 }
    }
}

impl<'a> DistanceAgreement<'a> {
    /// Test for matched points; the tolerance is a length in their unit.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(source: &'a Points, target: &'a Points, tolerance: f64) -> Result<Self> {
        let sides = [source, target];
        let farthest = sides.map(|points| {
            let squares = (0..points.len()).map(|i| squared_norm(&points.get(i).into()));
            squares.fold(0.0, f64::max).sqrt()
        });
        let farthest = farthest[0].max(farthest[1]);
        // A power of two, so that scaling is exact.
        let scale = if farthest > 0.0 { (-farthest.log2().ceil()).exp2() } else { 1.0 };
        let criterion = Criterion::new((tolerance * scale).min(BEYOND_ALL), farthest * scale);
        let mut blocks = memory::filled(Block([[f32::NAN; SINGLES]; 8]), source.len().div_ceil(SINGLES))?;
        for i in 0..source.len() {
            let [p, q] =
                sides.map(|points| <[f64; 3]>::from(points.get(i)).map(|value| (value * scale) as f32));
            // Norms of the rounded coordinates, consistent with their distances.
            let [p_norm, q_norm] = [p, q].map(|point| squared_norm(&point.map(f64::from)) as f32);
            let terms = [p[0], p[1], p[2], q[0], q[1], q[2], p_norm, q_norm];
            for (term, value) in blocks[i / SINGLES].0.iter_mut().zip(terms) {
                term[i % SINGLES] = value;
            }
        }
        Ok(Self { source, target, tolerance, scale, blocks, criterion })
    }

    /// Whether a pair agrees, in f64.
    #[inline]
    pub fn agree(&self, i: usize, j: usize) -> bool {
        let [ds, dt] = self.lengths(i, j);
        distance_difference(ds, dt) < self.tolerance
    }

    /// The bound on `|ds - dt|`.
    pub(super) fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// The distances between the two source points and between the two target points, in f64.
    #[inline]
    pub(super) fn lengths(&self, i: usize, j: usize) -> [f64; 2] {
        [self.source.distance(i, j), self.target.distance(i, j)]
    }

    /// The scaled terms of one correspondence.
    pub(super) fn terms(&self, i: usize) -> Terms<f32> {
        self.blocks[i / SINGLES].0.map(|term| term[i % SINGLES])
    }

    /// Terms of the criterion that depend on the row's correspondence.
    pub(super) fn row_terms(&self, i: usize) -> RowTerms {
        RowTerms::new(self.terms(i), self.criterion)
    }

    /// Bound on the error of the criterion's left side.
    pub(super) fn slack(&self) -> f32 {
        self.criterion.slack
    }

    /// Number of other correspondences that agree with each.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn counts(&self, execution: &Execution) -> Result<Vec<u32>> {
        let n = self.source.len();
        let height = n.div_ceil(BANDS).next_multiple_of(SINGLES).max(MIN_BAND);
        let bands: Vec<Range<usize>> =
            (0..n).step_by(height).map(|first| first..(first + height).min(n)).collect();
        execution.report(0, bands.len())?;
        let partial: Vec<Vec<u32>> =
            memory::par_try_collect(bands.par_iter().map(|band| self.band_counts(band, execution)))?;
        let mut counts = memory::filled(0, n)?;
        for (band, partial) in bands.iter().zip(&partial) {
            counts[band.start..].iter_mut().zip(partial).for_each(|(count, more)| *count += more);
        }
        Ok(counts)
    }

    /// The `most` correspondences that agree with the most others, ascending; ties to the lowest index.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn most_agreeing(&self, most: usize, execution: &Execution) -> Result<Vec<usize>> {
        let counts = memory::collect(self.counts(execution)?.into_iter().map(f64::from))?;
        largest_in_order(&counts, most)
    }

    /// Counts of a band's rows, and of the agreements with all correspondences after them.
    fn band_counts(&self, band: &Range<usize>, execution: &Execution) -> Result<Vec<u32>> {
        let n = self.source.len();
        let mut counts = memory::filled(0, n.next_multiple_of(SINGLES) - band.start)?;
        let rows = band.start..band.end.next_multiple_of(SINGLES);
        let mut ignored = [0; TILE];
        for first in rows.clone().step_by(TILE) {
            // Both correspondences of a pair are rows here, and so is the row itself, which agrees.
            let columns = first..(first + TILE).min(rows.end);
            for i in rows.clone().step_by(ROWS) {
                let inside = self.count_part(i, &columns, &mut ignored[..columns.len()]);
                for (row, inside) in (i..).zip(inside) {
                    counts[row - band.start] += inside - u32::from(columns.contains(&row) && row < n);
                }
            }
        }
        for first in (rows.end..n).step_by(TILE) {
            execution.check()?;
            let (own, after) = counts.split_at_mut(rows.len());
            let columns = first..(first + TILE).min(n.next_multiple_of(SINGLES));
            let mirrored = &mut after[first - rows.end..columns.end - rows.end];
            for (i, own) in rows.clone().step_by(ROWS).zip(own.chunks_exact_mut(ROWS)) {
                let inside = self.count_part(i, &columns, mirrored);
                own.iter_mut().zip(inside).for_each(|(count, more)| *count += more);
            }
        }
        counts.truncate(n - band.start);
        execution.advance()?;
        Ok(counts)
    }

    /// Number of the columns that agree with each row of the group from `i` on; also increments `mirrored`
    /// for each agreeing column.
    fn count_part(&self, i: usize, columns: &Range<usize>, mirrored: &mut [u32]) -> [u32; ROWS] {
        let rows = [i, i + 1, i + 2, i + 3].map(|i| self.row_terms(i));
        let blocks = &self.blocks[columns.start / SINGLES..columns.end / SINGLES];
        let slack = self.slack();
        let count = CountInside { rows, blocks, slack, mirrored: &mut *mirrored };
        let Found { mut inside, unsure } = simd::run(count);
        for (row, mut strips) in unsure.into_iter().enumerate() {
            while strips != 0 {
                let first = strips.trailing_zeros() as usize * STRIP;
                strips &= strips - 1;
                let blocks = &blocks[first / SINGLES..columns.len().min(first + STRIP) / SINGLES];
                for (block, first) in blocks.iter().zip((first..).step_by(SINGLES)) {
                    let Unsure { mut lanes, counted } =
                        simd::run(FindUnsure { row: rows[row], block, slack });
                    while lanes != 0 {
                        let lane = lanes.trailing_zeros() as usize;
                        lanes &= lanes - 1;
                        let k = first + lane;
                        let counted = u32::from(counted >> lane & 1);
                        let agrees = u32::from(self.agree(i + row, columns.start + k));
                        inside[row] = inside[row] + agrees - counted;
                        mirrored[k] = mirrored[k] + agrees - counted;
                    }
                }
            }
        }
        inside
    }
}

fn squared_norm(row: &[f64; 3]) -> f64 {
    row.iter().map(|value| value * value).sum()
}

/// Terms of the criterion's left side that depend on the row.
#[derive(Clone, Copy)]
pub(super) struct RowTerms {
    /// `-2 p`, then `-2 p'`.
    minus_twice: [f32; 6],
    /// `|p|^2 - |p'|^2`.
    difference: f32,
    minus_square: f32,
    /// `t^4 - 2 t^2 (|p|^2 + |p'|^2)`.
    wide: f32,
    /// `-t^2 (|p|^2 + |p'|^2)`.
    narrow: f32,
}

impl RowTerms {
    fn new([px, py, pz, qx, qy, qz, p_norm, q_norm]: Terms<f32>, criterion: Criterion) -> Self {
        let square = f64::from(criterion.squared_tolerance);
        let norms = f64::from(p_norm) + f64::from(q_norm);
        Self {
            minus_twice: [px, py, pz, qx, qy, qz].map(|value| -2.0 * value),
            difference: (f64::from(p_norm) - f64::from(q_norm)) as f32,
            minus_square: -criterion.squared_tolerance,
            wide: (square * (square - 2.0 * norms)) as f32,
            narrow: (-square * norms) as f32,
        }
    }
}

/// The row's terms broadcast to every lane.
#[derive(Clone, Copy)]
pub(super) struct RowLanes<L: Lanes> {
    minus_twice: [L::Singles; 6],
    difference: L::Singles,
    minus_square: L::Singles,
    minus_twice_square: L::Singles,
    wide: L::Singles,
    narrow: L::Singles,
}

impl<L: Lanes> RowLanes<L> {
    #[inline(always)]
    pub(super) fn new(lanes: L, row: RowTerms) -> Self {
        Self {
            minus_twice: row.minus_twice.map(
                #[inline(always)]
                |value| lanes.splat_singles(value),
            ),
            difference: lanes.splat_singles(row.difference),
            minus_square: lanes.splat_singles(row.minus_square),
            minus_twice_square: lanes.splat_singles(2.0 * row.minus_square),
            wide: lanes.splat_singles(row.wide),
            narrow: lanes.splat_singles(row.narrow),
        }
    }

    /// The criterion's left side for the columns of a block.
    #[inline(always)]
    fn left_side(&self, lanes: L, columns: &Terms<L::Singles>) -> L::Singles {
        self.left_side_of(lanes, self.partial_squares(lanes, columns))
    }

    /// `|q|^2 - 2 p q` on each side: the squared lengths without the squared norms of the row.
    #[inline(always)]
    pub(super) fn partial_squares(&self, lanes: L, columns: &Terms<L::Singles>) -> [L::Singles; 2] {
        let [px, py, pz, qx, qy, qz, p_norm, q_norm] = *columns;
        let [x, y, z, u, v, w] = self.minus_twice;
        let a = lanes.multiply_add_singles(pz, z, p_norm);
        let a = lanes.multiply_add_singles(px, x, lanes.multiply_add_singles(py, y, a));
        let b = lanes.multiply_add_singles(qz, w, q_norm);
        let b = lanes.multiply_add_singles(qx, u, lanes.multiply_add_singles(qy, v, b));
        [a, b]
    }

    /// The criterion's left side, from both partial squares.
    #[inline(always)]
    pub(super) fn left_side_of(&self, lanes: L, [a, b]: [L::Singles; 2]) -> L::Singles {
        let difference = lanes.add_singles(lanes.subtract_singles(a, b), self.difference);
        let sum = lanes.add_singles(a, b);
        let wide = lanes.multiply_add_singles(sum, self.minus_twice_square, self.wide);
        let narrow = lanes.multiply_add_singles(sum, self.minus_square, self.narrow);
        lanes.multiply_add_singles(difference, difference, lanes.min_singles(wide, narrow))
    }
}

impl Block {
    #[inline(always)]
    pub(super) fn load<L: Lanes>(&self, lanes: L) -> Terms<L::Singles> {
        self.0.each_ref().map(
            #[inline(always)]
            |term| lanes.load_singles(term),
        )
    }
}

/// Number of columns per row that agree according to f32, and one bit per strip: whether it holds a pair too
/// close to the tolerance for f32.
struct Found {
    inside: [u32; ROWS],
    unsure: [u32; ROWS],
}

/// Counts the pairs that agree according to f32.
struct CountInside<'a> {
    rows: [RowTerms; ROWS],
    blocks: &'a [Block],
    slack: f32,
    mirrored: &'a mut [u32],
}

impl Kernel for CountInside<'_> {
    type Output = Found;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Found {
        // The same number for all rows: the compiler then keeps it once.
        let minus_square = self.rows[0].minus_square;
        let [row0, row1, row2, row3] = self.rows.map(
            #[inline(always)]
            |row| RowTerms { minus_square, ..row },
        );
        let rows = [
            RowLanes::new(lanes, row0),
            RowLanes::new(lanes, row1),
            RowLanes::new(lanes, row2),
            RowLanes::new(lanes, row3),
        ];
        let (zero, slack) = (lanes.splat_singles(0.0), lanes.splat_singles(self.slack));
        let mut inside = [lanes.load_counts(&[0; SINGLES]); ROWS];
        let mut unsure = [0; ROWS];
        let strips = self.blocks.chunks(STRIP / SINGLES).zip(self.mirrored.chunks_mut(STRIP));
        for (strip, (blocks, mirrored)) in strips.enumerate() {
            let mut least = [lanes.splat_singles(f32::INFINITY); ROWS];
            for (block, mirrored) in blocks.iter().zip(mirrored.as_chunks_mut::<SINGLES>().0) {
                let columns = block.load(lanes);
                let mut sum = lanes.load_counts(mirrored);
                for k in 0..ROWS {
                    let left = rows[k].left_side(lanes, &columns);
                    let agrees = lanes.ones_where_below(left, zero);
                    inside[k] = lanes.add_counts(inside[k], agrees);
                    sum = lanes.add_counts(sum, agrees);
                    // The minimum returns its second argument if the first is NaN, as in the padding of the
                    // last block.
                    least[k] = lanes.min_singles(lanes.absolute_singles(left), least[k]);
                }
                lanes.store_counts(sum, mirrored);
            }
            for k in 0..ROWS {
                unsure[k] |= u32::from(lanes.at_most(least[k], slack) != 0) << strip;
            }
        }
        let mut found = Found { inside: [0; ROWS], unsure };
        for (total, inside) in found.inside.iter_mut().zip(inside) {
            let mut counts = Aligned([0; SINGLES]);
            lanes.store_counts(inside, &mut counts.0);
            // `black_box` forces the counts onto the stack with alignment. Otherwise values that do not fit
            // in registers may straddle two cache lines, depending on the caller.
            *total = black_box(&counts).0.iter().sum();
        }
        found
    }
}

/// The columns of a block that f32 cannot decide, and those counted as agreeing, one bit each.
struct Unsure {
    lanes: u16,
    counted: u16,
}

/// Finds the columns of a block that f32 cannot decide.
struct FindUnsure<'a> {
    row: RowTerms,
    block: &'a Block,
    slack: f32,
}

impl Kernel for FindUnsure<'_> {
    type Output = Unsure;

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Unsure {
        let left = RowLanes::new(lanes, self.row).left_side(lanes, &self.block.load(lanes));
        let (zero, slack) = (lanes.splat_singles(0.0), lanes.splat_singles(self.slack));
        Unsure {
            lanes: lanes.at_most(lanes.absolute_singles(left), slack),
            counted: !lanes.at_most(zero, left), // NaN columns are not close
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(agreement: &DistanceAgreement, n: usize) -> Vec<u32> {
        let count = |i: usize| (0..n).filter(|&j| j != i && agreement.agree(i, j)).count();
        (0..n).map(|i| count(i) as u32).collect()
    }

    fn check(source: &[[f64; 3]], target: &[[f64; 3]], tolerances: &[f64]) -> Result<()> {
        let (source, target) = (Points::from_rows("source", source)?, Points::from_rows("target", target)?);
        for &tolerance in tolerances {
            let agreement = DistanceAgreement::new(&source, &target, tolerance)?;
            let counts = agreement.counts(&Execution::default())?;
            assert_eq!(counts, plain(&agreement, source.len()), "{} {tolerance}", source.len());
        }
        Ok(())
    }

    #[test]
    fn counts_are_those_of_f64_for_any_size() -> Result<()> {
        let place = |i: usize, k: f64| [(i as f64 * k).sin(), (i as f64 * 1.7 * k).cos(), (i as f64).cos()];
        for n in [0, 1, 2, 15, 16, 17, 63, 64, 65, 300, 1023, 1024, 1025, 2200] {
            let rows = |k: f64| (0..n).map(|i| place(i, k)).collect::<Vec<_>>();
            check(&rows(0.37), &rows(0.53), &[1e-300, 1e-9, 0.1, 1.0, 1e3, 1e300])?;
        }
        Ok(())
    }

    #[test]
    fn pairs_at_the_tolerance_are_decided_in_f64() -> Result<()> {
        // On a line, differences are multiples of 0.1, some rounded up and some down.
        for scale in [1e-30, 1.0, 1e30] {
            let source: Vec<_> = (0..400).map(|i| [f64::from(i) * scale, 0.0, 0.0]).collect();
            let target: Vec<_> = (0..400).map(|i| [f64::from(i) * 0.9 * scale, 0.0, 0.0]).collect();
            let tolerances = [1, 3, 7, 25].map(|tenths| f64::from(tenths) * 0.1 * scale);
            check(&source, &target, &tolerances)?;
        }
        Ok(())
    }

    #[test]
    fn coincident_and_far_points() -> Result<()> {
        let mut rows = vec![[1.0, 2.0, 3.0]; 40];
        check(&rows, &rows, &[1e-12, 1.0])?;
        rows.extend((0..40).map(|i| [1e8 + f64::from(i), 2.0, 3.0]));
        let turned: Vec<_> = rows.iter().map(|row| [row[2], row[0], row[1]]).collect();
        check(&rows, &turned, &[1e-12, 1e-9, 1.0, 5.0, 1e8])
    }
}
