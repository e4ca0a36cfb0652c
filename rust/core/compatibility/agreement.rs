//! Which correspondences keep their distance to each other: `|ds - dt| < tolerance`, the paper's Eq. for GC.
//!
//! Decided in f32 without square roots, wherever rounding can't change the answer, else in f64 with them;
//! the result is that of f64 throughout. Each pair is looked at once, for both of its correspondences.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd, bytemuck};
use rayon::prelude::*;

use super::distance::distance_difference;
use crate::error::Result;
use crate::execution::Execution;
use crate::points::Points;

/// Correspondences of a block; bands and strips are whole blocks.
const BLOCK: usize = 16;

/// Columns that are looked through together for pairs that f32 can't tell.
const STRIP: usize = 256;

/// Columns of a tile: few enough for the second-level cache.
const TILE: usize = 4096;

/// Rows that are compared with a column at a time.
const GROUP: usize = 4;

/// Fewest rows of a band.
const MIN_BAND: usize = 64;

/// Bands that the rows are cut into, for the threads to share.
const BANDS: usize = 64;

/// Half a unit in the last place of 1 in f32.
const ROUNDING: f64 = f32::EPSILON as f64 / 2.0;

/// Scaled lengths are far below this, and so are their differences.
const BEYOND_ALL: f64 = 4.0;

/// Of a correspondence: source x, y, z, target x, y, z, and the squared norms of these two points.
type Terms<T> = [T; 8];

/// The terms of correspondences next to each other.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
struct Block(Terms<[f32; BLOCK]>);

/// The test `|ds - dt| < tolerance` on pairs of correspondences.
#[derive(Debug)]
pub struct DistanceAgreement<'a> {
    source: &'a Points,
    target: &'a Points,
    tolerance: f64,
    /// Scaled to at most 1; filled up with NaN, which agrees with nothing.
    blocks: Vec<Block>,
    criterion: Criterion,
}

/// With a, b the squared lengths and t the tolerance, `|sqrt a - sqrt b| < t` exactly if
/// `(a - b)^2 + min(t^4 - 2 t^2 (a + b), -t^2 (a + b)) < 0`: the first of the two where `a + b > t^2`, and
/// elsewhere, where it always holds, the second. Lengths come from norms and products,
/// `|p - q|^2 = |p|^2 - 2 p q + |q|^2`, of points that are no farther than R from the origin.
///
/// In f32 the left side is off by less than `slack` wherever that could change its sign. With u = 2^-24:
/// rounded coordinates shift a length by less than 4 u R, which moves the left side by less than
/// `16 u R t (a + b)`; a length's square is off by less than 16 u R^2, and as `|a - b| < 4 R t` near the
/// threshold, that moves it by less than `500 u R^3 t + 200 u R^2 t^2`.
#[derive(Debug, Clone, Copy)]
struct Criterion {
    squared_tolerance: f32,
    slack: f32,
}

impl Criterion {
    fn new(tolerance: f64, radius: f64) -> Self {
        let (t, r) = (tolerance, radius);
        let slack = 1024.0 * t * r.powi(3) + 256.0 * (t * r).powi(2) + 8.0 * t.powi(4);
        let slack = slack + 8192.0 * ROUNDING * r.powi(4);
        Self { squared_tolerance: (t * t) as f32, slack: (ROUNDING * slack) as f32 }
    }
}

