//! Least-squares rigid fit (Kabsch): the transform that maps source points onto target points.

use nalgebra::{Matrix3, Matrix4, Point3, Vector3};

use crate::error::{Error, Result};
use crate::geometry::singular::Singular;
use crate::memory;
use crate::points::Points;

/// Points whose second principal variance is below this share of the first are collinear: rounding of exactly
/// collinear points produces about as much.
const LINE_FLATNESS: f64 = 1e-14;

/// Ratio of the second singular value of a covariance to the largest one below which nalgebra's decomposition, which squares the
/// matrix, is too inexact: its rotations are off by 1e-8 at 1e-4, and arbitrary at 1e-8.
const THIN: f64 = 1e-2;

/// A rigid transform `q = R p + t` on column vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigid {
    /// Rotation R.
    pub rotation: Matrix3<f64>,
    /// Translation t.
    pub translation: Vector3<f64>,
}

impl Rigid {
    /// Returns the transform that moves nothing.
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    /// Returns the transform of a homogeneous 4x4 matrix.
    pub fn from_matrix(matrix: &Matrix4<f64>) -> Self {
        Self {
            rotation: matrix.fixed_view::<3, 3>(0, 0).into(),
            translation: matrix.fixed_view::<3, 1>(0, 3).into(),
        }
    }

    /// Applies the transform.
    #[inline]
    pub fn apply(&self, p: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation * p.coords + self.translation)
    }

    /// The same motion between points that are not centred.
    #[must_use]
    pub fn uncentered(&self, source: &Points, target: &Points) -> Self {
        let translation = self.translation + target.center() - self.rotation * source.center();
        Self { rotation: self.rotation, translation }
    }

    /// The same motion between centred points: the inverse of [`Self::uncentered`].
    #[must_use]
    pub fn centered(&self, source: &Points, target: &Points) -> Self {
        let translation = self.translation + self.rotation * source.center() - target.center();
        Self { rotation: self.rotation, translation }
    }

    /// Homogeneous 4x4 matrix.
    pub fn to_matrix(&self) -> Matrix4<f64> {
        let mut matrix = self.rotation.to_homogeneous();
        matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.translation);
        matrix
    }
}

/// Least-squares transform between two sequences of points of equal length, three or more
/// (Kabsch: `H = sum a b^T = U S V^T`, `R = V diag(1, 1, det(V U^T)) U^T`).
pub fn fit_rigid(source: &[Point3<f64>], target: &[Point3<f64>]) -> Rigid {
    let count = source.len().max(1) as f64;
    let mean = |points: &[Point3<f64>]| points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count;
    let (source_mean, target_mean) = (mean(source), mean(target));
    let covariance: Matrix3<f64> = source
        .iter()
        .zip(target)
        .map(|(p, q)| (p.coords - source_mean) * (q.coords - target_mean).transpose())
        .sum();
    let rotation = rotation_from_covariance(&covariance);
    Rigid { rotation, translation: target_mean - rotation * source_mean }
}

/// Least-squares transform of weighted pairs of points, by the same formula; the weights are positive.
pub fn fit_weighted(source: &[Point3<f64>], target: &[Point3<f64>], weights: &[f64]) -> Rigid {
    fit_posed(source, target, weights, &Matrix3::zeros())
}

/// As [`fit_weighted`], with the rotation also attracted to others: `turns` is the weighted sum of these
/// (added to `H^T`).
pub fn fit_posed(
    source: &[Point3<f64>],
    target: &[Point3<f64>],
    weights: &[f64],
    turns: &Matrix3<f64>,
) -> Rigid {
    let total: f64 = weights.iter().sum();
    let mean = |points: &[Point3<f64>]| {
        points.iter().zip(weights).map(|(p, &w)| p.coords * w).sum::<Vector3<f64>>() / total
    };
    let (source_mean, target_mean) = (mean(source), mean(target));
    let mut covariance = turns.transpose();
    for ((p, q), &weight) in source.iter().zip(target).zip(weights) {
        covariance += (p.coords - source_mean) * (q.coords - target_mean).transpose() * weight;
    }
    let rotation = rotation_from_covariance(&covariance);
    Rigid { rotation, translation: target_mean - rotation * source_mean }
}

