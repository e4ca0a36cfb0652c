//! Overlap of two surfaces under a pose: fitness, RMSE, and constrained motions.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use nalgebra::{Matrix3, Matrix6, SymmetricEigen, Vector3, Vector6};
use rayon::prelude::*;

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::own_axes::OwnFrame;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::simd;
use crate::verification::group::{Element, Group, LANES};
use crate::verification::pose::Pose;
use crate::verification::refine::equations;
use crate::verification::schedule::{FINELY, LAST};
use crate::verification::surface::{Surface, look_at};

/// A motion is unconstrained if its resistance is below this share of that of all pairs facing it. Planes
/// whose normals are known to 5 degrees have 0.008.
const OPEN: f64 = 0.01;

/// Points per partial sum.
const CHUNK: usize = 1024;

/// Measures of how well two surfaces overlap under a pose.
#[derive(Debug, Clone)]
pub struct Overlap {
    /// Share of the source's points with a normal that lie on the target's surface.
    pub fitness: f64,
    /// Root mean square of their distances to the target's planes, in the data's unit; NaN without such
    /// points.
    pub inlier_rmse: f64,
    /// Motions that the surfaces constrain.
    pub resistance: Resistance,
}

/// Motions that two surfaces constrain under a pose.
#[derive(Debug, Clone)]
pub struct Resistance {
    /// `sum w J J^T` of the last point-to-plane step. J is the derivative of a pair's distance with respect
    /// to a rotation vector about the target's origin and a translation, in the target's coordinates and the
    /// data's unit.
    pub information: Matrix6<f64>,
    /// The least constrained motion (rotation vector, translation), if the surfaces hardly constrain it; in
    /// the same coordinates, scaled to move the surfaces by about one unit.
    pub open_motion: Option<Vector6<f64>>,
}

impl Resistance {
    /// Computes the resistance from the matrix and the weight of the normal equations, in units and the
    /// target's frame; `radius` is that of the surfaces, in units.
    pub(super) fn new(matrix: &Matrix6<f64>, weight: f64, radius: f64, unit: f64, frame: &OwnFrame) -> Self {
        let mut turn = Matrix6::zeros();
        turn.fixed_view_mut::<3, 3>(0, 0).copy_from(&frame.axes);
        turn.fixed_view_mut::<3, 3>(3, 3).copy_from(&frame.axes);
        let matrix = turn.transpose() * matrix * turn;
        Self {
            information: in_data(&matrix, unit, &frame.center),
            open_motion: open_motion(&matrix, weight, radius)
                .map(|motion| moved_to_origin(&motion, unit, &frame.center)),
        }
    }
}

/// Measures the overlap of two surfaces.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn overlap(source: &Surface, target: &Surface, pose: &Rigid, execution: &Execution) -> Result<Overlap> {
    look_at(source, target, || measure(source, target, pose, execution))
}

fn measure(source: &Surface, target: &Surface, pose: &Rigid, execution: &Execution) -> Result<Overlap> {
    let local = source.pose_onto(target, pose);
    let (fitness, rmse) = shared(source, target, &local, execution)?;
    let sums = equations(source, target, &local, FINELY.reach.1, &FINELY);
    let matrix = sums.matrix();
    let radius = f64::from(source.radius().max(target.radius()));
    Ok(Overlap {
        fitness,
        inlier_rmse: rmse * source.unit(),
        resistance: Resistance::new(&matrix, sums.weight, radius, target.unit(), target.frame()),
    })
}

/// Share of the source's points on the target, and root mean square of their distances in units.
fn shared(source: &Surface, target: &Surface, pose: &Pose, execution: &Execution) -> Result<(f64, f64)> {
    let oriented = source.is_oriented() && target.is_oriented();
    let of_chunk = |elements: &[Element]| {
        execution.check()?;
        let mut sums = Shared::default();
        simd::run(
            #[inline(always)]
            || elements.chunks(LANES).for_each(|elements| sums.add(elements, target, pose, oriented)),
        );
        Ok(sums)
    };
    // Chunks of a fixed size make the sums the same on any number of threads.
    let chunks = memory::par_try_collect(source.elements().par_chunks(CHUNK).map(of_chunk))?;
    let [points, inliers] = [|sums: &Shared| sums.points, |sums: &Shared| sums.inliers]
        .map(|count| chunks.iter().map(count).sum::<usize>() as f64);
    let squares: f64 = chunks.iter().map(|sums| sums.squares).sum();
    Ok((inliers / points, (squares / inliers).sqrt()))
}

/// Number of points with a normal, number of those on the other surface, and the sum of their squared
/// distances to its planes.
#[derive(Debug, Clone, Default)]
struct Shared {
    points: usize,
    inliers: usize,
    squares: f64,
}

impl Shared {
    #[inline(always)]
    fn add(&mut self, elements: &[Element], target: &Surface, pose: &Pose, oriented: bool) {
        let moved = Group::of(elements).moved(pose);
        let (is_near, near) = target.nearest(&moved.point, false);
        let with_normal = |lane: &usize| elements[*lane].normal != Vector3::zeros();
        for lane in (0..elements.len()).filter(with_normal) {
            self.points += 1;
            let [dx, dy, dz] = moved.offset(&near, lane);
            let plane = dx * near.normal[0][lane] + dy * near.normal[1][lane] + dz * near.normal[2][lane];
            let agrees = moved.cosine(&near, oriented, lane) > LAST.cosine;
            if is_near[lane] && plane.abs() < LAST.tolerance && agrees {
                self.inliers += 1;
                self.squares += f64::from(plane * plane);
            }
        }
    }
}

/// Converts from motions about the target's mean, in units and the frame's axes, to motions about its origin
/// in the data's unit.
fn in_data(matrix: &Matrix6<f64>, unit: f64, center: &Vector3<f64>) -> Matrix6<f64> {
    let mut change = Matrix6::identity() * unit;
    let turn: Matrix3<f64> = center.cross_matrix();
    change.fixed_view_mut::<3, 3>(3, 0).copy_from(&-turn);
    change.fixed_view_mut::<3, 3>(3, 3).copy_from(&Matrix3::identity());
    change.transpose() * matrix * change
}

/// The least constrained motion, about the target's mean and in units; `None` if it is constrained.
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
