//! Eigenvalues and eigenvectors of symmetric 3x3 matrices, without iteration.
//!
//! The best separated eigenvalue is computed from the cubic's trigonometric solution, and its vector from a
//! cross product; the other two from the remaining 2x2 problem. Accurate to rounding relative to the largest
//! eigenvalue, also if two or three eigenvalues coincide (D. Eberly, *A Robust Eigensolver for 3x3 Symmetric
//! Matrices*, 2014, describes the idea).

use nalgebra::{Matrix3, Vector3};

/// Eigenvalues in ascending order with orthonormal vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eigen {
    /// Eigenvalues, ascending.
    pub values: [f64; 3],
    /// The eigenvector of each; together a right-handed orthonormal basis.
    pub vectors: [Vector3<f64>; 3],
}

/// Decomposes a symmetric matrix; only its upper triangle is read.
pub fn eigen(matrix: &Matrix3<f64>) -> Eigen {
    let scale = matrix.upper_triangle().amax();
    if scale <= f64::MIN_POSITIVE || !scale.is_finite() {
        let value = if scale.is_finite() { 0.0 } else { f64::NAN };
        return Eigen { values: [value; 3], vectors: [Vector3::x(), Vector3::y(), Vector3::z()] };
    }
    let mut scaled = matrix / scale;
    scaled.fill_lower_triangle_with_upper_triangle();
    let (value, is_largest) = separated_eigenvalue(&scaled);
    let first = null_vector(&(scaled - Matrix3::identity() * value));
    let (low, high) = solve_complement(&scaled, &first);
    let value = first.dot(&(scaled * first));
    let mut pairs = if is_largest { [low, high, (value, first)] } else { [(value, first), low, high] };
    // Rounding may swap neighbours that are equal in exact arithmetic.
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let [a, b, c] = pairs;
    Eigen { values: [a.0 * scale, b.0 * scale, c.0 * scale], vectors: [b.1.cross(&c.1), b.1, c.1] }
}

/// The eigenvalue farthest from the middle one, and whether it is the largest (else the smallest).
fn separated_eigenvalue(a: &Matrix3<f64>) -> (f64, bool) {
    let mean = a.trace() / 3.0;
    let b = a - Matrix3::identity() * mean;
    let spread = (b.norm_squared() / 6.0).sqrt();
    if spread == 0.0 {
        return (mean, true);
    }
    let half_determinant = ((b / spread).determinant() / 2.0).clamp(-1.0, 1.0);
    let angle = half_determinant.abs().acos() / 3.0;
    let beta = 2.0 * angle.cos();
    if half_determinant >= 0.0 { (mean + spread * beta, true) } else { (mean - spread * beta, false) }
}

/// A unit vector that the matrix, of rank two or less, maps to zero.
fn null_vector(m: &Matrix3<f64>) -> Vector3<f64> {
    let (r0, r1, r2) = (m.column(0), m.column(1), m.column(2));
    let products = [r0.cross(&r1), r0.cross(&r2), r1.cross(&r2)];
    let lengths = products.map(|v| v.norm_squared());
    let best = (1..3).fold(0, |best, k| if lengths[k] > lengths[best] { k } else { best });
    if lengths[best] > 1e-28 {
        return products[best] / lengths[best].sqrt();
    }
    // Rank one or zero: any vector orthogonal to the longest row.
    let rows = [r0, r1, r2];
    let longest = (1..3).fold(0, |best, k| if rows[k].norm() > rows[best].norm() { k } else { best });
    orthogonal_to(&rows[longest].into_owned())
}

/// A unit vector orthogonal to `v`.
pub fn orthogonal_to(v: &Vector3<f64>) -> Vector3<f64> {
    let axis =
        if v.x.abs() > v.y.abs() { Vector3::new(-v.z, 0.0, v.x) } else { Vector3::new(0.0, v.z, -v.y) };
    let length = axis.norm();
    if length > 0.0 { axis / length } else { Vector3::x() }
}

/// Smaller and larger eigenpair of the matrix restricted to the plane orthogonal to `first`.
fn solve_complement(a: &Matrix3<f64>, first: &Vector3<f64>) -> ((f64, Vector3<f64>), (f64, Vector3<f64>)) {
    let u = orthogonal_to(first);
    let v = first.cross(&u);
    let (au, av) = (a * u, a * v);
    let (uu, uv, vv) = (u.dot(&au), u.dot(&av), v.dot(&av));
    let (mean, half_difference) = (0.5 * (uu + vv), 0.5 * (uu - vv));
    let root = half_difference.hypot(uv);
    let high = if root == 0.0 {
        u
    } else if half_difference >= 0.0 {
        (u * (half_difference + root) + v * uv).normalize()
    } else {
        (u * uv + v * (root - half_difference)).normalize()
    };
    ((mean - root, first.cross(&high)), (mean + root, high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    fn check(matrix: &Matrix3<f64>) {
        let Eigen { values, vectors } = eigen(matrix);
        let scale = matrix.amax().max(1e-300);
        let basis = Matrix3::from_columns(&vectors);
        assert!((basis.transpose() * basis - Matrix3::identity()).amax() < 1e-14, "{basis}");
        assert!((basis.determinant() - 1.0).abs() < 1e-14);
        assert!(values[0] <= values[1] && values[1] <= values[2], "{values:?}");
        let rebuilt = basis * Matrix3::from_diagonal(&Vector3::from(values)) * basis.transpose();
        assert!((rebuilt - matrix).amax() < 4e-15 * scale, "{matrix} {values:?}");
    }

    #[test]
    fn rebuilds_the_matrix() {
        let spectra = [
            [1.0, 2.0, 3.0],
            [0.0, 0.0, 1.0],
            [0.0, 1.0, 1.0],
            [1.0, 1.0, 1.0],
            [0.0, 0.0, 0.0],
            [1e-9, 1.0, 1.0 + 1e-9],
            [1e-16, 1e-8, 1.0],
            [-2.0, 0.0, 1.0],
            [1.0, 1.0 + 1e-15, 1.0 + 2e-15],
        ];
        for (spectrum, i) in spectra.iter().zip(0..) {
            for j in 0..50 {
                let axis = Vector3::new(f64::from(i + j).sin(), f64::from(2 * j).cos(), 0.3);
                let rotation = Rotation3::from_scaled_axis(axis * f64::from(j));
                let diagonal = Matrix3::from_diagonal(&Vector3::from(*spectrum));
                let matrix = rotation.matrix() * diagonal * rotation.matrix().transpose();
                check(&(0.5 * (matrix + matrix.transpose())));
                check(&(0.5e-20 * (matrix + matrix.transpose())));
            }
        }
    }

    #[test]
    fn agrees_with_an_iterative_solver() {
        for i in 0..500 {
            let entries: [f64; 6] =
                std::array::from_fn(|k| (f64::from(i) * [1.3, 2.1, 3.3, 4.7, 5.9, 7.1][k]).sin());
            let [a, b, c, d, e, f] = entries;
            let matrix = Matrix3::new(a, b, c, b, d, e, c, e, f);
            let mut expected = matrix.symmetric_eigenvalues();
            expected.as_mut_slice().sort_by(f64::total_cmp);
            assert!((Vector3::from(eigen(&matrix).values) - expected).amax() < 1e-14);
            check(&matrix);
        }
    }

    #[test]
    fn nan_stays_nan() {
        assert!(
            eigen(&Matrix3::repeat(f64::NAN)).values[0].is_nan()
                || eigen(&Matrix3::repeat(f64::INFINITY)).values[0].is_nan()
        );
    }
}
