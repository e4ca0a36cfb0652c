//! Point-to-plane refinement of a pose (Chen and Medioni, *Object modelling by registration of multiple range
//! images*, 1992), with a reach that shrinks from step to step.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use nalgebra::{Matrix6, Vector6};

use crate::simd;
use crate::verification::group::{Group, LANES};
use crate::verification::pose::Pose;
use crate::verification::surface::Surface;

/// Least cosine between the normals of paired points.
const COSINE: f32 = 0.5;
/// With fewer pairs the pose is not changed.
const LEAST_PAIRS: usize = 10;
/// Added to the diagonal, relative to its largest entry: suppresses motions that the surfaces do not
/// constrain.
const DAMPING: f64 = 1e-6;
/// Entries per column of the equations; six are used.
const COLUMN: usize = 8;

/// Parameters of a refinement. Lengths are in units.
#[derive(Debug, Clone, Copy)]
pub(super) struct Refinement {
    pub samples: usize,
    pub steps: usize,
    /// Largest distance of paired points, in the first and in the last step.
    pub reach: (f32, f32),
    /// Motion of a step, in radians and units, below which the last reach follows, and then the end.
    pub still: f64,
    pub coarse: bool,
}

/// The normal equations of one step, `A x = b` with x a rotation vector and a translation.
pub(super) struct Equations {
    /// Columns of A, then b, each padded with zeros.
    columns: [[f64; COLUMN]; 7],
    /// Sum of the pairs' weights.
    pub weight: f64,
    pub pairs: usize,
}

/// Refines a pose: minimizes the distances of the source's samples from the planes of the target's points.
pub(super) fn refine(source: &Surface, target: &Surface, pose: &Pose, how: &Refinement) -> Pose {
    let (mut pose, mut step, last) = (*pose, 0, how.steps - 1);
    while step <= last {
        let share = step as f32 / last as f32;
        let reach = how.reach.0 + (how.reach.1 - how.reach.0) * share;
        let equations = equations(source, target, &pose, reach, how);
        let Some(motion) = solve(&equations) else { break };
        let (turn, shift) = (motion.fixed_rows::<3>(0).into_owned(), motion.fixed_rows::<3>(3).into_owned());
        pose = pose.followed_by(turn, shift);
        step = if motion.amax() < how.still { last.max(step + 1) } else { step + 1 };
    }
    pose.orthonormal()
}

fn solve(equations: &Equations) -> Option<Vector6<f64>> {
    if equations.pairs < LEAST_PAIRS {
        return None;
    }
    let matrix = equations.matrix();
    let damping = DAMPING * matrix.diagonal().max();
    let matrix = matrix + Matrix6::identity() * damping;
    let motion = matrix.cholesky()?.solve(&equations.right());
    motion.iter().all(|number| number.is_finite()).then_some(motion)
}

/// Normal equations of the samples and their nearest points within reach, weighted by `1 - d^2 / reach^2`.
pub(super) fn equations(
    source: &Surface,
    target: &Surface,
    pose: &Pose,
    reach: f32,
    how: &Refinement,
) -> Equations {
    let mut sums = Equations { columns: [[0.0; COLUMN]; 7], weight: 0.0, pairs: 0 };
    let oriented = source.is_oriented() && target.is_oriented();
    let (groups, count) = source.samples(how.samples);
    simd::run(
        #[inline(always)]
        || {
            for (number, group) in groups.iter().enumerate() {
                let moved = group.moved(pose);
                let (is_near, near) = target.nearest(&moved.point, how.coarse);
                let mut weights = [0.0; LANES];
                for lane in 0..LANES {
                    let [dx, dy, dz] = moved.offset(&near, lane);
                    let weight = 1.0 - (dx * dx + dy * dy + dz * dz) / (reach * reach);
                    let agrees = is_near[lane] & (moved.cosine(&near, oriented, lane) >= COSINE);
                    weights[lane] = if agrees { weight } else { 0.0 };
                }
                for lane in (0..(count - number * LANES).min(LANES)).filter(|&lane| weights[lane] > 0.0) {
                    sums.add(&moved, &near, lane, f64::from(weights[lane]));
                }
            }
        },
    );
    sums
}

impl Equations {
    /// Adds the pair of a moved sample and its nearest point.
    #[inline(always)]
    fn add(&mut self, moved: &Group, near: &Group, lane: usize, weight: f64) {
        let [x, y, z] = [0, 1, 2].map(|k| moved.point[k][lane]);
        let [u, v, w] = [0, 1, 2].map(|k| near.normal[k][lane]);
        let [dx, dy, dz] = moved.offset(near, lane);
        let residual = f64::from(dx * u + dy * v + dz * w);
        let row = [y * w - z * v, z * u - x * w, x * v - y * u, u, v, w, 0.0, 0.0].map(f64::from);
        for (k, column) in self.columns.iter_mut().enumerate() {
            let factor = if k < 6 { weight * row[k] } else { -weight * residual };
            for (sum, value) in column.iter_mut().zip(&row) {
                *sum += factor * value;
            }
        }
        self.weight += weight;
        self.pairs += 1;
    }

    /// A.
    pub fn matrix(&self) -> Matrix6<f64> {
        Matrix6::from_fn(|row, column| self.columns[column][row])
    }

    /// b.
    fn right(&self) -> Vector6<f64> {
        Vector6::from_fn(|row, _| self.columns[6][row])
    }
}
