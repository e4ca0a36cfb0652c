//! Least-squares rigid fit (Kabsch): the transform that maps source points onto target points.

use nalgebra::{Matrix3, Matrix4, Point3, Vector3};

use crate::error::{Error, Result};
use crate::points::Points;

/// Points whose second principal variance is below this share of the first lie on a line: rounding makes
/// about as much of points that do so exactly.
const LINE_FLATNESS: f64 = 1e-14;

/// A rigid transform `q = R p + t` on column vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigid {
    /// Rotation R.
    pub rotation: Matrix3<f64>,
    /// Translation t.
    pub translation: Vector3<f64>,
}

impl Rigid {
    /// Applies the transform.
    #[inline]
    pub fn apply(&self, p: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation * p.coords + self.translation)
    }

    /// The same motion between points that were not centred.
    #[must_use]
    pub fn uncentered(&self, source: &Points, target: &Points) -> Self {
        let translation = self.translation + target.center() - self.rotation * source.center();
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

/// Least-squares transform of the correspondences `indices`, in the data's own coordinates.
///
/// # Errors
/// [`Error::NoConsensus`] for fewer than three correspondences, or where they lie on one line.
pub fn fit_group(source: &Points, target: &Points, indices: &[usize]) -> Result<Rigid> {
    if indices.len() < 3 {
        let reason = format!("the group has {} correspondences; a rigid transform needs 3", indices.len());
        return Err(Error::NoConsensus { reason });
    }
    let p: Vec<_> = indices.iter().map(|&i| source.get(i)).collect();
    let q: Vec<_> = indices.iter().map(|&i| target.get(i)).collect();
    if !fixes_rotation(&p, &q) {
        let reason = "the group's points lie on one line; they leave a rotation open".to_owned();
        return Err(Error::NoConsensus { reason });
    }
    Ok(fit_rigid(&p, &q).uncentered(source, target))
}

/// Whether matched points fix a rotation: three or more, not on a line on either side.
pub fn fixes_rotation(source: &[Point3<f64>], target: &[Point3<f64>]) -> bool {
    source.len() >= 3 && !is_collinear(source) && !is_collinear(target)
}

fn rotation_from_covariance(covariance: &Matrix3<f64>) -> Matrix3<f64> {
    let scale = covariance.amax();
    if scale == 0.0 {
        return Matrix3::identity();
    }
    let svd = (covariance / scale).svd_unordered(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Matrix3::identity();
    };
    let v = v_t.transpose();
    // The reflection, if any, is undone along the direction of the smallest singular value.
    let weakest = svd.singular_values.imin();
    let mut sign = Matrix3::identity();
    sign[(weakest, weakest)] = (v * u.transpose()).determinant().signum();
    v * sign * u.transpose()
}

fn is_collinear(points: &[Point3<f64>]) -> bool {
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let extent = points.iter().map(|p| (p.coords - mean).amax()).fold(0.0, f64::max);
    if extent == 0.0 {
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