impl<'a> DistanceAgreement<'a> {
    /// Of matched points; the tolerance is a length in their unit.
    pub fn new(source: &'a Points, target: &'a Points, tolerance: f64) -> Self {
        let sides = [source, target];
        let farthest = sides.map(|points| points.rows().iter().map(squared_norm).fold(0.0, f64::max).sqrt());
        let farthest = farthest[0].max(farthest[1]);
        // A power of two, so that scaling is exact.
        let scale = if farthest > 0.0 { (-farthest.log2().ceil()).exp2() } else { 1.0 };
        let criterion = Criterion::new((tolerance * scale).min(BEYOND_ALL), farthest * scale);
        let mut blocks = vec![Block([[f32::NAN; BLOCK]; 8]); source.len().div_ceil(BLOCK)];
        for i in 0..source.len() {
            let [p, q] =
                sides.map(|points| <[f64; 3]>::from(points.get(i)).map(|value| (value * scale) as f32));
            // Of the rounded coordinates, whose distances they stand for.
            let [p_norm, q_norm] = [p, q].map(|point| squared_norm(&point.map(f64::from)) as f32);
            let terms = [p[0], p[1], p[2], q[0], q[1], q[2], p_norm, q_norm];
            for (term, value) in blocks[i / BLOCK].0.iter_mut().zip(terms) {
                term[i % BLOCK] = value;
            }
        }
        Self { source, target, tolerance, blocks, criterion }
    }

    /// Whether a pair agrees, in f64.
    #[inline]
    pub fn agree(&self, i: usize, j: usize) -> bool {
        distance_difference(self.source.distance(i, j), self.target.distance(i, j)) < self.tolerance
    }

