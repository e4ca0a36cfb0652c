//! Groups as plain arrays, which the compiler maps to the registers of the baseline (SSE2, NEON).

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use super::arithmetic::Arithmetic;
use super::lanes::{DOUBLES, Lanes, SINGLES};

/// Plain arrays.
#[derive(Debug, Clone, Copy)]
pub struct Portable;

impl Arithmetic for Portable {
    #[inline(always)]
    fn multiply_add(self, a: f64, b: f64, c: f64) -> f64 {
        // Every 64-bit ARM has the instruction; elsewhere a fused product is a slow function call.
        if cfg!(target_arch = "aarch64") { a.mul_add(b, c) } else { a * b + c }
    }
}

impl Lanes for Portable {
    type Doubles = [f64; DOUBLES];

    #[inline(always)]
    fn splat_doubles(self, value: f64) -> Self::Doubles {
        [value; DOUBLES]
    }

    #[inline(always)]
    fn load_doubles(self, values: &[f64; DOUBLES]) -> Self::Doubles {
        *values
    }

    #[inline(always)]
    fn load_widened(self, values: &[f32; DOUBLES]) -> Self::Doubles {
        values.map(f64::from)
    }

    #[inline(always)]
    fn store_doubles(self, group: Self::Doubles, values: &mut [f64; DOUBLES]) {
        *values = group;
    }

    #[inline(always)]
    fn multiply_add_doubles(self, a: Self::Doubles, b: Self::Doubles, c: Self::Doubles) -> Self::Doubles {
        std::array::from_fn(|lane| a[lane] * b[lane] + c[lane])
    }

    type Singles = [f32; SINGLES];

    #[inline(always)]
    fn splat_singles(self, value: f32) -> Self::Singles {
        [value; SINGLES]
    }

    #[inline(always)]
    fn load_singles(self, values: &[f32; SINGLES]) -> Self::Singles {
        *values
    }

    #[inline(always)]
    fn load_u16(self, values: &[u16; SINGLES]) -> Self::Singles {
        values.map(f32::from)
    }

    #[inline(always)]
    fn store_singles(self, group: Self::Singles, values: &mut [f32; SINGLES]) {
        *values = group;
    }

    #[inline(always)]
    fn add_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        std::array::from_fn(|lane| a[lane] + b[lane])
    }

    #[inline(always)]
    fn subtract_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        std::array::from_fn(|lane| a[lane] - b[lane])
    }

    #[inline(always)]
    fn multiply_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        std::array::from_fn(|lane| a[lane] * b[lane])
    }

    #[inline(always)]
    fn multiply_add_singles(self, a: Self::Singles, b: Self::Singles, c: Self::Singles) -> Self::Singles {
        std::array::from_fn(|lane| a[lane] * b[lane] + c[lane])
    }

    #[inline(always)]
    fn min_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        std::array::from_fn(|lane| a[lane].min(b[lane]))
    }

    #[inline(always)]
    fn absolute_singles(self, a: Self::Singles) -> Self::Singles {
        a.map(f32::abs)
    }

    #[inline(always)]
    fn at_most(self, a: Self::Singles, b: Self::Singles) -> u16 {
        (0..SINGLES).fold(0, |bits, lane| bits | u16::from(a[lane] <= b[lane]) << lane)
    }

    #[inline(always)]
    fn sum_singles(self, a: Self::Singles) -> f32 {
        let (low, high) = a.split_at(SINGLES / 2);
        low.iter().zip(high).map(|(low, high)| low + high).sum()
    }

    #[inline(always)]
    fn estimate_reciprocal_sqrt(self, a: Self::Singles) -> Self::Singles {
        a.map(|value| value.sqrt().recip())
    }

    type Counts = [u32; SINGLES];

    #[inline(always)]
    fn load_counts(self, values: &[u32; SINGLES]) -> Self::Counts {
        *values
    }

    #[inline(always)]
    fn store_counts(self, counts: Self::Counts, values: &mut [u32; SINGLES]) {
        *values = counts;
    }

    #[inline(always)]
    fn ones_where_below(self, a: Self::Singles, b: Self::Singles) -> Self::Counts {
        std::array::from_fn(|lane| u32::from(a[lane] < b[lane]))
    }

    #[inline(always)]
    fn add_counts(self, a: Self::Counts, b: Self::Counts) -> Self::Counts {
        std::array::from_fn(|lane| a[lane] + b[lane])
    }
}
