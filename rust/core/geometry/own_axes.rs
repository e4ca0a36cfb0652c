//! The intrinsic axes of a cloud, independent of its frame: grids along them divide it in the same way.

use nalgebra::{Matrix3, Vector3};

use crate::error::Result;
use crate::features::normals::{add_products, symmetric};
use crate::geometry::rigid::Rigid;
use crate::geometry::symmetric::eigen;
use crate::points::Points;

/// Rotation from the frame of the points to their intrinsic axes: the principal axes, the longest first, the
/// first two towards the side of the longer tail (a positive third moment).
///
/// It rotates with the points, up to rounding. If two principal variances are equal, or a third moment is
/// zero, as for exactly symmetric shapes, rounding decides.
pub fn own_axes(points: &Points) -> Matrix3<f64> {
    let unit = points.diagonal();
    if unit <= 0.0 {
        return Matrix3::identity();
    }
    let per_length = 1.0 / unit;
    let rows = || {
        let axes = points.x.iter().zip(&points.y).zip(&points.z);
        axes.map(|((x, y), z)| Vector3::new(x * per_length, y * per_length, z * per_length))
    };
    let mut products = [0.0; 6];
    rows().for_each(|row| add_products(&mut products, &row, &row));
    let [_, second, first] = eigen(&symmetric(&products)).vectors;
    let tails = rows().map(|row| [first, second].map(|axis| axis.dot(&row).powi(3)));
    let tails = tails.fold([0.0; 2], |sums, tails| [sums[0] + tails[0], sums[1] + tails[1]]);
    let towards = |axis: Vector3<f64>, tail: f64| if tail < 0.0 { -axis } else { axis };
    let (first, second) = (towards(first, tails[0]), towards(second, tails[1]));
    Matrix3::from_rows(&[first.transpose(), second.transpose(), first.cross(&second).transpose()])
}

/// The frame of a cloud's intrinsic axes about its centre.
#[derive(Debug, Clone, Copy)]
pub struct OwnFrame {
    /// Rotation from the data's axes to the cloud's own.
    pub axes: Matrix3<f64>,
    /// Its origin, in the data's coordinates.
    pub(crate) center: Vector3<f64>,
}

impl OwnFrame {
    /// Computes the frame of the points about their mean, and the points in that frame.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn of(points: &Points) -> Result<(Self, Points)> {
        let axes = own_axes(points);
        Ok((Self { axes, center: points.center() }, points.turned(&axes)?))
    }

    /// Converts a point of this frame to the data's coordinates.
    pub(crate) fn in_data(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.axes.tr_mul(point) + self.center
    }

    /// Converts a pose of the data to one from this frame into another.
    pub(crate) fn pose_onto(&self, target: &Self, pose: &Rigid) -> Rigid {
        let moved = pose.rotation * self.center + pose.translation - target.center;
        Rigid {
            rotation: target.axes * pose.rotation * self.axes.transpose(),
            translation: target.axes * moved,
        }
    }

    /// Converts a pose from this frame into another to one of the data.
    pub(crate) fn pose_in_data(&self, target: &Self, pose: &Rigid) -> Rigid {
        let rotation = target.axes.transpose() * pose.rotation * self.axes;
        let shift = target.axes.tr_mul(&pose.translation);
        Rigid { rotation, translation: shift + target.center - rotation * self.center }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Rotation3};

    use super::*;

    /// Points with a tail along each axis.
    fn tailed() -> Vec<[f64; 3]> {
        let wave = |i: u32, f: f64| (f64::from(i) * f).sin().exp();
        (0..500).map(|i| [5.0 * wave(i, 1.1), 3.0 * wave(i, 2.3), wave(i, 3.7)]).collect()
    }

    #[test]
    fn axes_rotate_with_the_points() -> Result<()> {
        let rows = tailed();
        let still = own_axes(&Points::from_rows("points", &rows)?);
        assert!((still * still.transpose() - Matrix3::identity()).amax() < 1e-12);
        assert!((still.determinant() - 1.0).abs() < 1e-12);
        for turn in [[0.3, -1.0, 2.0], [3.0, 0.1, 0.2], [0.0, 0.0, 1.5]] {
            let turn = Rotation3::new(Vector3::from(turn)).into_inner();
            let moved = |row: &[f64; 3]| (turn * Point3::from(*row) + Vector3::repeat(7.0)).coords.into();
            let mut moved: Vec<[f64; 3]> = rows.iter().map(moved).collect();
            moved.reverse();
            let axes = own_axes(&Points::from_rows("points", &moved)?);
            assert!((axes * turn - still).amax() < 1e-10);
        }
        Ok(())
    }

    #[test]
    fn any_cloud_has_axes() -> Result<()> {
        let line: Vec<[f64; 3]> = (0..9).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        let cube: Vec<[f64; 3]> = (0..8).map(|i| [i % 2, i / 2 % 2, i / 4].map(f64::from)).collect();
        let far: Vec<[f64; 3]> = tailed().iter().map(|row| row.map(|x| 1e140 * x)).collect();
        let near: Vec<[f64; 3]> = tailed().iter().map(|row| row.map(|x| 1e-50 * x)).collect();
        for rows in [vec![], vec![[1.0; 3]; 5], line, cube, far, near] {
            let axes = own_axes(&Points::from_rows("points", &rows)?);
            assert!((axes * axes.transpose() - Matrix3::identity()).amax() < 1e-12, "{axes}");
        }
        Ok(())
    }
}
