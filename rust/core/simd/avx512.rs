//! Groups as one register of 512 bits each: AVX-512.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use pulp::x86::V4;
use pulp::{Simd, cast, f32x8, f32x16, f64x8, u32x16};

use super::arithmetic::Arithmetic;
use super::lanes::{DOUBLES, Lanes, SINGLES};

/// Proof that the machine has AVX-512.
#[derive(Debug, Clone, Copy)]
pub struct Avx512(pub V4);

impl Arithmetic for Avx512 {
    #[inline(always)]
    fn multiply_add(self, a: f64, b: f64, c: f64) -> f64 {
        a.mul_add(b, c)
    }
}

impl Lanes for Avx512 {
    type Doubles = f64x8;

    #[inline(always)]
    fn splat_doubles(self, value: f64) -> Self::Doubles {
        self.0.splat_f64x8(value)
    }

    #[inline(always)]
    fn load_doubles(self, values: &[f64; DOUBLES]) -> Self::Doubles {
        cast(*values)
    }

    #[inline(always)]
    fn load_widened(self, values: &[f32; DOUBLES]) -> Self::Doubles {
        let narrow: f32x8 = cast(*values);
        cast(self.0.avx512f._mm512_cvtps_pd(cast(narrow)))
    }

    #[inline(always)]
    fn store_doubles(self, group: Self::Doubles, values: &mut [f64; DOUBLES]) {
        *values = cast(group);
    }

    #[inline(always)]
    fn multiply_add_doubles(self, a: Self::Doubles, b: Self::Doubles, c: Self::Doubles) -> Self::Doubles {
        self.0.mul_add_f64x8(a, b, c)
    }

    type Singles = f32x16;

    #[inline(always)]
    fn splat_singles(self, value: f32) -> Self::Singles {
        self.0.splat_f32x16(value)
    }

    #[inline(always)]
    fn load_singles(self, values: &[f32; SINGLES]) -> Self::Singles {
        cast(*values)
    }

    #[inline(always)]
    fn load_u16(self, values: &[u16; SINGLES]) -> Self::Singles {
        let values: pulp::u16x16 = cast(*values);
        cast(self.0.avx512f._mm512_cvtepi32_ps(self.0.avx512f._mm512_cvtepu16_epi32(cast(values))))
    }

    #[inline(always)]
    fn store_singles(self, group: Self::Singles, values: &mut [f32; SINGLES]) {
        *values = cast(group);
    }

    #[inline(always)]
    fn add_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        self.0.add_f32x16(a, b)
    }

    #[inline(always)]
    fn subtract_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        self.0.sub_f32x16(a, b)
    }

    #[inline(always)]
    fn multiply_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        self.0.mul_f32x16(a, b)
    }

    #[inline(always)]
    fn multiply_add_singles(self, a: Self::Singles, b: Self::Singles, c: Self::Singles) -> Self::Singles {
        self.0.mul_add_f32x16(a, b, c)
    }

    #[inline(always)]
    fn min_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        self.0.min_f32x16(a, b)
    }

    #[inline(always)]
    fn absolute_singles(self, a: Self::Singles) -> Self::Singles {
        self.0.abs_f32x16(a)
    }

    #[inline(always)]
    fn at_most(self, a: Self::Singles, b: Self::Singles) -> u16 {
        self.0.cmp_le_f32x16(a, b).0
    }

    #[inline(always)]
    fn sum_singles(self, a: Self::Singles) -> f32 {
        self.0.reduce_sum_f32s(a)
    }

    #[inline(always)]
    fn estimate_reciprocal_sqrt(self, a: Self::Singles) -> Self::Singles {
        cast(self.0.avx512f._mm512_rsqrt14_ps(cast(a)))
    }

    type Counts = u32x16;

    #[inline(always)]
    fn load_counts(self, values: &[u32; SINGLES]) -> Self::Counts {
        cast(*values)
    }

    #[inline(always)]
    fn store_counts(self, counts: Self::Counts, values: &mut [u32; SINGLES]) {
        *values = cast(counts);
    }

    #[inline(always)]
    fn ones_where_below(self, a: Self::Singles, b: Self::Singles) -> Self::Counts {
        let (one, zero) = (self.0.splat_u32x16(1), self.0.splat_u32x16(0));
        self.0.select_u32x16(self.0.cmp_lt_f32x16(a, b), one, zero)
    }

    #[inline(always)]
    fn add_counts(self, a: Self::Counts, b: Self::Counts) -> Self::Counts {
        self.0.wrapping_add_u32x16(a, b)
    }
}
