//! Motions and their twists: rotation vector first, then translation; a twist moves a pose on its right,
//! `T exp(d)`.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use crate::geometry::rigid::Rigid;

/// Angles below this use the series: closed forms would lose digits.
const SMALL_ANGLE: f64 = 0.1;

/// Composes `a` and `b`: `a b` maps `p` to `a(b(p))`.
pub fn compose(a: &Rigid, b: &Rigid) -> Rigid {
    Rigid { rotation: a.rotation * b.rotation, translation: a.rotation * b.translation + a.translation }
}

/// The inverse motion.
pub fn inverse(motion: &Rigid) -> Rigid {
    let back = motion.rotation.transpose();
    Rigid { rotation: back, translation: -(back * motion.translation) }
}

/// `a^-1 b`: the pose of `b` in the frame of `a`.
pub fn between(a: &Rigid, b: &Rigid) -> Rigid {
    let back = a.rotation.transpose();
    Rigid { rotation: back * b.rotation, translation: back * (b.translation - a.translation) }
}

/// The motion of a twist.
pub fn exponential(twist: &Vector6<f64>) -> Rigid {
    let (turn, shift) = halves(twist);
    let w = turn.cross_matrix();
    let [_, a, b, _] = coefficients(turn.norm());
    let w_squared = w * w;
    let sine = 1.0 - turn.norm_squared() * b; // sin(x) / x
    let rotation = Matrix3::identity() + w * sine + w_squared * a;
    Rigid { rotation: orthonormal(&rotation), translation: left_jacobian(&w, a, b) * shift }
}

/// The twist of a motion, with an angle of at most pi.
pub fn logarithm(motion: &Rigid) -> Vector6<f64> {
    let turn = rotation_vector(&motion.rotation);
    let shift = inverse_left_jacobian(&turn) * motion.translation;
    joined(&turn, &shift)
}

/// The matrix that moves a twist to the other side: `T exp(d) = exp(Ad d) T`.
pub fn adjoint(motion: &Rigid) -> Matrix6<f64> {
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&motion.rotation);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&motion.rotation);
    let lower = motion.translation.cross_matrix() * motion.rotation;
    matrix.fixed_view_mut::<3, 3>(3, 0).copy_from(&lower);
    matrix
}

/// Derivative of the logarithm under a motion on the right: `log(exp(e) exp(d)) = e + J d` for small `d`
/// (Barfoot, *State Estimation for Robotics*, 7.1.5).
pub fn inverse_right_jacobian(twist: &Vector6<f64>) -> Matrix6<f64> {
    let (turn, shift) = halves(&-twist);
    let (w, v) = (turn.cross_matrix(), shift.cross_matrix());
    let [_, _, b, c] = coefficients(turn.norm());
    let angle_squared = turn.norm_squared();
    let quarter = if angle_squared < SMALL_ANGLE * SMALL_ANGLE {
        1.0 / 24.0 - angle_squared * (1.0 / 720.0 - angle_squared / 40320.0)
    } else {
        (angle_squared + 2.0 * angle_squared.sqrt().cos() - 2.0) / (2.0 * angle_squared * angle_squared)
    };
    let (wv, vw) = (w * v, v * w);
    let wvw = wv * w;
    let q = v * 0.5 + (wv + vw + wvw) * b + (w * wv + vw * w - wvw * 3.0) * quarter + (wvw * w + w * wvw) * c;
    let back = inverse_left_jacobian(&turn);
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
    matrix.fixed_view_mut::<3, 3>(3, 0).copy_from(&-(back * q * back));
    matrix
}

/// The rotation nearest to a matrix that is nearly one: one step of Newton's iteration removes rounding
/// errors.
fn orthonormal(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    (matrix * 3.0 - matrix * matrix.transpose() * matrix) * 0.5
}

fn halves(twist: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3).into())
}

fn joined(turn: &Vector3<f64>, shift: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
}

/// `cos(x)`, `(1 - cos x) / x^2`, `(x - sin x) / x^3`, `(2 x - 3 sin x + x cos x) / (2 x^5)`.
fn coefficients(x: f64) -> [f64; 4] {
    let square = x * x;
    let (sin, cos) = x.sin_cos();
    if x < SMALL_ANGLE {
        let a = 0.5 - square * (1.0 / 24.0 - square * (1.0 / 720.0 - square / 40320.0));
        let b = 1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square / 362_880.0));
        let c = 1.0 / 120.0 - square * (1.0 / 2520.0 - square / 120_960.0);
        return [cos, a, b, c];
    }
    let half = (0.5 * x).sin();
    let cube = square * x;
    let c = (2.0 * x - 3.0 * sin + x * cos) / (2.0 * cube * square);
    [cos, 2.0 * half * half / square, (x - sin) / cube, c]
}

