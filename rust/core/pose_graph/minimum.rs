//! The minimum of the cost by the Levenberg-Marquardt method, and covariances there.

use nalgebra::Matrix6;

use super::Link;
use super::conjugate::EXACT;
use super::linearization::Linearization;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::geometry::rigid::Rigid;
use crate::memory;

/// Stopping criteria of the minimization.
pub struct Precision {
    /// Maximum number of steps.
    pub steps: usize,
    /// Least relative decrease of the cost per step.
    pub decrease: f64,
    /// Reduction of the gradient by the conjugate gradients of a step.
    pub reduction: f64,
}

/// Precision of final results.
pub const FINE: Precision = Precision { steps: 100, decrease: 1e-7, reduction: 1e-6 };

const FIRST_DAMPING: f64 = 1e-6;
const LEAST_DAMPING: f64 = 1e-9;
const MOST_DAMPING: f64 = 1e8;

/// Minimizes the cost of all links over the poses.
pub fn minimize(
    poses: &mut Vec<Rigid>,
    links: &[Link],
    precision: &Precision,
    execution: &Execution,
) -> Result<()> {
    minimize_weighted(poses, links.iter().map(|&link| (link, 1.0)), precision, execution)
}

/// Minimizes the cost of weighted links over the poses; nodes without a link keep their pose.
pub fn minimize_weighted<'a>(
    poses: &mut Vec<Rigid>,
    links: impl Iterator<Item = (Link<'a>, f64)>,
    precision: &Precision,
    execution: &Execution,
) -> Result<()> {
    let mut problem = Linearization::new(poses.len(), links, 1)?;
    let mut cost = problem.cost(poses)?;
    let mut damping = FIRST_DAMPING;
    let mut diagonal = memory::filled(0.0, problem.system.len())?;
    let mut step = memory::filled(0.0, problem.system.len())?;
    for round in 0..precision.steps {
        execution.report(round, precision.steps)?;
        if cost == 0.0 || step.is_empty() {
            break;
        }
        problem.linearize(poses, execution)?;
        diagonal.iter_mut().zip(problem.system.diagonal()).for_each(|(slot, entry)| *slot = entry);
        let before = cost;
        while damping <= MOST_DAMPING {
            execution.check()?;
            problem.system.set_diagonal(diagonal.iter().map(|entry| entry * (1.0 + damping)));
            step.iter_mut().zip(&problem.gradient).for_each(|(slot, slope)| *slot = -slope);
            if problem.system.factorize() && problem.system.solve(&mut step, precision.reduction)? {
                let moved = problem.moved(poses, &step)?;
                let reached = problem.cost(&moved)?;
                if reached <= cost {
                    let expected: f64 = step
                        .iter()
                        .zip(&problem.gradient)
                        .zip(&diagonal)
                        .map(|((d, slope), entry)| 0.5 * d * (damping * entry * d - slope))
                        .sum();
                    if cost - reached > 0.25 * expected {
                        damping = (damping / 10.0).max(LEAST_DAMPING);
                    }
                    (*poses, cost) = (moved, reached);
                    break;
                }
            }
            damping *= 10.0;
        }
        if before - cost <= precision.decrease * before {
            break;
        }
    }
    Ok(())
}

/// Marginal covariances of nodes; zero if a node is fixed.
pub fn covariances(
    poses: &[Rigid],
    links: &[Link],
    nodes: &[usize],
    execution: &Execution,
) -> Result<Vec<Matrix6<f64>>> {
    let mut problem = Linearization::new(poses.len(), links.iter().map(|&link| (link, 1.0)), 6)?;
    problem.linearize(poses, execution)?;
    let open = || {
        let got = "edges that leave poses open";
        Error::invalid("information", got, "give positive definite matrices")
    };
    if !problem.system.factorize() {
        return Err(open());
    }
    let rows = problem.system.len();
    let mut sides = memory::filled(0.0, 6 * rows)?;
    let mut found = memory::filled(Matrix6::zeros(), nodes.len())?;
    for (done, (&node, covariance)) in nodes.iter().zip(&mut found).enumerate() {
        execution.report(done, nodes.len())?;
        let Some(first) = problem.unknown(node).map(|unknown| 6 * unknown) else { continue };
        sides.fill(0.0);
        (0..6).for_each(|k| sides[k * rows + first + k] = 1.0);
        if !problem.system.solve(&mut sides, EXACT)? {
            return Err(open());
        }
        let solved = Matrix6::from_fn(|row, column| sides[column * rows + first + row]);
        *covariance = (solved + solved.transpose()) * 0.5;
    }
    Ok(found)
}
