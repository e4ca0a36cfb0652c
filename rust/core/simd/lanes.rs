//! Groups of numbers in registers, eight in f64 or sixteen in f32, and their operations.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use super::arithmetic::Arithmetic;

/// Numbers in a group of f64.
pub const DOUBLES: usize = 8;

/// Numbers in a group of f32, and of counts.
pub const SINGLES: usize = 16;

/// An instruction set. A value proves that the machine supports it, so no operation here is `unsafe`.
pub trait Lanes: Arithmetic {
    /// [`DOUBLES`] numbers in f64.
    type Doubles: Copy;
    /// Broadcasts a number to every lane.
    fn splat_doubles(self, value: f64) -> Self::Doubles;
    /// Loads from memory.
    fn load_doubles(self, values: &[f64; DOUBLES]) -> Self::Doubles;
    /// Loads from memory and widens.
    fn load_widened(self, values: &[f32; DOUBLES]) -> Self::Doubles;
    /// Stores to memory.
    fn store_doubles(self, group: Self::Doubles, values: &mut [f64; DOUBLES]);
    /// `a b + c`, rounded once if the instruction set fuses it.
    fn multiply_add_doubles(self, a: Self::Doubles, b: Self::Doubles, c: Self::Doubles) -> Self::Doubles;

    /// [`SINGLES`] numbers in f32.
    type Singles: Copy;
    /// Broadcasts a number to every lane.
    fn splat_singles(self, value: f32) -> Self::Singles;
    /// Loads from memory.
    fn load_singles(self, values: &[f32; SINGLES]) -> Self::Singles;
    /// Loads from memory and converts.
    fn load_u16(self, values: &[u16; SINGLES]) -> Self::Singles;
    /// Stores to memory.
    fn store_singles(self, group: Self::Singles, values: &mut [f32; SINGLES]);
    /// `a + b`.
    fn add_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles;
    /// `a - b`.
    fn subtract_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles;
    /// `a b`.
    fn multiply_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles;
    /// `a b + c`, rounded once if the instruction set fuses it.
    fn multiply_add_singles(self, a: Self::Singles, b: Self::Singles, c: Self::Singles) -> Self::Singles;
    /// The minimum of two; `b` if `a` is NaN.
    fn min_singles(self, a: Self::Singles, b: Self::Singles) -> Self::Singles;
    /// `|a|`.
    fn absolute_singles(self, a: Self::Singles) -> Self::Singles;
    /// Sum of all lanes.
    fn sum_singles(self, a: Self::Singles) -> f32;
    /// One bit per lane: whether `a <= b`.
    fn at_most(self, a: Self::Singles, b: Self::Singles) -> u16;
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

    /// [`SINGLES`] counts.
    type Counts: Copy;
    /// Loads from memory.
    fn load_counts(self, values: &[u32; SINGLES]) -> Self::Counts;
    /// Stores to memory.
    fn store_counts(self, counts: Self::Counts, values: &mut [u32; SINGLES]);
    /// 1 if `a < b`, else 0.
    fn ones_where_below(self, a: Self::Singles, b: Self::Singles) -> Self::Counts;
    /// `a + b`.
    fn add_counts(self, a: Self::Counts, b: Self::Counts) -> Self::Counts;
}

#[cfg(test)]
mod tests {
    use super::super::dispatch::{Kernel, run_on_each};
    use super::*;

    /// Runs every operation in f64 once.
    #[derive(Clone, Copy)]
    struct EachDouble([f64; DOUBLES], [f32; DOUBLES]);