/// Least-squares rigid transform between two triangles, in closed form.
///
/// Both triangles are planar, so the covariance is a 2x2 matrix H between the planes' bases. The best
/// rotation is the best planar rotation if `det H >= 0`; else the best planar reflection, made proper in
/// space by flipping the plane.
pub fn fit_triangle(p: &[Point3<f64>; 3], q: &[Point3<f64>; 3]) -> Rigid {
    let mean = |t: &[Point3<f64>; 3]| (t[0].coords + t[1].coords + t[2].coords) / 3.0;
    let (p_mean, q_mean) = (mean(p), mean(q));
    let (p_basis, q_basis) = (plane_basis(p), plane_basis(q));
    let mut h = [[0.0; 2]; 2];
    for k in 0..3 {
        let (a, b) = (p[k].coords - p_mean, q[k].coords - q_mean);
        let a = [a.dot(&p_basis[0]), a.dot(&p_basis[1])];
        let b = [b.dot(&q_basis[0]), b.dot(&q_basis[1])];
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            h[i][j] += a[i] * b[j];
        }
    }
    let orientation = if h[0][0] * h[1][1] - h[0][1] * h[1][0] < 0.0 { -1.0 } else { 1.0 };
    // Maximizes tr(R H) over [[c, -o s], [s, o c]] with o the orientation.
    let (c, s) = (h[0][0] + orientation * h[1][1], h[0][1] - orientation * h[1][0]);
    let length = c.hypot(s);
    let (c, s) = if length > 0.0 { (c / length, s / length) } else { (1.0, 0.0) };
    let x = q_basis[0] * c + q_basis[1] * s;
    let y = (q_basis[1] * c - q_basis[0] * s) * orientation;
    let z = q_basis[2] * orientation;
    let p_axes = Matrix3::from_rows(&[p_basis[0], p_basis[1], p_basis[2]].map(|axis| axis.transpose()));
    let rotation = Matrix3::from_columns(&[x, y, z]) * p_axes;
    Rigid { rotation, translation: q_mean - rotation * p_mean }
}

/// Orthonormal, right-handed: two axes in the triangle's plane and its normal.
fn plane_basis(triangle: &[Point3<f64>; 3]) -> [Vector3<f64>; 3] {
    let x = (triangle[1] - triangle[0]).normalize();
    let z = x.cross(&(triangle[2] - triangle[0])).normalize();
    [x, z.cross(&x), z]
}

/// Least-squares transform of the correspondences `indices`, in the data's own coordinates.
///
/// # Errors
/// [`Error::NoConsensus`] for fewer than three correspondences, or collinear ones; [`Error::OutOfMemory`].
pub fn fit_group(source: &Points, target: &Points, indices: &[usize]) -> Result<Rigid> {
    if indices.len() < 3 {
        let reason = format!("the group has {} correspondences; a rigid transform needs 3", indices.len());
        return Err(Error::NoConsensus { reason });
    }
    let p = memory::collect(indices.iter().map(|&i| source.get(i)))?;
    let q = memory::collect(indices.iter().map(|&i| target.get(i)))?;
    if !fixes_rotation(&p, &q) {
        let reason = "the group's points lie on one line; they leave a rotation open".to_owned();
        return Err(Error::NoConsensus { reason });
    }
    Ok(fit_rigid(&p, &q).uncentered(source, target))
}

/// Least-squares transform between the centred points of some rows; `None` if they do not determine the
/// rotation.
///
/// # Errors
/// [`Error::OutOfMemory`].
pub fn fit_rows(
    source: &Points,
    target: &Points,
    rows: impl Iterator<Item = usize> + Clone,
) -> Result<Option<Rigid>> {
    let p = memory::collect(rows.clone().map(|i| source.get(i)))?;
    let q = memory::collect(rows.map(|i| target.get(i)))?;
    Ok(fixes_rotation(&p, &q).then(|| fit_rigid(&p, &q)))
}

/// Whether matched points determine a rotation: three or more, not collinear on either side.
pub fn fixes_rotation(source: &[Point3<f64>], target: &[Point3<f64>]) -> bool {
    source.len() >= 3 && !is_collinear(source) && !is_collinear(target)
}

