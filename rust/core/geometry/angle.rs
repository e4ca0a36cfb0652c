//! An arctangent without branches or table lookups, which the compiler vectorizes.

#![expect(clippy::inline_always, reason = "must inherit the vector features of the surrounding loop")]

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use crate::simd::arithmetic::{Arithmetic, Separate, polynomial};

/// Tangent of 22.5 degrees: larger angles are measured from 45 degrees.
const TAN_PI_8: f64 = 0.414_213_562_373_095_03;

/// `atan(t) / t` as a polynomial of `t^2`, for `|t| <= tan(22.5 degrees)`: interpolation at the Chebyshev
/// points of that range, error below 4e-16.
const COEFFICIENTS: [f64; 10] = [
    0.999_999_999_999_999,
    -0.333_333_333_332_214_3,
    0.199_999_999_783_926_63,
    -0.142_857_126_616_847_93,
    0.111_110_488_537_512_96,
    -0.090_895_299_565_623_07,
    0.076_735_354_281_832_85,
    -0.065_059_829_671_708_4,
    0.050_247_621_189_401_28,
    -0.025_316_479_573_776_477,
];

/// Angle of the vector (x, y) from the x axis, in -pi..=pi; 0 for the zero vector. Error below 1e-15.
#[inline(always)]
pub fn atan2(y: f64, x: f64) -> f64 {
    atan2_by(Separate, y, x)
}

/// As [`atan2`], in the arithmetic of an instruction set.
#[inline(always)]
pub fn atan2_by<A: Arithmetic>(arithmetic: A, y: f64, x: f64) -> f64 {
    let (across, along) = (y.abs(), x.abs());
    let (low, high) = if across < along { (across, along) } else { (along, across) };
    let is_steep = low > TAN_PI_8 * high;
    let numerator = if is_steep { low - high } else { low };
    let denominator = if is_steep { low + high } else { high };
    let t = numerator / if denominator > 0.0 { denominator } else { 1.0 };
    let square = t * t;
    let series = polynomial(arithmetic, &COEFFICIENTS, square);
    let octant = arithmetic.multiply_add(t, series, if is_steep { FRAC_PI_4 } else { 0.0 });
    let quadrant = if across > along { FRAC_PI_2 - octant } else { octant };
    let half = if x < 0.0 { PI - quadrant } else { quadrant };
    if y < 0.0 { -half } else { half }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_standard_library() {
        for i in 0..40_000 {
            let angle = (f64::from(i) - 20_000.0) / 20_000.0 * PI;
            for scale in [1e-200, 1.0, 1e200] {
                let (y, x) = (scale * angle.sin(), scale * angle.cos());
                assert!((atan2(y, x) - y.atan2(x)).abs() < 1e-15, "{y} {x}");
            }
        }
    }

    #[test]
    fn angles_of_axes_and_diagonals() {
        for x in [-2.0, 0.0, 2.0] {
            for y in [-2.0, 0.0, 2.0] {
                assert!((atan2(y, x) - f64::atan2(y, x)).abs() < 1e-15, "{y} {x}");
            }
        }
    }
}
