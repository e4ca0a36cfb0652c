//! Eight numbers in f64, or sixteen in f32, at a time, in the widest registers that the machine has.
//!
//! For the loops that the compiler does not turn into vector code by itself. [`with_lanes`] chooses at
//! run time between AVX-512, AVX2 with FMA, and plain arrays, which the compiler maps to the baseline's
//! registers (SSE2, NEON). There is no `unsafe` here: pulp's tokens prove that the instructions exist.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use pulp::Arch;
#[cfg(target_arch = "x86_64")]
use pulp::{Simd, cast, f32x8, f32x16, f64x4, f64x8};

/// Numbers in a group of f64.
pub const LANES: usize = 8;

/// Numbers in a group of f32.
pub const SINGLES: usize = 16;

/// Arithmetic on groups of [`LANES`] numbers in f64, and of [`SINGLES`] in f32.
pub trait Lanes: Copy {
    /// A group in registers.
    type Group: Copy;
    /// The same number in every lane.
    fn splat(self, value: f64) -> Self::Group;
    /// From memory.
    fn load(self, values: &[f64; LANES]) -> Self::Group;
    /// From memory, widened.
    fn load_f32(self, values: &[f32; LANES]) -> Self::Group;
    /// To memory.
    fn store(self, group: Self::Group, values: &mut [f64; LANES]);
    /// `a b + c`, rounded once where the machine can.
    fn multiply_add(self, a: Self::Group, b: Self::Group, c: Self::Group) -> Self::Group;

    /// A group of f32 in registers.
    type Singles: Copy;
    /// The same number in every lane.
    fn splat_singles(self, value: f32) -> Self::Singles;
    /// From memory.
    fn load_singles(self, values: &[f32; SINGLES]) -> Self::Singles;
    /// From memory, converted.
    fn load_u16(self, values: &[u16; SINGLES]) -> Self::Singles;
    /// To memory.
    fn store_singles(self, group: Self::Singles, values: &mut [f32; SINGLES]);
    /// `a - b`.
    fn subtract_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles;
    /// `a b`.
    fn multiply_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles;
    /// `a b + c`, rounded once where the machine can.
    fn multiply_add_singles(self, a: Self::Singles, b: Self::Singles, c: Self::Singles) -> Self::Singles;
    /// The lesser of two.
    fn min_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles;
    /// The greater of two.
    fn max_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles;
    /// One bit per lane: whether `a <= b`.
    fn at_most_singles(self, a: Self::Singles, b: Self::Singles) -> u16;
    /// Sum of all lanes.
    fn sum_singles(self, a: Self::Singles) -> f32;
    /// `1 / sqrt(a)` to 11 bits or more, for normal positive numbers.
    fn estimate_reciprocal_sqrt(self, a: Self::Singles) -> Self::Singles;

    /// `1 / sqrt(a)` to 22 bits or more, for normal positive numbers: one Newton step from the estimate.
    #[inline(always)]
    fn reciprocal_sqrt(self, a: Self::Singles) -> Self::Singles {
        let y = self.estimate_reciprocal_sqrt(a);
        let half = self.multiply_singles(self.splat_singles(-0.5), a);
        let correction =
            self.multiply_add_singles(self.multiply_singles(half, y), y, self.splat_singles(1.5));
        self.multiply_singles(y, correction)
    }
}

/// Work that is compiled once for every kind of [`Lanes`].
pub trait LaneWork {
    /// What it results in.
    type Output;
    /// Does the work; has to be `#[inline(always)]`.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// Does the work with the best lanes of this machine.
#[inline(always)]
pub fn with_lanes<W: LaneWork>(work: W) -> W::Output {
    match Arch::new() {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(simd) => simd.vectorize(
            #[inline(always)]
            || work.run(Avx512(simd)),
        ),
        #[cfg(target_arch = "x86_64")]
        Arch::V3(simd) => simd.vectorize(
            #[inline(always)]
            || work.run(Avx2(simd)),
        ),
        _ => work.run(Portable),
    }
}

/// Plain arrays.
#[derive(Debug, Clone, Copy)]
pub struct Portable;

impl Lanes for Portable {
    type Group = [f64; LANES];

    #[inline(always)]
    fn splat(self, value: f64) -> Self::Group {
        [value; LANES]
    }

    #[inline(always)]
    fn load(self, values: &[f64; LANES]) -> Self::Group {
        *values
    }

    #[inline(always)]
    fn load_f32(self, values: &[f32; LANES]) -> Self::Group {
        values.map(f64::from)
    }

    #[inline(always)]
    fn store(self, group: Self::Group, values: &mut [f64; LANES]) {
        *values = group;
    }

    #[inline(always)]
    fn multiply_add(self, a: Self::Group, b: Self::Group, c: Self::Group) -> Self::Group {
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
    fn max_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        std::array::from_fn(|lane| a[lane].max(b[lane]))
    }

    #[inline(always)]
    fn at_most_singles(self, a: Self::Singles, b: Self::Singles) -> u16 {
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
}

/// Two registers of 256 bits.
#[cfg(target_arch = "x86_64")]
#[derive(Debug, Clone, Copy)]
pub struct Avx2(pub pulp::x86::V3);

#[cfg(target_arch = "x86_64")]
impl Lanes for Avx2 {
    type Group = [f64x4; 2];

    #[inline(always)]
    fn splat(self, value: f64) -> Self::Group {
        [self.0.splat_f64x4(value); 2]
    }

    #[inline(always)]
    fn load(self, values: &[f64; LANES]) -> Self::Group {
        cast(*values)
    }

