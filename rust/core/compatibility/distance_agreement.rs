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

/// Columns of a tile: its coordinates and counts fit the first-level cache.
const TILE: usize = 1024;

/// Bands are whole multiples of this many rows, so that tiles start at whole vectors of any width.
const ROW_STEP: usize = 16;

/// Fewest rows of a band.
const MIN_BAND: usize = 64;

/// Bands that the rows are cut into, for the threads to share.
const BANDS: usize = 64;

/// Half a unit in the last place of 1 in f32.
const ROUNDING: f64 = f32::EPSILON as f64 / 2.0;

/// No difference of lengths reaches this many diagonals of the bounding box.
const BEYOND_ALL: f64 = 4.0;

/// The test `|ds - dt| < tolerance` on pairs of correspondences.
#[derive(Debug)]
pub struct DistanceAgreement<'a> {
    source: &'a Points,
    target: &'a Points,
    tolerance: f64,
    /// Source x, y, z, then target x, y, z, scaled to about 1; filled up with NaN, which agrees with nothing.
    axes: [Vec<f32>; 6],
    criterion: Criterion,
}

/// With a, b the squared lengths and t the tolerance: `|sqrt a - sqrt b| < t` exactly if
/// `s |s| - 4 a b < 0`, where `s = a + b - t^2`. In f32 the left side is off by no more than
/// `g (quadratic g + linear)`, where `g = a + b + t^2`:
///
/// - scaled coordinates are below 1.5, so rounding them shifts a length by less than 16 roundings, and
///   the difference of two lengths by less than 32; that moves the left side by `4 t |s|` times as much;
/// - evaluating it adds less than 16 roundings of `g^2`.
#[derive(Debug, Clone, Copy)]
struct Criterion {
    squared_tolerance: f32,
    quadratic: f32,
    linear: f32,
}

impl Criterion {
    fn new(tolerance: f64) -> Self {
        Self {
            squared_tolerance: (tolerance * tolerance) as f32,
            quadratic: (32.0 * ROUNDING) as f32,
            linear: (256.0 * ROUNDING * tolerance) as f32,
        }
    }
}

impl<'a> DistanceAgreement<'a> {
    /// Of matched points; the tolerance is a length in their unit.
    pub fn new(source: &'a Points, target: &'a Points, tolerance: f64) -> Self {
        let extent = source.diagonal().max(target.diagonal());
        // A power of two, so that scaling is exact.
        let scale = if extent > 0.0 { (-extent.log2().round()).exp2() } else { 1.0 };
        let padded = source.len().next_multiple_of(TILE) + TILE;
        let axis = |values: &Vec<f64>| {
            let mut scaled: Vec<f32> = values.iter().map(|value| (value * scale) as f32).collect();
            scaled.resize(padded, f32::NAN);
            scaled
        };
        let axes = [&source.x, &source.y, &source.z, &target.x, &target.y, &target.z].map(axis);
        let criterion = Criterion::new((tolerance * scale).min(BEYOND_ALL));
        Self { source, target, tolerance, axes, criterion }
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
        let height = n.div_ceil(BANDS).next_multiple_of(ROW_STEP).max(MIN_BAND);
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
        let mut counts = vec![0; n.next_multiple_of(TILE) + TILE - band.start];
        let square_end = band.end.next_multiple_of(ROW_STEP);
        let mut ignored = vec![0; TILE];
        for first in (band.start..square_end).step_by(TILE) {
            let columns = first..(first + TILE).min(square_end);
            for i in band.clone() {
                // Both of a pair are rows here; a correspondence agrees with itself.
                let inside = self.count_part(i, &columns, &mut ignored[..columns.len()]);
                counts[i - band.start] += inside - u32::from(columns.contains(&i));
            }
        }
        for first in (square_end..n).step_by(TILE) {
            execution.check()?;
            let (own, after) = counts.split_at_mut(square_end - band.start);
            let mirrored = &mut after[first - square_end..first - square_end + TILE];
            for (i, count) in band.clone().zip(own) {
                *count += self.count_part(i, &(first..first + TILE), mirrored);
            }
        }
        counts.truncate(n - band.start);
        execution.advance()?;
        Ok(counts)
    }

    /// How many of the columns agree with row `i`; each that does counts one more in `mirrored`.
    fn count_part(&self, i: usize, columns: &Range<usize>, mirrored: &mut [u32]) -> u32 {
        let axes = [0, 1, 2, 3, 4, 5].map(|axis| &self.axes[axis][columns.clone()]);
        let point = [0, 1, 2, 3, 4, 5].map(|axis| self.axes[axis][i]);
        let row = Row { point, axes, criterion: self.criterion };
        let found = Arch::new().dispatch(CountInside { row, mirrored: &mut *mirrored });
        let mut count = found.inside;
        if found.unsure {
            let mut flags = [NEAR_NEITHER; TILE];
            let flags = &mut flags[..columns.len()];
            Arch::new().dispatch(FlagUnsure { row, flags: &mut *flags });
            for (k, flag) in flags.iter().enumerate().filter(|&(_, &flag)| flag != NEAR_NEITHER) {
                let (counted, agrees) =
                    (u32::from(*flag == NEAR_INSIDE), u32::from(self.agree(i, columns.start + k)));
                count = count + agrees - counted;
                mirrored[k] = mirrored[k] + agrees - counted;
            }
        }
        count
    }
}

