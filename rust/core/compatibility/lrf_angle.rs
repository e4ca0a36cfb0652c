//! Angle between two local reference frames, the paper's `e(L_i, L_j)` (CV).

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use super::vector_math::Arithmetic;
use crate::geometry::angle::atan2;

/// `e(L_i, L_j) - e(L'_i, L'_j)` in radians, up to its sign; an angle is given by its cosine,
/// `(trace(A B^T) - 1) / 2`, and lies in 0..=pi.
///
/// One arctangent of the difference's sine and cosine, in place of two arccosines.
#[inline(always)]
pub fn angle_difference<A: Arithmetic>(arithmetic: A, source_cosine: f64, target_cosine: f64) -> f64 {
    let source_sine = arithmetic.multiply_add(-source_cosine, source_cosine, 1.0).sqrt();
    let target_sine = arithmetic.multiply_add(-target_cosine, target_cosine, 1.0).sqrt();
    let sine = source_sine * target_cosine - source_cosine * target_sine;
    let cosine = arithmetic.multiply_add(source_cosine, target_cosine, source_sine * target_sine);
    atan2(sine, cosine)
}
