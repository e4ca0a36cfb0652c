//! What one pose says about two surfaces: how much they share, how closely, and which motions they resist.

use nalgebra::{Matrix3, Matrix6, SymmetricEigen, Vector3, Vector6};

use crate::geometry::rigid::Rigid;
use crate::verification::pose::Pose;
use crate::verification::refine::equations;
use crate::verification::schedule::{FINELY, LAST};
use crate::verification::score::agree;
use crate::verification::surface::Surface;

/// A motion is open where its resistance is below this share of that of all pairs facing it: planes whose normals are
/// known to 5 degrees have 0.008.
const OPEN: f64 = 0.01;

/// How two surfaces lie on each other under a pose.
#[derive(Debug, Clone)]
pub struct Overlap {
    /// Share of the source's points with a normal that lie on the target's surface.
    pub fitness: f64,
    /// Root mean square of their distances to its planes, in the data's unit; NaN where there are none.
    pub inlier_rmse: f64,
    /// Which motions the surfaces resist.
    pub resistance: Resistance,
}

/// Which motions two surfaces resist under a pose.
#[derive(Debug, Clone)]
pub struct Resistance {
    /// `sum w J J^T` of the last point-to-plane step, J the motion of a pair's distance with a rotation vector about the
    /// target's origin and a translation, in the target's coordinates and the data's unit.
    pub information: Matrix6<f64>,
    /// The motion (rotation vector, translation) that the surfaces resist least, where they hardly do; in the same
    /// coordinates, of a size that moves the surfaces by about one unit.
    pub open_motion: Option<Vector6<f64>>,
}

impl Resistance {
    /// From the matrix and the weight of normal equations in units, about the target's centre; `radius` is that of the
    /// surfaces, in units.
    pub(super) fn new(
        matrix: &Matrix6<f64>,
        weight: f64,
        radius: f64,
        unit: f64,
        center: &Vector3<f64>,
    ) -> Self {
        Self {
            information: in_data(matrix, unit, center),
            open_motion: open_motion(matrix, weight, radius)
                .map(|motion| moved_to_origin(&motion, unit, center)),
        }
    }
}

/// Measures the overlap of two surfaces.
pub fn overlap(source: &Surface, target: &Surface, pose: &Rigid) -> Overlap {
    let local = Pose::between(source, target, pose);
    let (fitness, rmse) = shared(source, target, &local);
    let sums = equations(source, target, &local, FINELY.reach.1, &FINELY);
    let radius = f64::from(source.radius().max(target.radius()));
    Overlap {
        fitness,
        inlier_rmse: rmse * source.unit(),
        resistance: Resistance::new(&sums.matrix, sums.weight, radius, target.unit(), &target.center()),
    }
}

/// Share of the source's points on the target, and root mean square of their distances in units.
fn shared(source: &Surface, target: &Surface, pose: &Pose) -> (f64, f64) {
    let oriented = source.is_oriented() && target.is_oriented();
    let (mut points, mut inliers, mut squares) = (0_usize, 0_usize, 0.0);
    for element in source.elements().iter().filter(|element| element.normal != Vector3::zeros()) {
        points += 1;
        let place = pose.rotation * element.point + pose.translation;
        let Some(near) = target.nearest(&place, false) else { continue };
        let plane = (place - near.point).dot(&near.normal);
        if plane.abs() < LAST.tolerance && agree(element, near, pose, oriented) > LAST.cosine {
            inliers += 1;
            squares += f64::from(plane * plane);
        }
    }
    (inliers as f64 / points as f64, (squares / inliers as f64).sqrt())
}

/// From motions about the target's mean, in units, to motions about its origin in the data's unit.
fn in_data(matrix: &Matrix6<f64>, unit: f64, center: &Vector3<f64>) -> Matrix6<f64> {
    let mut change = Matrix6::identity() * unit;
    let turn: Matrix3<f64> = center.cross_matrix();
    change.fixed_view_mut::<3, 3>(3, 0).copy_from(&-turn);
    change.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::identity());
    change.transpose() * matrix * change
}

/// The motion of the least resistance, about the target's mean and in units; none where it is resisted.
fn open_motion(matrix: &Matrix6<f64>, weight: f64, radius: f64) -> Option<Vector6<f64>> {
    let mut scale = Vector6::repeat(1.0);
    scale.fixed_rows_mut::<3>(0).fill(1.0 / radius);
    let scale = Matrix6::from_diagonal(&scale);
    let eigen = SymmetricEigen::new(scale * matrix * scale);
    let least = eigen.eigenvalues.imin();
    (eigen.eigenvalues[least] <= OPEN * weight).then(|| scale * eigen.eigenvectors.column(least))
}

fn moved_to_origin(motion: &Vector6<f64>, unit: f64, center: &Vector3<f64>) -> Vector6<f64> {
    let turn = Vector3::new(motion[0], motion[1], motion[2]);
    let shift = Vector3::new(motion[3], motion[4], motion[5]) * unit - turn.cross(center);
    Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
}
