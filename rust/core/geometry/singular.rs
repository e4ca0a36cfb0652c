//! Singular values and vectors of 3x3 matrices by one-sided Jacobi rotations.
//!
//! Accurate to rounding relative to the largest singular value (J. Demmel, K. Veselić, *Jacobi's method is
//! more accurate than QR*, 1992). The decomposition of nalgebra squares the matrix, and loses the second
//! vectors of almost collinear points.

use nalgebra::{Matrix3, Vector3};

use crate::geometry::symmetric::orthogonal_to;

/// Sweeps over all pairs of columns; five suffice.
const SWEEPS: usize = 20;
/// Cosine of two columns that are orthogonal up to rounding.
const ORTHOGONAL: f64 = f64::EPSILON;

/// `M = sum_k values[k] left[k] right[k]^T`, with right-handed orthonormal bases.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Singular {
    /// Left vectors, as columns.
    pub left: Matrix3<f64>,
    /// Values in descending order of magnitude; only the last may be negative, as the determinant then is.
    pub values: [f64; 3],
    /// Right vectors, as columns.
    pub right: Matrix3<f64>,
}

impl Singular {
    /// Decomposes a matrix; zeros and identities if it is zero or not finite.
    pub fn of(matrix: &Matrix3<f64>) -> Self {
        let scale = matrix.amax();
        if scale == 0.0 || !matrix.iter().all(|entry| entry.is_finite()) {
            return Self { left: Matrix3::identity(), values: [0.0; 3], right: Matrix3::identity() };
        }
        let scaled = matrix / scale;
        let [(first, right_1), (second, right_2)] = two_longest(&scaled);
        let (left_1, right_3) = (first.normalize(), right_1.cross(&right_2));
        let beside = second - left_1 * left_1.dot(&second);
        let width = beside.norm();
        let left_2 = if width > 0.0 { beside / width } else { orthogonal_to(&left_1) };
        let left_3 = left_1.cross(&left_2);
        let values = [first.norm(), width, left_3.dot(&(scaled * right_3))];
        Self {
            left: Matrix3::from_columns(&[left_1, left_2, left_3]),
            values: values.map(|value| value * scale),
            right: Matrix3::from_columns(&[right_1, right_2, right_3]),
        }
    }

    /// The rotation R for which `tr(R^T M)` is largest.
    pub fn rotation(&self) -> Matrix3<f64> {
        self.left * self.right.transpose()
    }
}

/// The two longest of the columns `M V` that a rotation V makes orthogonal, each with its column of V.
fn two_longest(matrix: &Matrix3<f64>) -> [(Vector3<f64>, Vector3<f64>); 2] {
    let mut columns =
        [0, 1, 2].map(|k| (matrix.column(k).into_owned(), Matrix3::identity().column(k).into_owned()));
    for _ in 0..SWEEPS {
        let mut is_done = true;
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let ((a, v), (b, w)) = (columns[i], columns[j]);
            let (length, other, product) = (a.norm_squared(), b.norm_squared(), a.dot(&b));
            if product.abs() > ORTHOGONAL * length.sqrt() * other.sqrt() {
                let zeta = (other - length) / (2.0 * product);
                let tangent = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
                let cosine = 1.0 / tangent.hypot(1.0);
                let sine = cosine * tangent;
                columns[i] = (a * cosine - b * sine, v * cosine - w * sine);
                columns[j] = (a * sine + b * cosine, v * sine + w * cosine);
                is_done = false;
            }
        }
        if is_done {
            break;
        }
    }
    columns.sort_by(|(a, _), (b, _)| b.norm_squared().total_cmp(&a.norm_squared()));
    [columns[0], columns[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    /// A matrix of known values and bases.
    fn made(values: [f64; 3], k: u32) -> (Matrix3<f64>, [Matrix3<f64>; 2]) {
        let turn = |i: f64| {
            let k = f64::from(k);
            Rotation3::from_euler_angles(1.1 * i + k, 0.3 * k - i, 2.3 * i * k).into_inner()
        };
        let bases = [turn(1.0), turn(2.0)];
        (bases[0] * Matrix3::from_diagonal(&Vector3::from(values)) * bases[1].transpose(), bases)
    }

    #[test]
    fn values_and_the_rotation_are_those_that_made_the_matrix() {
        for k in 0..50 {
            let sizes = [
                [3.0, 2.0, 1.0],
                [2.0, 2.0, -1.0],
                [1.0, 1e-4, 1e-9],
                [1.0, 1e-9, 0.0],
                [7e150, 7e140, 1e130],
            ];
            for values in sizes {
                let (matrix, [left, right]) = made(values, k);
                let found = Singular::of(&matrix);
                for (value, expected) in found.values.iter().zip(values) {
                    assert!((value - expected).abs() < 4e-15 * values[0], "{value:e} {expected:e}");
                }
                let difference = (found.rotation() - left * right.transpose()).amax();
                assert!(difference < 4e-15 * values[0] / values[1], "{values:?}: {difference:e}");
                assert!((found.rotation().determinant() - 1.0).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn matrices_without_directions_have_bases_too() {
        let zero = Singular::of(&Matrix3::zeros());
        assert_eq!((zero.values, zero.rotation()), ([0.0; 3], Matrix3::identity()));
        assert_eq!(Singular::of(&Matrix3::from_element(f64::NAN)), zero);
        let tiny = Matrix3::from_element(5e-324);
        for matrix in
            [tiny, Matrix3::from_element(1e-200), Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, 2.0))]
        {
            let found = Singular::of(&matrix);
            assert!((found.rotation() * found.rotation().transpose() - Matrix3::identity()).amax() < 1e-14);
            assert!((found.rotation().determinant() - 1.0).abs() < 1e-14);
        }
    }
}
