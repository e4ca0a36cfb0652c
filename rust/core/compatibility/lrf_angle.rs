//! Angle between two local reference frames, the paper's `e(L_i, L_j)` (CV).

use nalgebra::Matrix3;

/// Rotation angle between two frames in degrees: `acos((trace(A B^T) - 1) / 2)`.
#[inline]
pub fn frame_angle_degrees(a: &Matrix3<f64>, b: &Matrix3<f64>) -> f64 {
    ((a.dot(b) - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};

    #[test]
    fn is_the_angle_of_the_relative_rotation() {
        let a = Rotation3::from_axis_angle(&Vector3::z_axis(), 0.3).into_inner();
        let b = Rotation3::from_axis_angle(&Vector3::z_axis(), 1.1).into_inner();
        assert!((frame_angle_degrees(&a, &b) - 0.8_f64.to_degrees()).abs() < 1e-9);
        assert!(frame_angle_degrees(&a, &a) < 1e-5);
    }
}