    #[inline(always)]
    fn load_f32(self, values: &[f32; LANES]) -> Self::Group {
        let halves: [pulp::f32x4; 2] = cast(*values);
        halves.map(
            #[inline(always)]
            |half| cast(self.0.avx._mm256_cvtps_pd(cast(half))),
        )
    }

    #[inline(always)]
    fn store(self, group: Self::Group, values: &mut [f64; LANES]) {
        *values = cast(group);
    }

    #[inline(always)]
    fn multiply_add(self, a: Self::Group, b: Self::Group, c: Self::Group) -> Self::Group {
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
    fn max_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        [self.0.max_f32x8(a[0], b[0]), self.0.max_f32x8(a[1], b[1])]
    }

    #[inline(always)]
    fn at_most_singles(self, a: Self::Singles, b: Self::Singles) -> u16 {
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
}

/// One register of 512 bits.
#[cfg(target_arch = "x86_64")]
#[derive(Debug, Clone, Copy)]
pub struct Avx512(pub pulp::x86::V4);

#[cfg(target_arch = "x86_64")]
impl Lanes for Avx512 {
    type Group = f64x8;

    #[inline(always)]
    fn splat(self, value: f64) -> Self::Group {
        self.0.splat_f64x8(value)
    }

    #[inline(always)]
    fn load(self, values: &[f64; LANES]) -> Self::Group {
        cast(*values)
    }

    #[inline(always)]
    fn load_f32(self, values: &[f32; LANES]) -> Self::Group {
        let narrow: f32x8 = cast(*values);
        cast(self.0.avx512f._mm512_cvtps_pd(cast(narrow)))
    }

    #[inline(always)]
    fn store(self, group: Self::Group, values: &mut [f64; LANES]) {
        *values = cast(group);
    }

    #[inline(always)]
    fn multiply_add(self, a: Self::Group, b: Self::Group, c: Self::Group) -> Self::Group {
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
    fn max_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles {
        self.0.max_f32x16(a, b)
    }

    #[inline(always)]
    fn at_most_singles(self, a: Self::Singles, b: Self::Singles) -> u16 {
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
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every operation once; adversarial values included.
    struct EachOperation([f64; LANES], [f32; LANES]);

    impl LaneWork for EachOperation {
        type Output = [[f64; LANES]; 3];

        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) -> Self::Output {
            let (a, b) = (lanes.load(&self.0), lanes.load_f32(&self.1));
            let mut results = [[0.0; LANES]; 3];
            lanes.store(b, &mut results[0]);
            lanes.store(lanes.multiply_add(a, b, lanes.splat(0.5)), &mut results[1]);
            lanes.store(lanes.multiply_add(a, lanes.splat(1.0), lanes.splat(0.0)), &mut results[2]);
            results
        }
    }

    /// Every operation in f32 once.
    struct EachSingleOperation([f32; SINGLES], [f32; SINGLES], [u16; SINGLES]);

    impl LaneWork for EachSingleOperation {
        type Output = [[f32; SINGLES]; 7];

        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) -> Self::Output {
            let (a, b) = (lanes.load_singles(&self.0), lanes.load_singles(&self.1));
            let c = lanes.splat_singles(0.25);
            let groups = [
                lanes.load_u16(&self.2),
                lanes.subtract_singles(a, b),
                lanes.multiply_singles(a, b),
                lanes.multiply_add_singles(a, b, c),
                lanes.min_singles(a, b),
                lanes.max_singles(a, b),
                lanes.reciprocal_sqrt(b),
            ];
            let mut results = [[0.0; SINGLES]; 7];
            for (group, result) in groups.into_iter().zip(&mut results) {
                lanes.store_singles(group, result);
            }
            results[0][0] += lanes.sum_singles(a);
            results[0][1] += f32::from(lanes.at_most_singles(a, b));
            results[0][2] += f32::from(lanes.at_most_singles(a, a));
            results
        }
    }

    #[test]
    fn best_singles_agree_with_plain_arrays() {
        for seed in 0..100_u16 {
            let number = |lane: usize| (f32::from(seed) * 16.0 + lane as f32).sin();
            let positive = |lane: usize| 10_f32.powf(30.0 * number(lane + 7));
            let levels = std::array::from_fn(|lane| seed.wrapping_mul(653).wrapping_add(lane as u16 * 4099));
            let work =
                || EachSingleOperation(std::array::from_fn(number), std::array::from_fn(positive), levels);
            let (best, plain) = (with_lanes(work()), work().run(Portable));
            for (got, want) in best.as_flattened().iter().zip(plain.as_flattened()) {
                assert!((got - want).abs() <= 4e-7 * want.abs().max(1.0), "{got} {want}");
            }
        }
    }

    #[test]
    fn best_lanes_agree_with_plain_arrays() {
        let singles = [0.0, -0.0, 1.5, f32::MAX, f32::MIN_POSITIVE, f32::INFINITY, -3.25, 1e-40];
        for seed in 0..100_u32 {
            let values = std::array::from_fn(|lane| (f64::from(seed) * 8.0 + lane as f64).sin() * 1e3);
            let best = with_lanes(EachOperation(values, singles));
            let plain = EachOperation(values, singles).run(Portable);
            for (got, want) in best.as_flattened().iter().zip(plain.as_flattened()) {
                let equal = got.to_bits() == want.to_bits();
                assert!(equal || (got - want).abs() <= 1e-12 * want.abs(), "{got} {want}");
            }
        }
    }
}
