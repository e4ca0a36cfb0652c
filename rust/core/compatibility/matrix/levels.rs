//! Scores rounded to 16 bits, with the rows of a group interleaved, and f32 products with them.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use super::products::{Entry, ROW_GROUP};
use crate::simd::{self, Kernel, Lanes, SINGLES};

/// Level of a score of 1; scores are rounded to multiples of the inverse.
pub const LEVELS: f32 = 65535.0;

/// Added to a number below 2^16, it places the nearest integer in the lowest bits of the sum.
const ROUND: f32 = 8_388_608.0;

/// Entries of the vector below this count as 0: their products may be subnormal, which is slow.
const NEGLIGIBLE: f64 = 1e-30;

/// Contiguous entries of [`ROW_GROUP`] rows: [`SINGLES`] columns of the first, then of the second, ...
const INTERLEAVED: usize = ROW_GROUP * SINGLES;

/// Rounds the scores of one row of a group, and scatters them into the group's entries.
pub fn interleave(scores: &[f32], row: usize, entries: &mut [u16]) {
    simd::run(Interleave { scores, row, groups: entries.as_chunks_mut().0 });
}

struct Interleave<'a> {
    scores: &'a [f32],
    row: usize,
    groups: &'a mut [[u16; INTERLEAVED]],
}

impl Kernel for Interleave<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let (levels, round) = (lanes.splat_singles(LEVELS), lanes.splat_singles(ROUND));
        for (scores, group) in self.scores.as_chunks::<SINGLES>().0.iter().zip(self.groups) {
            let mut sums = [0.0; SINGLES];
            lanes.store_singles(
                lanes.multiply_add_singles(lanes.load_singles(scores), levels, round),
                &mut sums,
            );
            for (entry, sum) in group.as_chunks_mut::<SINGLES>().0[self.row].iter_mut().zip(sums) {
                *entry = sum.to_bits() as u16;
            }
        }
    }
}

/// Sums whole groups of columns in f32: the caller adds short sums in f64.
impl Entry for u16 {
    type Number = f32;

    fn number(value: f64) -> f32 {
        if value.abs() < NEGLIGIBLE { 0.0 } else { value as f32 }
    }

    fn add_products(
        rows: &[Self],
        x: &[f32],
        weights: [f32; ROW_GROUP],
        mirrored: &mut [f32],
    ) -> [f64; ROW_GROUP] {
        simd::run(LevelsTimesVector { entries: rows, x, weights, mirrored: &mut mirrored[..x.len()] })
    }
}

struct LevelsTimesVector<'a> {
    /// [`INTERLEAVED`] entries for every group of columns.
    entries: &'a [u16],
    /// The vector at the rows' columns.
    x: &'a [f32],
    /// The vector at the rows themselves.
    weights: [f32; ROW_GROUP],
    /// The product at the rows' columns.
    mirrored: &'a mut [f32],
}

impl Kernel for LevelsTimesVector<'_> {
    type Output = [f64; ROW_GROUP];

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) -> Self::Output {
        let x_groups = self.x.as_chunks::<SINGLES>().0;
        let below_groups = self.mirrored.as_chunks_mut::<SINGLES>().0;
        let [w0, w1, w2, w3] = self.weights;
        let (w0, w1) = (lanes.splat_singles(w0), lanes.splat_singles(w1));
        let (w2, w3) = (lanes.splat_singles(w2), lanes.splat_singles(w3));
        let [mut s0, mut s1, mut s2, mut s3] = [lanes.splat_singles(0.0); ROW_GROUP];
        let groups = self.entries.as_chunks::<INTERLEAVED>().0;
        for ((x, below), entries) in x_groups.iter().zip(below_groups).zip(groups) {
            let [e0, e1, e2, e3] = entries.as_chunks::<SINGLES>().0 else { continue };
            let (factor, mut sum) = (lanes.load_singles(x), lanes.load_singles(below));
            let e0 = lanes.load_u16(e0);
            s0 = lanes.multiply_add_singles(e0, factor, s0);
            sum = lanes.multiply_add_singles(e0, w0, sum);
            let e1 = lanes.load_u16(e1);
            s1 = lanes.multiply_add_singles(e1, factor, s1);
            sum = lanes.multiply_add_singles(e1, w1, sum);
            let e2 = lanes.load_u16(e2);
            s2 = lanes.multiply_add_singles(e2, factor, s2);
            sum = lanes.multiply_add_singles(e2, w2, sum);
            let e3 = lanes.load_u16(e3);
            s3 = lanes.multiply_add_singles(e3, factor, s3);
            sum = lanes.multiply_add_singles(e3, w3, sum);
            lanes.store_singles(sum, below);
        }
        // Written out: mapping an array of registers would keep it in memory throughout the loop.
        [
            f64::from(lanes.sum_singles(s0)),
            f64::from(lanes.sum_singles(s1)),
            f64::from(lanes.sum_singles(s2)),
            f64::from(lanes.sum_singles(s3)),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_times_vector_equal_plain_sums() {
        let columns = 5 * SINGLES;
        let score = |row: usize, j: usize| ((row * 31 + j * 17) % 97) as f32 / 97.0;
        let mut entries = vec![0; ROW_GROUP * columns];
        for row in 0..ROW_GROUP {
            interleave(&(0..columns).map(|j| score(row, j)).collect::<Vec<_>>(), row, &mut entries);
        }
        let x: Vec<f32> = (0..columns).map(|j| (0.9 * j as f32).sin()).collect();
        let (weights, mut mirrored) = ([1.0, -2.0, 0.5, 4.0], vec![3.0; columns]);
        let sums = u16::add_products(&entries, &x, weights, &mut mirrored);
        let level = |row: usize, j: usize| (score(row, j) * LEVELS).round();
        for (row, total) in sums.iter().enumerate() {
            let plain: f64 = (0..columns).map(|j| f64::from(level(row, j)) * f64::from(x[j])).sum();
            assert!((total - plain).abs() < 1e-6 * f64::from(LEVELS) * columns as f64, "{total} {plain}");
        }
        for (j, below) in mirrored.iter().enumerate() {
            let plain: f32 = (0..ROW_GROUP).map(|row| level(row, j) * weights[row]).sum();
            assert!((below - 3.0 - plain).abs() < 1e-6 * 8.0 * LEVELS, "{below} {plain}");
        }
    }
}