    /// For each correspondence, how many others agree with it.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn counts(&self, execution: &Execution) -> Result<Vec<u32>> {
        let n = self.source.len();
        let height = n.div_ceil(BANDS).next_multiple_of(BLOCK).max(MIN_BAND);
        let bands: Vec<Range<usize>> =
            (0..n).step_by(height).map(|first| first..(first + height).min(n)).collect();
        execution.report(0, bands.len())?;
        let partial: Vec<Vec<u32>> =
            bands.par_iter().map(|band| self.band_counts(band, execution)).collect::<Result<_>>()?;
        let mut counts = vec![0; n];
        for (band, partial) in bands.iter().zip(&partial) {
            counts[band.start..].iter_mut().zip(partial).for_each(|(count, more)| *count += more);
        }
        Ok(counts)
    }

    /// What the rows of a band add to their own counts, and to those of all after them.
    fn band_counts(&self, band: &Range<usize>, execution: &Execution) -> Result<Vec<u32>> {
        let n = self.source.len();
        let mut counts = vec![0; n.next_multiple_of(BLOCK) - band.start];
        let rows = band.start..band.end.next_multiple_of(BLOCK);
        let mut ignored = vec![0; TILE];
        for first in rows.clone().step_by(TILE) {
            // Both of a pair are rows here, and so is the row itself, which agrees.
            let columns = first..(first + TILE).min(rows.end);
            for i in rows.clone().step_by(GROUP) {
                let inside = self.count_part(i, &columns, &mut ignored[..columns.len()]);
                for (row, inside) in (i..).zip(inside) {
                    counts[row - band.start] += inside - u32::from(columns.contains(&row) && row < n);
                }
            }
        }
        for first in (rows.end..n).step_by(TILE) {
            execution.check()?;
            let (own, after) = counts.split_at_mut(rows.len());
            let columns = first..(first + TILE).min(n.next_multiple_of(BLOCK));
            let mirrored = &mut after[first - rows.end..columns.end - rows.end];
            for (i, own) in rows.clone().step_by(GROUP).zip(own.chunks_exact_mut(GROUP)) {
                let inside = self.count_part(i, &columns, mirrored);
                own.iter_mut().zip(inside).for_each(|(count, more)| *count += more);
            }
        }
        counts.truncate(n - band.start);
        execution.advance()?;
        Ok(counts)
    }

    /// How many of the columns agree with each row of the group from `i` on; each that does counts one more
    /// in `mirrored`.
    fn count_part(&self, i: usize, columns: &Range<usize>, mirrored: &mut [u32]) -> [u32; GROUP] {
        let row =
            |i: usize| RowTerms::new(self.blocks[i / BLOCK].0.map(|term| term[i % BLOCK]), self.criterion);
        let rows = [row(i), row(i + 1), row(i + 2), row(i + 3)];
        let blocks = &self.blocks[columns.start / BLOCK..columns.end / BLOCK];
        let slack = self.criterion.slack;
        let count = CountInside { rows, blocks, slack, mirrored: &mut *mirrored };
        let Found { mut inside, unsure } = Arch::new().dispatch(count);
        for (row, mut strips) in unsure.into_iter().enumerate() {
            while strips != 0 {
                let first = strips.trailing_zeros() as usize * STRIP;
                strips &= strips - 1;
                let blocks = &blocks[first / BLOCK..columns.len().min(first + STRIP) / BLOCK];
                for (block, first) in blocks.iter().zip((first..).step_by(BLOCK)) {
                    let flags = Arch::new().dispatch(FlagUnsure { row: rows[row], block, slack });
                    if flags == [SURE; BLOCK] {
                        continue;
                    }
                    for (k, flag) in (first..).zip(flags).filter(|&(_, flag)| flag != SURE) {
                        let counted = u32::from(flag == COUNTED);
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

/// Flag of a pair that f32 can tell.
const SURE: u32 = 0;

/// Flag of a pair that was not counted, and may have to be.
const MISSED: u32 = 1;

/// Flag of a pair that was counted, and may not have to be.
const COUNTED: u32 = 2;

/// What a row has to do with the criterion's left side.
#[derive(Clone, Copy)]
struct RowTerms {
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

/// The same in every lane.
#[derive(Clone, Copy)]
struct RowLanes<S: Simd> {
    minus_twice: [S::f32s; 6],
    difference: S::f32s,
    minus_square: S::f32s,
    minus_twice_square: S::f32s,
    wide: S::f32s,
    narrow: S::f32s,
}

impl<S: Simd> RowLanes<S> {
    #[inline(always)]
    fn new(simd: S, row: RowTerms) -> Self {
        let [px, py, pz, qx, qy, qz] = row.minus_twice;
        Self {
            minus_twice: [
                simd.splat_f32s(px),
                simd.splat_f32s(py),
                simd.splat_f32s(pz),
                simd.splat_f32s(qx),
                simd.splat_f32s(qy),
                simd.splat_f32s(qz),
            ],
            difference: simd.splat_f32s(row.difference),
            minus_square: simd.splat_f32s(row.minus_square),
            minus_twice_square: simd.splat_f32s(2.0 * row.minus_square),
            wide: simd.splat_f32s(row.wide),
            narrow: simd.splat_f32s(row.narrow),
        }
    }

    /// The criterion's left side for several columns.
    #[inline(always)]
    fn left_side(&self, simd: S, [px, py, pz, qx, qy, qz, p_norm, q_norm]: &Terms<S::f32s>) -> S::f32s {
        let [x, y, z, u, v, w] = self.minus_twice;
        let a = simd.mul_add_e_f32s(*pz, z, *p_norm);
        let a = simd.mul_add_e_f32s(*px, x, simd.mul_add_e_f32s(*py, y, a));
        let b = simd.mul_add_e_f32s(*qz, w, *q_norm);
        let b = simd.mul_add_e_f32s(*qx, u, simd.mul_add_e_f32s(*qy, v, b));
        let difference = simd.add_f32s(simd.sub_f32s(a, b), self.difference);
        let sum = simd.add_f32s(a, b);
        let wide = simd.mul_add_e_f32s(sum, self.minus_twice_square, self.wide);
        let narrow = simd.mul_add_e_f32s(sum, self.minus_square, self.narrow);
        simd.mul_add_e_f32s(difference, difference, simd.min_f32s(wide, narrow))
    }
}

/// One vector's part of a block.
#[inline(always)]
fn part<S: Simd>(_: S, block: &Block, part: usize) -> Terms<S::f32s> {
    let [px, py, pz, qx, qy, qz, p_norm, q_norm] = &block.0;
    [
        S::as_simd_f32s(px).0[part],
        S::as_simd_f32s(py).0[part],
        S::as_simd_f32s(pz).0[part],
        S::as_simd_f32s(qx).0[part],
        S::as_simd_f32s(qy).0[part],
        S::as_simd_f32s(qz).0[part],
        S::as_simd_f32s(p_norm).0[part],
        S::as_simd_f32s(q_norm).0[part],
    ]
}

/// For each row, the columns that agree as far as f32 can tell, and one bit per strip: whether some of it
/// are too close to be sure.
struct Found {
    inside: [u32; GROUP],
    unsure: [u32; GROUP],
}

/// Counts the pairs that agree as far as f32 can tell.
struct CountInside<'a> {
    rows: [RowTerms; GROUP],
    blocks: &'a [Block],
    slack: f32,
    mirrored: &'a mut [u32],
}

impl WithSimd for CountInside<'_> {
    type Output = Found;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Found {
        let [row0, row1, row2, row3] = self.rows;
        let rows = [
            RowLanes::new(simd, row0),
            RowLanes::new(simd, row1),
            RowLanes::new(simd, row2),
            RowLanes::new(simd, row3),
        ];
        let (zero, one) = (simd.splat_u32s(0), simd.splat_u32s(1));
        let mut inside = [zero; GROUP];
        let mut unsure = [0; GROUP];
        let strips = self.blocks.chunks(STRIP / BLOCK).zip(self.mirrored.chunks_mut(STRIP));
        for (strip, (blocks, mirrored)) in strips.enumerate() {
            let mut least = [simd.splat_f32s(f32::INFINITY); GROUP];
            for (block, mirrored) in blocks.iter().zip(mirrored.as_chunks_mut::<BLOCK>().0) {
                let mirrored = S::as_mut_simd_u32s(mirrored).0;
                for (p, mirrored) in mirrored.iter_mut().enumerate() {
                    let columns = part(simd, block, p);
                    let mut sum = *mirrored;
                    for k in 0..GROUP {
                        let left = rows[k].left_side(simd, &columns);
                        let agrees = simd.less_than_f32s(left, simd.splat_f32s(0.0));
                        let counted = simd.select_u32s(agrees, one, zero);
                        inside[k] = simd.add_u32s(inside[k], counted);
                        sum = simd.add_u32s(sum, counted);
                        // NaN, which fills up the last block, comes first: the second is taken then.
                        least[k] = simd.min_f32s(simd.abs_f32s(left), least[k]);
                    }
                    *mirrored = sum;
                }
            }
            for k in 0..GROUP {
                unsure[k] |= u32::from(simd.reduce_min_f32s(least[k]) <= self.slack) << strip;
            }
        }
        let mut found = Found { inside: [0; GROUP], unsure };
        for (sum, lanes) in found.inside.iter_mut().zip(&inside) {
            *sum = bytemuck::cast_slice::<S::u32s, u32>(std::slice::from_ref(lanes)).iter().sum();
        }
        found
    }
}

/// Marks the columns of a block that f32 can't tell.
struct FlagUnsure<'a> {
    row: RowTerms,
    block: &'a Block,
    slack: f32,
}

impl WithSimd for FlagUnsure<'_> {
    type Output = [u32; BLOCK];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [u32; BLOCK] {
        let row = RowLanes::new(simd, self.row);
        let (zero, slack) = (simd.splat_f32s(0.0), simd.splat_f32s(self.slack));
        let (sure, missed, counted) =
            (simd.splat_u32s(SURE), simd.splat_u32s(MISSED), simd.splat_u32s(COUNTED));
        let mut flags = [SURE; BLOCK];
        for (p, flags) in S::as_mut_simd_u32s(&mut flags).0.iter_mut().enumerate() {
            let left = row.left_side(simd, &part(simd, self.block, p));
            let flag = simd.select_u32s(simd.less_than_f32s(left, zero), counted, missed);
            let near = simd.less_than_or_equal_f32s(simd.abs_f32s(left), slack);
            *flags = simd.select_u32s(near, flag, sure);
        }
        flags
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
            let agreement = DistanceAgreement::new(&source, &target, tolerance);
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
    fn pairs_at_the_very_tolerance_are_settled_in_f64() -> Result<()> {
        // On a line, differences are multiples of 0.1, some of them rounded up and some down.
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
