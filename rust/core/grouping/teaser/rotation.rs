//! Rotation from translation-invariant measurements: graduated non-convexity on truncated least squares
//! (TEASER, section VII; Yang et al., *Graduated non-convexity for robust spatial perception*, RA-L 2020).

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::geometry::rigid::rotation_from_covariance;
use crate::options::{Value, words};
use crate::{Result, memory};

/// Factor by which the cost's convexity falls per step, change of the cost in squared bounds at which the
/// steps end, and most steps.
const FACTOR: f64 = 1.4;
const SETTLED: f64 = 1e-6;
const MOST_STEPS: usize = 100;

/// Measurements are collinear if their spread across their main direction is below this share of that along
/// it.
const FLAT: f64 = 1e-9;

words! {
    /// Degrees of freedom of the motion.
    pub enum Freedom {
        /// Any rotation.
        Six = Value::Whole(6),
        /// About the z axis (Lim et al., *Quatro*, ICRA 2022).
        Four = Value::Whole(4),
    }
}

/// The rotation R with the most inliers, `|q - R p| < bound`; `None` without inliers, or if they are
/// collinear.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn truncated_rotation(
    p: &[Vector3<f64>],
    q: &[Vector3<f64>],
    bound: f64,
    freedom: Freedom,
) -> Result<Option<Matrix3<f64>>> {
    let mut weights = memory::filled(1.0, p.len())?;
    let mut squares = memory::filled(0.0, p.len())?;
    let mut rotation = Matrix3::identity();
    let (mut mu, mut cost) = (0.0, f64::INFINITY);
    for step in 0..MOST_STEPS {
        let Some(next) = least_squares(p, q, &weights, freedom) else {
            return Ok(None);
        };
        rotation = next;
        for ((square, p), q) in squares.iter_mut().zip(p).zip(q) {
            *square = freedom.square(q - rotation * p) / (bound * bound);
        }
        if step == 0 {
            let greatest = squares.iter().copied().fold(0.0, f64::max);
            mu = 1.0 / (2.0 * greatest - 1.0);
            if mu <= 0.0 {
                return Ok(Some(rotation)); // all are inliers
            }
        }
        let before = cost;
        cost = weights.iter().zip(&squares).map(|(weight, square)| weight * square).sum();
        weights.iter_mut().zip(&squares).for_each(|(weight, &square)| *weight = weight_of(square, mu));
        mu *= FACTOR;
        if (before - cost).abs() < SETTLED {
            break;
        }
    }
    Ok(weights.iter().any(|&weight| weight >= 0.5).then_some(rotation))
}

/// Weight of a measurement by its squared residual, in squared bounds: 1 or 0 outside the transition.
fn weight_of(square: f64, mu: f64) -> f64 {
    if square >= (mu + 1.0) / mu {
        0.0
    } else if square <= mu / (mu + 1.0) {
        1.0
    } else {
        (mu * (mu + 1.0) / square).sqrt() - mu
    }
}

impl Freedom {
    /// The squared residual; heights do not constrain a rotation about z.
    fn square(self, residual: Vector3<f64>) -> f64 {
        match self {
            Self::Six => residual.norm_squared(),
            Self::Four => residual.xy().norm_squared(),
        }
    }
}

/// The least-squares rotation; `None` if the measurements do not determine one.
fn least_squares(
    p: &[Vector3<f64>],
    q: &[Vector3<f64>],
    weights: &[f64],
    freedom: Freedom,
) -> Option<Matrix3<f64>> {
    let mut covariance = Matrix3::zeros();
    for ((p, q), &weight) in p.iter().zip(q).zip(weights).filter(|(_, weight)| **weight > 0.0) {
        covariance += p * q.transpose() * weight;
    }
    match freedom {
        Freedom::Six => {
            let spread = covariance.singular_values();
            (spread[1] > FLAT * spread[0]).then(|| rotation_from_covariance(&covariance))
        }
        Freedom::Four => {
            let sine = covariance[(0, 1)] - covariance[(1, 0)];
            let cosine = covariance[(0, 0)] + covariance[(1, 1)];
            Some(Rotation3::from_axis_angle(&Vector3::z_axis(), sine.atan2(cosine)).into_inner())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Unit;

    fn vector(i: usize, k: f64) -> Vector3<f64> {
        Vector3::from([1.1, 2.3, 3.7].map(|f| 10.0 * (i as f64 * f * k + k).sin()))
    }

    #[test]
    fn outliers_do_not_change_the_rotation() -> Result<()> {
        for freedom in [Freedom::Six, Freedom::Four] {
            let axis = if freedom == Freedom::Four { Vector3::z() } else { Vector3::new(1.0, 2.0, -1.0) };
            let turn = Rotation3::from_axis_angle(&Unit::new_normalize(axis), 2.0).into_inner();
            let p: Vec<_> = (0..60).map(|i| vector(i, 1.0)).collect();
            let q: Vec<_> = (0..60).map(|i| if i < 40 { turn * p[i] } else { vector(i, 0.7) }).collect();
            let found = truncated_rotation(&p, &q, 0.1, freedom)?.unwrap_or_default();
            assert!((found - turn).amax() < 1e-6, "{found}");
        }
        Ok(())
    }

    #[test]
    fn least_squares_of_all_inliers_and_none_without_inliers() -> Result<()> {
        let p: Vec<_> = (0..20).map(|i| vector(i, 1.0)).collect();
        let found = truncated_rotation(&p, &p, 0.1, Freedom::Six)?.unwrap_or_default();
        assert!((found - Matrix3::identity()).amax() < 1e-12);
        let q: Vec<_> = (0..20).map(|i| vector(i, 0.7)).collect();
        assert_eq!(truncated_rotation(&p, &q, 1e-6, Freedom::Six)?, None);
        Ok(())
    }

    #[test]
    fn collinear_measurements_determine_only_a_rotation_about_z() -> Result<()> {
        let p: Vec<_> = (1..9).map(|i| Vector3::new(1.0, 2.0, 3.0) * f64::from(i)).collect();
        assert_eq!(truncated_rotation(&p, &p, 0.1, Freedom::Six)?, None);
        assert_eq!(truncated_rotation(&p, &p, 0.1, Freedom::Four)?, Some(Matrix3::identity()));
        Ok(())
    }

    #[test]
    fn a_weight_falls_from_one_to_none() {
        for mu in [1e-3, 0.5, 20.0] {
            let weights: Vec<f64> = (0..2000).map(|k| weight_of(0.01 * f64::from(k), mu)).collect();
            assert!(weights.is_sorted_by(|a, b| a >= b) && weights.iter().all(|w| (0.0..=1.0).contains(w)));
            assert!((weight_of(mu / (mu + 1.0) * 1.000_001, mu) - 1.0).abs() < 1e-5 * (1.0 + mu));
            assert!(weight_of((mu + 1.0) / mu * 0.999_999, mu) < 1e-5 * (1.0 + mu));
        }
    }
}