/// The rotation R that is nearest to `H^T`, `H = sum a b^T`, so that `R a` is nearest to b.
pub(crate) fn rotation_from_covariance(covariance: &Matrix3<f64>) -> Matrix3<f64> {
    let scale = covariance.amax();
    // The iteration would not end for NaN or infinity.
    if scale == 0.0 || !covariance.iter().all(|entry| entry.is_finite()) {
        return Matrix3::identity();
    }
    let svd = (covariance / scale).svd_unordered(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Matrix3::identity();
    };
    let mut values: [f64; 3] = svd.singular_values.into();
    values.sort_by(f64::total_cmp);
    if values[1] < THIN * values[2] {
        return Singular::of(&covariance.transpose()).rotation();
    }
    let v = v_t.transpose();
    // A reflection is undone along the direction of the smallest singular value.
    let weakest = svd.singular_values.imin();
    let mut sign = Matrix3::identity();
    sign[(weakest, weakest)] = (v * u.transpose()).determinant().signum();
    v * sign * u.transpose()
}

fn is_collinear(points: &[Point3<f64>]) -> bool {
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let extent = points.iter().map(|p| (p.coords - mean).amax()).fold(0.0, f64::max);
    if extent == 0.0 || !extent.is_finite() {
        return true;
    }
    let offsets = points.iter().map(|p| (p.coords - mean) / extent);
    let scatter: Matrix3<f64> = offsets.map(|offset| offset * offset.transpose()).sum();
    let mut eigenvalues = scatter.symmetric_eigenvalues();
    eigenvalues.as_mut_slice().sort_by(f64::total_cmp);
    eigenvalues[1] <= LINE_FLATNESS * eigenvalues[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Unit};

    fn tetrahedron() -> Vec<Point3<f64>> {
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]].map(Point3::from).to_vec()
    }

    #[test]
    fn recovers_a_motion() {
        let axis = Unit::new_normalize(Vector3::new(1.0, -2.0, 0.5));
        let rotation = Rotation3::from_axis_angle(&axis, 2.5);
        let shift = Vector3::new(10.0, -4.0, 7.0);
        let target: Vec<_> = tetrahedron().iter().map(|p| rotation * p + shift).collect();
        let fit = fit_rigid(&tetrahedron(), &target);
        assert!((fit.rotation - rotation.matrix()).amax() < 1e-12);
        assert!((fit.translation - shift).amax() < 1e-12);
    }

    #[test]
    fn never_reflects() {
        let mirrored: Vec<_> = tetrahedron().iter().map(|p| Point3::new(-p.x, p.y, p.z)).collect();
        let fit = fit_rigid(&tetrahedron(), &mirrored);
        assert!((fit.rotation.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn closed_form_equals_the_svd() {
        for k in 0..200 {
            let number = |i: usize| 0.5 * (12.9 * f64::from(k) + 78.2 * i as f64).sin();
            let point = |i: usize| Point3::new(number(i), number(i + 1), number(i + 2));
            let (p, q) = ([point(0), point(3), point(6)], [point(9), point(12), point(15)]);
            let (closed, svd) = (fit_triangle(&p, &q), fit_rigid(&p, &q));
            let cost = |fit: &Rigid| (0..3).map(|i| (fit.apply(&p[i]) - q[i]).norm_squared()).sum::<f64>();
            assert!((closed.rotation.determinant() - 1.0).abs() < 1e-9);
            assert!((cost(&closed) - cost(&svd)).abs() < 1e-9, "{k}: {} {}", cost(&closed), cost(&svd));
        }
    }

    #[test]
    fn refuses_a_line() -> Result<()> {
        for k in 0..200 {
            let f = f64::from(k);
            let (direction, scale) = ([f.sin(), (1.7 * f).cos(), (2.3 * f).sin()], 10_f64.powi(k % 50 - 25));
            let rows: Vec<[f64; 3]> =
                (0..5).map(|i| direction.map(|axis| (axis * f64::from(i) + 0.3) * scale)).collect();
            let points = Points::from_rows("source", &rows)?;
            let fit = fit_group(&points, &points, &[0, 1, 2, 3]);
            assert!(matches!(fit, Err(Error::NoConsensus { .. })), "{direction:?}");
        }
        Ok(())
    }

    #[test]
    fn fits_far_from_the_origin() -> Result<()> {
        let rows: Vec<[f64; 3]> = tetrahedron().iter().map(|p| [p.x + 1e7, p.y, p.z]).collect();
        let moved: Vec<[f64; 3]> = rows.iter().map(|r| [r[0] - 1e7, r[1], r[2]]).collect();
        let (source, target) = (Points::from_rows("source", &rows)?, Points::from_rows("target", &moved)?);
        let fit = fit_group(&source, &target, &[0, 1, 2, 3])?;
        assert!((fit.rotation - Matrix3::identity()).amax() < 1e-12);
        assert!((fit.translation.x + 1e7).abs() < 1e-6);
        Ok(())
    }
}
