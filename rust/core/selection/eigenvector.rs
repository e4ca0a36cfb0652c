//! Principal eigenvector of a symmetric, non-negative matrix.

use std::ops::RangeInclusive;

use super::lanczos::{Dense, scale_to_one};
use crate::compatibility::matrix::PairMatrix;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;
use crate::options::{Value, words};
use crate::simd::sums::{dot, sum};

/// Power steps before giving up on further digits.
const MAX_STEPS: usize = 1000;

/// Greatest error of an entry, as a share of the largest one, with which the iteration ends.
const CONVERGED: f64 = 1e-9;

/// Change of an entry, as a share of the largest one, from which on entries of the matrix have to be exact:
/// about what their rounding makes.
const ROUGHLY_CONVERGED: f64 = 3e-7;

/// Smaller changes that don't fall to half may be due to rounding as well.
const DOUBTFUL: f64 = 1e-5;

/// Progress is reported in steps of one percent.
const PERCENT: usize = 100;

/// Share of the mean row sum added to the diagonal: same eigenvectors, but `-lambda` can't oscillate.
const SHIFT: f64 = 0.05;

/// Entries whose squares can be summed.
const SAFE: RangeInclusive<f64> = 1e-100..=1e100;

words! {
    /// How the eigenvector is computed.
    pub enum Eigensolver {
        /// Power iteration on the shifted matrix, O(n^2) per step.
        Power = Value::Word("power"),
        /// Lanczos's method on the stored matrix, to the last digits.
        Dense = Value::Word("dense"),
    }
}

/// An eigenvector of unit length with entries >= 0, and its eigenvalue.
#[derive(Debug, Clone, PartialEq)]
pub struct Eigenpair {
    /// The vector.
    pub vector: Vec<f64>,
    /// The eigenvalue; 0 for a zero matrix.
    pub value: f64,
    /// Power steps taken; 0 for the dense solver.
    pub steps: usize,
}

/// The eigenvector of the greatest eigenvalue.
///
/// # Errors
/// [`Error::Interrupted`], [`Error::OutOfMemory`], or [`Error::InvalidInput`] where the dense solver would exceed
/// `max_memory`.
pub fn principal_eigenvector(
    matrix: &PairMatrix,
    solver: Eigensolver,
    execution: &Execution,
) -> Result<Eigenpair> {
    let start = uniform(matrix.len())?;
    let product = matrix.multiply_rounded(&start, execution)?;
    if sum(&product) <= 0.0 {
        // Every vector is one of the zero matrix.
        return Ok(Eigenpair { vector: start, value: 0.0, steps: 0 });
    }
    match solver {
        Eigensolver::Power => power_iteration(matrix, start, product, execution),
        Eigensolver::Dense => dense(matrix, execution),
    }
}

/// Unit vector of equal entries.
fn uniform(n: usize) -> Result<Vec<f64>> {
    memory::filled(1.0 / (n.max(1) as f64).sqrt(), n)
}

/// From `start`, a unit vector of equal entries, and its product with the matrix.
fn power_iteration(
    matrix: &PairMatrix,
    start: Vec<f64>,
    product: Vec<f64>,
    execution: &Execution,
) -> Result<Eigenpair> {
    let shift = SHIFT * dot(&start, &product); // a share of the mean row sum
    let (mut vector, mut product) = (start, product);
    let mut previous_change = f64::INFINITY;
    let (mut steps, mut exact) = (0, false);
    loop {
        steps += 1;
        let value = dot(&vector, &product);
        let mut next = product;
        let scale = safe_scale(&next);
        next.iter_mut().zip(&vector).for_each(|(entry, old)| *entry = *entry * scale + shift * scale * old);
        let length = dot(&next, &next).sqrt();
        next.iter_mut().for_each(|entry| *entry /= length);
        let change = next.iter().zip(&vector).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            / next.iter().copied().fold(0.0, f64::max);
        vector = next;
        // Changes fall geometrically, so their ratio gives the sum of all later ones.
        let ratio = change / previous_change;
        let known = previous_change.is_finite() && ratio < 1.0;
        let remaining = if known { change * ratio / (1.0 - ratio) } else { change };
        let share = change.clamp(CONVERGED, 1.0).log10() / CONVERGED.log10();
        execution.report((share * PERCENT as f64) as usize, PERCENT)?;
        if (exact && remaining < CONVERGED) || steps == MAX_STEPS {
            return Ok(Eigenpair { vector, value, steps });
        }
        let refine = !exact && (change < ROUGHLY_CONVERGED || (change < DOUBTFUL && ratio > 0.5));
        previous_change = if refine { f64::INFINITY } else { change };
        exact |= refine;
        product = if exact {
            matrix.multiply(&vector, execution)?
        } else {
            matrix.multiply_rounded(&vector, execution)?
        };
    }
}

fn dense(matrix: &PairMatrix, execution: &Execution) -> Result<Eigenpair> {
    let n = matrix.len();
    let bytes = Dense::bytes(n);
    if bytes > execution.max_memory {
        let remedy = format!(
            "the dense solver needs up to {} MiB at n = {n}; use eigensolver=\"power\" or raise `max_memory`",
            bytes >> 20
        );
        return Err(Error::invalid("eigensolver", "\"dense\"", remedy));
    }
    let (value, vector) = Dense::of(matrix, execution)?.principal_eigenpair(execution)?;
    Ok(Eigenpair { vector, value, steps: 0 })
}

/// The power of two by which the squares of entries neither over- nor underflow: 1 unless they would.
fn safe_scale(entries: &[f64]) -> f64 {
    let greatest = entries.iter().copied().fold(0.0, f64::max);
    if SAFE.contains(&greatest) { 1.0 } else { scale_to_one(greatest) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compatibility::matrix::PairScore;
    use crate::points::Points;

    #[test]
    fn both_solvers_satisfy_the_equation() -> Result<()> {
        let row = |i: usize| {
            let t = i as f64;
            [(t * 1.3).sin() * 5.0, (t * 0.7).cos() * 4.0, (t * 2.1).sin() * 3.0]
        };
        let source: Vec<[f64; 3]> = (0..40).map(row).collect();
        let target: Vec<[f64; 3]> = (0..40).map(|i| if i % 3 == 0 { row(i + 7) } else { row(i) }).collect();
        let (source, target) = (Points::from_rows("source", &source)?, Points::from_rows("target", &target)?);
        let execution = Execution::default();
        let matrix = PairMatrix::new(&source, &target, PairScore::DistanceRatio, None, &execution)?;
        for solver in [Eigensolver::Power, Eigensolver::Dense] {
            let pair = principal_eigenvector(&matrix, solver, &execution)?;
            let product = matrix.multiply(&pair.vector, &execution)?;
            for (left, entry) in product.iter().zip(&pair.vector) {
                assert!((left - pair.value * entry).abs() < 1e-7, "{solver:?}");
            }
        }
        Ok(())
    }
}
