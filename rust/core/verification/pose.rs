//! Poses in single precision between surfaces in centred coordinates, in units.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// `x' = R x + t` in single precision.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Pose {
    pub rotation: Matrix3<f32>,
    pub translation: Vector3<f32>,
}

impl Pose {
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    pub fn is_finite(&self) -> bool {
        self.rotation.iter().chain(&self.translation).all(|number| number.is_finite())
    }

    /// Composes the pose with a small motion, given as a rotation vector and a translation.
    pub fn followed_by(&self, turn: Vector3<f64>, shift: Vector3<f64>) -> Self {
        let turn = Rotation3::new(turn).into_inner().map(|number| number as f32);
        let shift = shift.map(|number| number as f32);
        Self { rotation: turn * self.rotation, translation: turn * self.translation + shift }
    }

    pub fn orthonormal(&self) -> Self {
        let rotation = nearest_rotation(&self.rotation.map(f64::from)).map(|number| number as f32);
        Self { rotation, ..*self }
    }

    /// Angle of the rotation between two poses, in radians.
    pub fn angle_to(&self, other: &Self) -> f32 {
        let cosine = (self.rotation.component_mul(&other.rotation).sum() - 1.0) / 2.0;
        cosine.clamp(-1.0, 1.0).acos()
    }

    /// Whether two poses move a point at `radius` from the centre apart by more than about `distance`.
    pub fn is_apart(&self, other: &Self, radius: f32, distance: f32) -> bool {
        let shift = (self.translation - other.translation).norm();
        shift > distance || shift + self.angle_to(other) * radius > distance
    }
}

/// Returns the rotation nearest to a matrix that is nearly a rotation, or the mirrored rotation nearest to one that is nearly
/// mirrored.
pub(super) fn nearest_rotation(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    let side = matrix.determinant().signum();
    let rotation = Rotation3::from_matrix_unchecked(matrix * side);
    // The quaternion of a matrix in single precision is not quite of unit length.
    let quaternion = UnitQuaternion::from_rotation_matrix(&rotation).into_inner();
    UnitQuaternion::new_normalize(quaternion).to_rotation_matrix().into_inner() * side
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_rotation_keeps_a_mirror_image() {
        let rotation = Rotation3::new(Vector3::new(0.3, -1.0, 0.5)).into_inner();
        let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
        for exact in [rotation, rotation * mirror] {
            let found = nearest_rotation(&exact.map(|number| f64::from(number as f32)));
            assert!((found - exact).amax() < 1e-6);
            assert!((found * found.transpose() - Matrix3::identity()).amax() < 1e-14);
        }
    }
}
