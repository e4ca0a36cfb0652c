//! Elementary functions without branches or table lookups, which the compiler vectorizes.
//!
//! All functions are plain Rust. The [`Arithmetic`], which every kind of [`Lanes`](super::Lanes) implements,
//! determines whether a product and a sum are rounded once or twice.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use std::f64::consts::LOG2_E;

/// `a b + c` in the fastest form of an instruction set.
pub trait Arithmetic: Copy {
    /// `a b + c`.
    fn multiply_add(self, a: f64, b: f64, c: f64) -> f64;
}

/// Product and sum are rounded separately: the same on every machine.
#[derive(Debug, Clone, Copy)]
pub struct Separate;

impl Arithmetic for Separate {
    #[inline(always)]
    fn multiply_add(self, a: f64, b: f64, c: f64) -> f64 {
        a * b + c
    }
}

/// The exponential of this exponent, and of any lower one, rounds to 0.
const LEAST_EXPONENT: f64 = -746.0;

/// Powers of two are formed in two steps, of which this is the second: 2^-1076 is not representable.
const SECOND_STEP: f64 = 1.0 / ((1_u64 << 60) as f64);

/// 1.5 * 2^52: adding it rounds to an integer, which is then in the last bits.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// ln 2 in two parts; products of the first with whole numbers up to 2^20 are exact.
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];

/// `e^r` as a polynomial for `|r| <= ln(2) / 2`: interpolation at the Chebyshev points, error below 2e-17.
const EXP: [f64; 12] = [
    1.0,
    1.0,
    0.500_000_000_000_001_9,
    0.166_666_666_666_666_8,
    0.041_666_666_666_488_1,
    0.008_333_333_333_319_601,
    0.001_388_888_895_231_477_5,
    0.000_198_412_698_900_471_13,
    2.480_148_548_232_849_4e-5,
    2.755_724_091_857_897e-6,
    2.763_263_963_904_103e-7,
    2.511_003_760_596_377_8e-8,
];

/// `e^x` for x of at most 0. Relative error below 1e-15; not for NaN.
#[inline(always)]
pub fn exp_of_negative<A: Arithmetic>(arithmetic: A, x: f64) -> f64 {
    let x = if x > LEAST_EXPONENT { x } else { LEAST_EXPONENT };
    let rounded = arithmetic.multiply_add(x, LOG2_E, ROUNDER);
    let k = rounded - ROUNDER; // x = k ln 2 + r
    let r = arithmetic.multiply_add(k, -LN_2[1], arithmetic.multiply_add(k, -LN_2[0], x));
    let power = polynomial(arithmetic, &EXP, r); // e^r
    let scale = f64::from_bits((rounded.to_bits() << 52).wrapping_add(SECOND_STEP.recip().to_bits()));
    power * scale * SECOND_STEP // e^r 2^k
}

/// The polynomial of these coefficients, that of `x^0` first.
#[inline(always)]
pub fn polynomial<A: Arithmetic, const N: usize>(arithmetic: A, coefficients: &[f64; N], x: f64) -> f64 {
    let mut sum = coefficients[N - 1];
    for k in (0..N - 1).rev() {
        sum = arithmetic.multiply_add(sum, x, coefficients[k]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::super::dispatch::{Kernel, run_on_each};
    use super::super::lanes::Lanes;
    use super::*;

    /// The exponentials of many exponents, as a vectorized loop.
    #[derive(Clone, Copy)]
    struct Powers<'a>(&'a [f64]);

    impl Kernel for Powers<'_> {
        type Output = Vec<f64>;

        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) -> Vec<f64> {
            let mut powers = vec![0.0; self.0.len()];
            for (power, &x) in powers.iter_mut().zip(self.0) {
                *power = exp_of_negative(lanes, x);
            }
            powers
        }
    }

    fn exponents() -> Vec<f64> {
        let mut exponents = vec![0.0, -0.0, -f64::MIN_POSITIVE, -5e-324, -1e-17, -f64::EPSILON, -800.0];
        exponents.extend([
            -745.0,
            -745.13,
            -745.14,
            -708.0,
            -708.4,
            -1e4,
            -1e300,
            f64::MIN,
            f64::NEG_INFINITY,
        ]);
        for k in 0..=2000 {
            let half = -0.5 * f64::from(k) * std::f64::consts::LN_2; // k changes here
            exponents.extend([half, half.next_up().min(0.0), half.next_down()]);
        }
        exponents.extend([LEAST_EXPONENT, LEAST_EXPONENT.next_up(), LEAST_EXPONENT.next_down()]);
        exponents.extend((0..100_000_u64).map(|k| -7e-3 * k as f64 - 1e-9 * (k * k % 977) as f64));
        exponents.extend((0..1000).map(|k| -(10_f64.powf(-0.3 * f64::from(k)))));
        exponents
    }

    #[test]
    fn powers_agree_with_the_standard_library() {
        let exponents = exponents();
        for powers in run_on_each(Powers(&exponents)) {
            for (x, power) in exponents.iter().zip(powers) {
                let expected = x.exp();
                let allowed = 1e-15 * expected + 5e-324;
                assert!((power - expected).abs() <= allowed, "e^{x}: {power} {expected}");
                assert!((0.0..=1.0).contains(&power), "e^{x}: {power}");
            }
        }
    }

    #[test]
    fn the_least_powers_are_zero_and_the_greatest_is_one() {
        for powers in run_on_each(Powers(&[-800.0, f64::NEG_INFINITY, f64::MIN, 0.0, -0.0, -5e-324])) {
            assert_eq!(powers, [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
        }
    }
}
