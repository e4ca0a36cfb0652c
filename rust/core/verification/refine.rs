//! Point-to-plane refinement of a pose (Chen and Medioni, *Object modelling by registration of multiple range
//! images*, 1992), with a reach that shrinks from step to step.

use nalgebra::{Matrix6, Vector6};

use crate::verification::pose::Pose;
use crate::verification::score::agree;
use crate::verification::surface::Surface;

/// Least cosine between normals of points that are laid on each other.
const COSINE: f32 = 0.5;
/// Pairs below which a pose stays as it is.
const LEAST_PAIRS: usize = 10;
/// Added to the diagonal, as a share of its greatest entry: motions that the surfaces don't resist are not made.
const DAMPING: f64 = 1e-6;
/// Radians and units: a smaller motion ends the refinement.
const STILL: f64 = 1e-5;

/// How a pose is refined. Lengths are in units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Refinement {
    pub samples: usize,
    pub steps: usize,
    /// Distance of points that are laid on each other, in the first and in the last step.
    pub reach: (f32, f32),
    pub coarse: bool,
}

/// The normal equations of one step: `A x = b` with x a rotation vector and a translation.
pub(super) struct Equations {
    pub matrix: Matrix6<f64>,
    pub right: Vector6<f64>,
    /// Sum of the pairs' weights.
    pub weight: f64,
    pub pairs: usize,
}

/// The pose moved so that the source's samples lie on the planes of the target's points.
pub(super) fn refine(source: &Surface, target: &Surface, pose: &Pose, how: &Refinement) -> Pose {
    let mut pose = *pose;
    for step in 0..how.steps {
        let share = step as f32 / (how.steps.max(2) - 1) as f32;
        let reach = how.reach.0 + (how.reach.1 - how.reach.0) * share;
        let equations = equations(source, target, &pose, reach, how);
        let Some(motion) = solve(&equations) else { break };
        let (turn, shift) = (motion.fixed_rows::<3>(0).into_owned(), motion.fixed_rows::<3>(3).into_owned());
        pose = pose.followed_by(turn, shift);
        if share >= 1.0 && motion.amax() < STILL {
            break;
        }
    }
    pose.orthonormal()
}

fn solve(equations: &Equations) -> Option<Vector6<f64>> {
    if equations.pairs < LEAST_PAIRS {
        return None;
    }
    let damping = DAMPING * equations.matrix.diagonal().max();
    let matrix = equations.matrix + Matrix6::identity() * damping;
    let motion = matrix.cholesky()?.solve(&equations.right);
    motion.iter().all(|number| number.is_finite()).then_some(motion)
}

/// Pairs of samples and nearest points within reach, weighted `1 - d^2 / reach^2`.
pub(super) fn equations(
    source: &Surface,
    target: &Surface,
    pose: &Pose,
    reach: f32,
    how: &Refinement,
) -> Equations {
    let mut sums = Equations { matrix: Matrix6::zeros(), right: Vector6::zeros(), weight: 0.0, pairs: 0 };
    let oriented = source.is_oriented() && target.is_oriented();
    for sample in source.samples(how.samples) {
        let place = pose.rotation * sample.point + pose.translation;
        let Some(near) = target.nearest(&place, how.coarse) else { continue };
        let d = place - near.point;
        let weight = 1.0 - d.norm_squared() / (reach * reach);
        if weight > 0.0 && agree(sample, near, pose, oriented) >= COSINE {
            let turn = place.cross(&near.normal);
            let row = Vector6::new(turn.x, turn.y, turn.z, near.normal.x, near.normal.y, near.normal.z);
            sums.add(&row.map(f64::from), f64::from(d.dot(&near.normal)), f64::from(weight));
        }
    }
    sums
}

impl Equations {
    fn add(&mut self, row: &Vector6<f64>, residual: f64, weight: f64) {
        self.matrix.ger(weight, row, row, 1.0);
        self.right.axpy(-weight * residual, row, 1.0);
        self.weight += weight;
        self.pairs += 1;
    }
}
