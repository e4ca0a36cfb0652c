//! Angle between two local reference frames, the paper's `e(L_i, L_j)` (CV).

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use crate::simd::arithmetic::Arithmetic;

/// Sine and cosine of the difference of two angles in 0..=pi, given by their cosines.
#[inline(always)]
pub fn angle_difference<A: Arithmetic>(arithmetic: A, cosines: [f64; 2]) -> [f64; 2] {
    let sines = cosines.map(
        #[inline(always)]
        |cosine| arithmetic.multiply_add(-cosine, cosine, 1.0).sqrt(),
    );
    [
        sines[0] * cosines[1] - cosines[0] * sines[1], // 0 for equal angles
        arithmetic.multiply_add(cosines[0], cosines[1], sines[0] * sines[1]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::angle::atan2_by;
    use crate::simd::{Kernel, Lanes, run_on_each};

    /// The difference of the angles of many pairs of cosines, as a vectorized loop.
    #[derive(Clone, Copy)]
    struct Differences<'a>(&'a [[f64; 2]]);

    impl Kernel for Differences<'_> {
        type Output = Vec<f64>;

        #[inline(always)]
        fn run<L: Lanes>(self, lanes: L) -> Vec<f64> {
            let mut differences = vec![0.0; self.0.len()];
            for (difference, &cosines) in differences.iter_mut().zip(self.0) {
                let [sine, cosine] = angle_difference(lanes, cosines);
                *difference = atan2_by(lanes, sine, cosine).abs();
            }
            differences
        }
    }

    #[test]
    fn agrees_with_two_arccosines() {
        let mut cosines = vec![0.0, -0.0, 5e-324, -f64::MIN_POSITIVE, 1e-17, -1e-9];
        for bound in [0.5_f64, -0.5, 1.0, -1.0, std::f64::consts::FRAC_1_SQRT_2, -0.923_879_532_511_286_7] {
            cosines.extend([bound, bound.next_down().max(-1.0), bound.next_up().min(1.0)]);
            cosines.extend((1..16).map(|k| bound * (1.0 - 10_f64.powi(-k))));
        }
        cosines.extend((0..200).map(|k| (0.37 * f64::from(k * k)).sin()));
        let pairs: Vec<[f64; 2]> =
            cosines.iter().flat_map(|&a| cosines.iter().map(move |&b| [a, b])).collect();
        for differences in run_on_each(Differences(&pairs)) {
            for ([a, b], difference) in pairs.iter().zip(differences) {
                let expected = (a.acos() - b.acos()).abs();
                // The rounding of a cosine changes an angle near 0 or pi by more.
                let allowed =
                    1e-15 + 1e-16 / (1.0 - a * a).max(1e-16).sqrt() + 1e-16 / (1.0 - b * b).max(1e-16).sqrt();
                assert!((difference - expected).abs() <= allowed, "{a} {b}: {difference} {expected}");
            }
        }
    }
}