    impl Kernel for EachDouble {
        type Output = [[f64; DOUBLES]; 3];

        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) -> Self::Output {
            let (a, b) = (lanes.load_doubles(&self.0), lanes.load_widened(&self.1));
            let [zero, half, one] = [0.0, 0.5, 1.0].map(
                #[inline(always)]
                |value| lanes.splat_doubles(value),
            );
            let mut results = [[0.0; DOUBLES]; 3];
            lanes.store_doubles(b, &mut results[0]);
            lanes.store_doubles(lanes.multiply_add_doubles(a, b, half), &mut results[1]);
            lanes.store_doubles(lanes.multiply_add_doubles(a, one, zero), &mut results[2]);
            results
        }
    }

    /// Runs every operation in f32, and on counts, once.
    #[derive(Clone, Copy)]
    struct EachSingle([f32; SINGLES], [f32; SINGLES], [u16; SINGLES]);

    impl Kernel for EachSingle {
        type Output = ([[f32; SINGLES]; 8], [f32; 1], [u16; 2], [u32; SINGLES]);

        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) -> Self::Output {
            let (a, b) = (lanes.load_singles(&self.0), lanes.load_singles(&self.1));
            let groups = [
                lanes.load_u16(&self.2),
                lanes.add_singles(a, b),
                lanes.subtract_singles(a, b),
                lanes.multiply_singles(a, b),
                lanes.multiply_add_singles(a, b, lanes.splat_singles(0.25)),
                lanes.min_singles(a, b),
                lanes.absolute_singles(a),
                lanes.reciprocal_sqrt(b),
            ];
            let mut results = [[0.0; SINGLES]; 8];
            for (group, result) in groups.into_iter().zip(&mut results) {
                lanes.store_singles(group, result);
            }
            let mut counts = [7; SINGLES];
            let sum = lanes.add_counts(lanes.load_counts(&counts), lanes.ones_where_below(a, b));
            lanes.store_counts(sum, &mut counts);
            (results, [lanes.sum_singles(a)], [lanes.at_most(a, b), lanes.at_most(a, a)], counts)
        }
    }

    #[test]
    fn operations_in_f32_agree_with_plain_arrays() {
        for seed in 0..100_u16 {
            let number = |lane: usize| (f32::from(seed) * 16.0 + lane as f32).sin();
            let positive = |lane: usize| 10_f32.powf(30.0 * number(lane + 7));
            let levels = std::array::from_fn(|lane| seed.wrapping_mul(653).wrapping_add(lane as u16 * 4099));
            let kernel = EachSingle(std::array::from_fn(number), std::array::from_fn(positive), levels);
            let all = run_on_each(kernel);
            let (plain, plain_sum, plain_bits, plain_counts) = all[0];
            for (groups, sum, bits, counts) in all {
                for (got, want) in groups
                    .as_flattened()
                    .iter()
                    .chain(&sum)
                    .zip(plain.as_flattened().iter().chain(&plain_sum))
                {
                    assert!((got - want).abs() <= 4e-7 * want.abs().max(1.0), "{got} {want}");
                }
                assert_eq!((bits, counts), (plain_bits, plain_counts));
            }
        }
    }

    #[test]
    fn nan_is_not_at_most_anything_and_min_returns_the_other() {
        let mut a = [1.0; SINGLES];
        a[3] = f32::NAN;
        for (groups, _, bits, counts) in run_on_each(EachSingle(a, [2.0; SINGLES], [0; SINGLES])) {
            assert!((groups[5][3] - 2.0).abs() < 1e-15);
            assert_eq!((bits[0], counts[3], counts[4]), (!(1 << 3), 7, 8));
        }
    }

    #[test]
    fn operations_in_f64_agree_with_plain_arrays() {
        let singles = [0.0, -0.0, 1.5, f32::MAX, f32::MIN_POSITIVE, f32::INFINITY, -3.25, 1e-40];
        for seed in 0..100_u32 {
            let values = std::array::from_fn(|lane| (f64::from(seed) * 8.0 + lane as f64).sin() * 1e3);
            let all = run_on_each(EachDouble(values, singles));
            for results in &all {
                for (got, want) in results.as_flattened().iter().zip(all[0].as_flattened()) {
                    let equal = got.to_bits() == want.to_bits();
                    assert!(equal || (got - want).abs() <= 1e-12 * want.abs(), "{got} {want}");
                }
            }
        }
    }
}