/// Flag of a pair that f32 can tell.
const NEAR_NEITHER: u32 = 0;

/// Flag of a pair that f32 took to disagree, too close to be sure.
const NEAR_OUTSIDE: u32 = 1;

/// Flag of a pair that f32 took to agree, too close to be sure.
const NEAR_INSIDE: u32 = 2;

/// A correspondence and the ones it is compared with.
#[derive(Clone, Copy)]
struct Row<'a> {
    point: [f32; 6],
    axes: [&'a [f32]; 6],
    criterion: Criterion,
}

/// The left side of the criterion, and how far off it may be.
struct Decision<S: Simd> {
    left: S::f32s,
    slack: S::f32s,
}

impl Row<'_> {
    /// In whole vectors; bands and tiles are cut so that nothing is left over.
    #[inline(always)]
    fn decisions<S: Simd>(self, simd: S, mut each: impl FnMut(usize, Decision<S>)) {
        let [px, py, pz, qx, qy, qz] = self.point.map(
            #[inline(always)]
            |value| simd.splat_f32s(value),
        );
        let [xs, ys, zs, us, vs, ws] = self.axes.map(
            #[inline(always)]
            |axis| S::as_simd_f32s(axis).0,
        );
        let squared_tolerance = simd.splat_f32s(self.criterion.squared_tolerance);
        let quadratic = simd.splat_f32s(self.criterion.quadratic);
        let linear = simd.splat_f32s(self.criterion.linear);
        let minus_four = simd.splat_f32s(-4.0);
        let columns = xs.iter().zip(ys).zip(zs).zip(us).zip(vs).zip(ws).enumerate();
        for (k, (((((x, y), z), u), v), w)) in columns {
            let (dx, dy, dz) = (simd.sub_f32s(*x, px), simd.sub_f32s(*y, py), simd.sub_f32s(*z, pz));
            let (du, dv, dw) = (simd.sub_f32s(*u, qx), simd.sub_f32s(*v, qy), simd.sub_f32s(*w, qz));
            let a = simd.mul_add_e_f32s(dx, dx, simd.mul_add_e_f32s(dy, dy, simd.mul_f32s(dz, dz)));
            let b = simd.mul_add_e_f32s(du, du, simd.mul_add_e_f32s(dv, dv, simd.mul_f32s(dw, dw)));
            let sum = simd.add_f32s(a, b);
            let s = simd.sub_f32s(sum, squared_tolerance);
            let g = simd.add_f32s(sum, squared_tolerance);
            let signed_square = simd.mul_f32s(s, simd.abs_f32s(s));
            let left = simd.mul_add_e_f32s(a, simd.mul_f32s(b, minus_four), signed_square);
            let slack = simd.mul_f32s(g, simd.mul_add_e_f32s(g, quadratic, linear));
            each(k, Decision { left, slack });
        }
    }
}

/// Pairs that agree as far as f32 can tell, and whether some are too close to be sure.
struct Found {
    inside: u32,
    unsure: bool,
}

/// Counts the pairs that agree as far as f32 can tell.
struct CountInside<'a> {
    row: Row<'a>,
    mirrored: &'a mut [u32],
}

impl WithSimd for CountInside<'_> {
    type Output = Found;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Found {
        let mirrored = S::as_mut_simd_u32s(self.mirrored).0;
        let (zero, one) = (simd.splat_u32s(0), simd.splat_u32s(1));
        let mut inside = zero;
        let mut least_margin = simd.splat_f32s(f32::INFINITY);
        self.row.decisions(
            simd,
            #[inline(always)]
            |k, Decision { left, slack }| {
                let counted = simd.select_u32s(simd.less_than_f32s(left, simd.splat_f32s(0.0)), one, zero);
                inside = simd.add_u32s(inside, counted);
                mirrored[k] = simd.add_u32s(mirrored[k], counted);
                // NaN, which fills up the last tile, is the first operand: the second is taken then.
                least_margin = simd.min_f32s(simd.sub_f32s(simd.abs_f32s(left), slack), least_margin);
            },
        );
        let lanes: &[u32] = bytemuck::cast_slice(std::slice::from_ref(&inside));
        Found { inside: lanes.iter().sum(), unsure: simd.reduce_min_f32s(least_margin) <= 0.0 }
    }
}

/// Marks the pairs that f32 can't tell.
struct FlagUnsure<'a> {
    row: Row<'a>,
    flags: &'a mut [u32],
}

impl WithSimd for FlagUnsure<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let flags = S::as_mut_simd_u32s(self.flags).0;
        let [neither, outside, inside] =
            [NEAR_NEITHER, NEAR_OUTSIDE, NEAR_INSIDE].map(|flag| simd.splat_u32s(flag));
        let zero = simd.splat_f32s(0.0);
        self.row.decisions(
            simd,
            #[inline(always)]
            |k, Decision { left, slack }| {
                let side = simd.select_u32s(simd.less_than_f32s(left, zero), inside, outside);
                let near = simd.less_than_or_equal_f32s(simd.sub_f32s(simd.abs_f32s(left), slack), zero);
                flags[k] = simd.select_u32s(near, side, neither);
            },
        );
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
