//! Rigidity of a pair of correspondences: a rigid motion preserves the distance between two points.

/// `r(c_i, c_j) = min(ds/dt, dt/ds)` in 0..=1, the paper's Eq. (12).
///
/// An edge of at most its side's zero length has coincident ends; the ratio is 0 then.
#[inline]
pub fn distance_ratio(ds: f64, dt: f64, zero_ds: f64, zero_dt: f64) -> f64 {
    if ds <= zero_ds || dt <= zero_dt { 0.0 } else { (ds / dt).min(dt / ds) }
}

/// `d(c_i, c_j) = |ds - dt|`, a length: the left side of the paper's Eq. (13).
#[inline]
pub fn distance_difference(ds: f64, dt: f64) -> f64 {
    (ds - dt).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hand_computed() {
        assert!((distance_ratio(2.0, 4.0, 0.0, 0.0) - 0.5).abs() < 1e-15);
        assert!((distance_ratio(4.0, 2.0, 0.0, 0.0) - 0.5).abs() < 1e-15);
        assert!(distance_ratio(0.0, 4.0, 0.0, 0.0).abs() < 1e-15);
        assert!((distance_difference(2.0, 4.5) - 2.5).abs() < 1e-15);
    }
}