fn left_jacobian(w: &Matrix3<f64>, a: f64, b: f64) -> Matrix3<f64> {
    Matrix3::identity() + w * a + w * w * b
}

/// `I - W / 2 + W^2 (1 / x^2 - cot(x / 2) / (2 x))`.
fn inverse_left_jacobian(turn: &Vector3<f64>) -> Matrix3<f64> {
    let (w, x) = (turn.cross_matrix(), turn.norm());
    let square = x * x;
    let last = if x < SMALL_ANGLE {
        1.0 / 12.0 + square * (1.0 / 720.0 + square * (1.0 / 30240.0 + square / 1_209_600.0))
    } else {
        (1.0 - 0.5 * x / (0.5 * x).tan()) / square
    };
    Matrix3::identity() - w * 0.5 + w * w * last
}

/// The rotation vector, computed from the quaternion's largest component to keep precision at any angle.
fn rotation_vector(r: &Matrix3<f64>) -> Vector3<f64> {
    let trace = r.trace();
    let squares = [trace, r[(0, 0)], r[(1, 1)], r[(2, 2)]];
    let largest = (1..4).fold(0, |best, k| if squares[k] > squares[best] { k } else { best });
    let (w, vector) = if largest == 0 {
        let turn = Vector3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]);
        (1.0 + trace, turn)
    } else {
        let (i, j, k) = (largest - 1, largest % 3, (largest + 1) % 3);
        let mut turn = Vector3::zeros();
        turn[i] = 1.0 + r[(i, i)] - r[(j, j)] - r[(k, k)];
        turn[j] = r[(i, j)] + r[(j, i)];
        turn[k] = r[(i, k)] + r[(k, i)];
        (r[(k, j)] - r[(j, k)], turn)
    };
    let (w, vector) = if w < 0.0 { (-w, -vector) } else { (w, vector) };
    let sine = vector.norm();
    // Sine and cosine of half the angle: the vector is the axis times sine, up to a common scale.
    if sine == 0.0 { vector } else { vector * (2.0 * sine.atan2(w) / sine) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn twists() -> Vec<Vector6<f64>> {
        let angles = [0.0, 1e-9, 1e-4, 0.099, 0.101, 1.0, 2.5, PI - 1e-3, PI - 1e-7];
        let axes =
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.48, -0.6, 0.64], [-0.8, 0.36, 0.48]];
        let mut twists = Vec::new();
        for angle in angles {
            for axis in axes {
                let [x, y, z] = axis.map(|part| part * angle);
                twists.push(Vector6::new(x, y, z, 3.0, -0.2, 1.5));
            }
        }
        twists
    }

    #[test]
    fn the_logarithm_undoes_the_exponential() {
        for twist in twists() {
            let again = logarithm(&exponential(&twist));
            assert!((again - twist).amax() < 1e-8, "{twist} {again}");
        }
    }

    #[test]
    fn exponentials_are_orthonormal() {
        for twist in twists() {
            let rotation = exponential(&twist).rotation;
            assert!((rotation * rotation.transpose() - Matrix3::identity()).amax() < 1e-15);
        }
    }

    #[test]
    fn the_jacobian_agrees_with_differences() {
        for twist in twists().into_iter().filter(|twist| twist.fixed_rows::<3>(0).norm() < 3.0) {
            let jacobian = inverse_right_jacobian(&twist);
            for k in 0..6 {
                let mut step = Vector6::zeros();
                step[k] = 1e-5;
                let moved =
                    |step: Vector6<f64>| logarithm(&compose(&exponential(&twist), &exponential(&step)));
                let slope = (moved(step) - moved(-step)) / 2e-5;
                assert!((jacobian.column(k) - slope).amax() < 1e-7, "{twist} {k}");
            }
        }
    }

    #[test]
    fn the_adjoint_moves_a_twist_to_the_other_side() {
        for twist in twists() {
            let motion = exponential(&twist);
            let small = Vector6::new(0.1, -0.2, 0.05, 0.3, 0.1, -0.4);
            let right = compose(&motion, &exponential(&small));
            let left = compose(&exponential(&(adjoint(&motion) * small)), &motion);
            assert!((right.to_matrix() - left.to_matrix()).amax() < 1e-12);
            assert!(
                (compose(&motion, &between(&motion, &right)).to_matrix() - right.to_matrix()).amax() < 1e-12
            );
            assert!(
                (compose(&motion, &inverse(&motion)).to_matrix() - nalgebra::Matrix4::identity()).amax()
                    < 1e-12
            );
        }
    }
}
