//! Eight numbers at a time, in the widest registers that the machine has.
//!
//! For the loops that the compiler does not turn into vector code by itself. [`with_lanes`] chooses at
//! run time between AVX-512, AVX2 with FMA, and plain arrays, which the compiler maps to the baseline's
//! registers (SSE2, NEON). There is no `unsafe` here: pulp's tokens prove that the instructions exist.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use pulp::Arch;
#[cfg(target_arch = "x86_64")]
use pulp::{cast, f64x4, f64x8};

/// Numbers in a group.
pub const LANES: usize = 8;

/// Arithmetic on groups of [`LANES`] numbers.
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
        let narrow: pulp::f32x8 = cast(*values);
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
