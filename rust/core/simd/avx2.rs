//! Groups as two registers of 256 bits each: AVX2 with FMA.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use pulp::x86::V3;
use pulp::{Simd, cast, f32x8, f64x4, u32x8};

use super::arithmetic::Arithmetic;
use super::lanes::{DOUBLES, Lanes, SINGLES};

/// Proof that the machine has AVX2 and FMA.
#[derive(Debug, Clone, Copy)]
pub struct Avx2(pub V3);

impl Arithmetic for Avx2 {
    #[inline(always)]
    fn multiply_add(self, a: f64, b: f64, c: f64) -> f64 {
        a.mul_add(b, c)
    }
}

impl Lanes for Avx2 {
    type Doubles = [f64x4; 2];

    #[inline(always)]
    fn splat_doubles(self, value: f64) -> Self::Doubles {
        [self.0.splat_f64x4(value); 2]
    }

    #[inline(always)]
    fn load_doubles(self, values: &[f64; DOUBLES]) -> Self::Doubles {
        cast(*values)
    }

    #[inline(always)]
    fn load_widened(self, values: &[f32; DOUBLES]) -> Self::Doubles {
        let halves: [pulp::f32x4; 2] = cast(*values);
        halves.map(
            #[inline(always)]
            |half| cast(self.0.avx._mm256_cvtps_pd(cast(half))),
        )
    }

    #[inline(always)]
    fn store_doubles(self, group: Self::Doubles, values: &mut [f64; DOUBLES]) {
        *values = cast(group);
    }

    #[inline(always)]
    fn multiply_add_doubles(self, a: Self::Doubles, b: Self::Doubles, c: Self::Doubles) -> Self::Doubles {
        [self.0.mul_add_f64x4(a[0], b[0], c[0]), self.0.mul_add_f64x4(a[1], b[1], c[1])]
    }

    type Singles = [f32x8; 2];

    #[inline(always)]
    fn splat_singles(self, value: f32) -> Self::Singles {
        [self.0.splat_f32x8(value); 2]
    }

    #[inline(always)]
    fn load_singles(self, values: &[f32; SINGLES]) -> Self::Singles {
        cast(*values)
    }

    #[inline(always)]
    fn load_u16(self, values: &[u16; SINGLES]) -> Self::Singles {
        let halves: [pulp::u16x8; 2] = cast(*values);
        [
            cast(self.0.avx._mm256_cvtepi32_ps(self.0.avx2._mm256_cvtepu16_epi32(cast(halves[0])))),
            cast(self.0.avx._mm256_cvtepi32_ps(self.0.avx2._mm256_cvtepu16_epi32(cast(halves[1])))),
        ]
    }

    #[inline(always)]
    fn store_singles(self, group: Self::Singles, values: &mut [f32; SINGLES]) {
        *values = cast(group);
    }

    #[inline(always)]
    fn add_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        [self.0.add_f32x8(a[0], b[0]), self.0.add_f32x8(a[1], b[1])]
    }

    #[inline(always)]
    fn subtract_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        [self.0.sub_f32x8(a[0], b[0]), self.0.sub_f32x8(a[1], b[1])]
    }

    #[inline(always)]
    fn multiply_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        [self.0.mul_f32x8(a[0], b[0]), self.0.mul_f32x8(a[1], b[1])]
    }

    #[inline(always)]
    fn multiply_add_singles(self, a: Self::Singles, b: Self::Singles, c: Self::Singles) -> Self::Singles {
        [self.0.mul_add_f32x8(a[0], b[0], c[0]), self.0.mul_add_f32x8(a[1], b[1], c[1])]
    }

    #[inline(always)]
    fn min_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        [self.0.min_f32x8(a[0], b[0]), self.0.min_f32x8(a[1], b[1])]
    }

    #[inline(always)]
    fn absolute_singles(self, a: Self::Singles) -> Self::Singles {
        [self.0.abs_f32x8(a[0]), self.0.abs_f32x8(a[1])]
    }

    #[inline(always)]
    fn at_most(self, a: Self::Singles, b: Self::Singles) -> u16 {
        let low = self.0.avx._mm256_movemask_ps(cast(self.0.cmp_le_f32x8(a[0], b[0]))) as u16;
        let high = self.0.avx._mm256_movemask_ps(cast(self.0.cmp_le_f32x8(a[1], b[1]))) as u16;
        low | high << (SINGLES / 2)
    }

    #[inline(always)]
    fn sum_singles(self, a: Self::Singles) -> f32 {
        self.0.reduce_sum_f32s(self.0.add_f32x8(a[0], a[1]))
    }

    #[inline(always)]
    fn estimate_reciprocal_sqrt(self, a: Self::Singles) -> Self::Singles {
        [cast(self.0.avx._mm256_rsqrt_ps(cast(a[0]))), cast(self.0.avx._mm256_rsqrt_ps(cast(a[1])))]
    }

    type Counts = [u32x8; 2];

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
        let (one, zero) = (self.0.splat_u32x8(1), self.0.splat_u32x8(0));
        let below = [self.0.cmp_lt_f32x8(a[0], b[0]), self.0.cmp_lt_f32x8(a[1], b[1])];
        [self.0.select_u32x8(below[0], one, zero), self.0.select_u32x8(below[1], one, zero)]
    }

    #[inline(always)]
    fn add_counts(self, a: Self::Counts, b: Self::Counts) -> Self::Counts {
        [self.0.wrapping_add_u32x8(a[0], b[0]), self.0.wrapping_add_u32x8(a[1], b[1])]
    }
}
