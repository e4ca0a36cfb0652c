//! Principal eigenvector of a symmetric, non-negative matrix.

use std::ops::RangeInclusive;

use super::lanczos::{Dense, scale_to_one};
use crate::compatibility::matrix::PairMatrix;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;
use crate::options::{Value, words};
use crate::simd::sums::{dot, sum};

/// Most power steps.
const MAX_STEPS: usize = 1000;

/// Error of an entry, relative to the largest one, at which the iteration has converged.
const CONVERGED: f64 = 1e-9;

/// Change of an entry, relative to the largest one, below which the matrix entries have to be exact: about
/// the effect of their rounding.
const ROUGHLY_CONVERGED: f64 = 3e-7;

/// Greatest error of rounded entries in an exact product, as a share of [`CONVERGED`].
const SHARE_OF_ROUNDING: f64 = 0.1;

/// Changes below this that do not halve may be due to rounding.
const DOUBTFUL: f64 = 1e-5;

/// Progress is reported in steps of one percent.
const PERCENT: usize = 100;

/// Share of the mean row sum added to the diagonal: keeps the eigenvectors and prevents oscillation by an
/// eigenvalue of `-lambda`.
const SHIFT: f64 = 0.05;

/// Entries whose squares can be summed.
const SAFE: RangeInclusive<f64> = 1e-100..=1e100;

words! {
    /// Algorithm that computes the eigenvector.
    pub enum Eigensolver {
        /// Power iteration on the shifted matrix, O(n^2) per step.
        Power = Value::Word("power"),
        /// Lanczos's method on the stored matrix, to full precision.
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
/// [`Error::Interrupted`], [`Error::OutOfMemory`], or [`Error::InvalidInput`] if the dense solver would
/// exceed `max_memory`.
pub fn principal_eigenvector(
    matrix: &PairMatrix,
    solver: Eigensolver,
    execution: &Execution,
) -> Result<Eigenpair> {
    let start = uniform(matrix.len())?;
    let product = matrix.multiply_rounded(&start, execution)?;
    if sum(&product) <= 0.0 {
        // Every vector is an eigenvector of the zero matrix.
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

/// Power iteration from `start`, a unit vector of equal entries, and its product with the matrix.
fn power_iteration(
    matrix: &PairMatrix,
    start: Vec<f64>,
    product: Vec<f64>,
    execution: &Execution,
) -> Result<Eigenpair> {
    let shift = SHIFT * dot(&start, &product); // a share of the mean row sum
    let (mut vector, mut product) = (start, product);
    let mut previous_change = f64::INFINITY;
    let (mut steps, mut exact): (usize, Option<Exact>) = (0, None);
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
        if (exact.is_some() && remaining < CONVERGED) || steps == MAX_STEPS {
            return Ok(Eigenpair { vector, value, steps });
        }
        let refine = exact.is_none() && (change < ROUGHLY_CONVERGED || (change < DOUBTFUL && ratio > 0.5));
        previous_change = if refine { f64::INFINITY } else { change };
        product = match &mut exact {
            Some(exact) => exact.multiply(matrix, &vector, value, execution)?,
            None if refine => exact.insert(Exact::of(matrix, &vector, execution)?).product()?,
            None => matrix.multiply_rounded(&vector, execution)?,
        };
    }
}

/// A vector and its exact product with the matrix. Products of vectors nearby are computed from the small
/// difference, for which the stored entries suffice.
struct Exact {
    vector: Vec<f64>,
    product: Vec<f64>,
}

impl Exact {
    fn of(matrix: &PairMatrix, vector: &[f64], execution: &Execution) -> Result<Self> {
        Ok(Self { vector: memory::copied(vector)?, product: matrix.multiply(vector, execution)? })
    }

    fn product(&self) -> Result<Vec<f64>> {
        memory::copied(&self.product)
    }

    /// The product of a vector of eigenvalue about `value`; later products use those of nearby vectors.
    fn multiply(
        &mut self,
        matrix: &PairMatrix,
        vector: &[f64],
        value: f64,
        execution: &Execution,
    ) -> Result<Vec<f64>> {
        let step = memory::collect(vector.iter().zip(&self.vector).map(|(new, old)| new - old))?;
        let error = matrix.rounding() * step.iter().map(|entry| entry.abs()).sum::<f64>();
        if error > SHARE_OF_ROUNDING * CONVERGED * value * vector.iter().copied().fold(0.0, f64::max) {
            *self = Self::of(matrix, vector, execution)?;
            return self.product();
        }
        let mut product = matrix.multiply_rounded(&step, execution)?;
        product.iter_mut().zip(&self.product).for_each(|(sum, exact)| *sum += exact);
        Ok(product)
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

/// The power of two that keeps the squares of entries from over- and underflow: 1 if none would.
fn safe_scale(entries: &[f64]) -> f64 {
    let greatest = entries.iter().copied().fold(0.0, f64::max);
    if SAFE.contains(&greatest) { 1.0 } else { scale_to_one(greatest) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compatibility::matrix::{DOUBLE_LIMIT, PairScore};
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

    #[test]
    fn vectors_from_rounded_entries_satisfy_the_exact_equation() -> Result<()> {
        let row = |i: usize, k: f64| {
            let t = i as f64;
            [(t * k).sin() * 5.0, (t * 0.7).cos() * 4.0, (t * 2.1).sin() * 3.0]
        };
        let rows = |k: f64| (0..DOUBLE_LIMIT + 400).map(|i| row(i, k)).collect::<Vec<_>>();
        let (source, target) =
            (Points::from_rows("source", &rows(1.3))?, Points::from_rows("target", &rows(1.9))?);
        let execution = Execution::default();
        for score in
            [PairScore::DistanceRatio, PairScore::DistanceRatioFrom(0.6), PairScore::DistanceRatioFrom(0.99)]
        {
            let matrix = PairMatrix::new(&source, &target, score, None, &execution)?;
            let pair = principal_eigenvector(&matrix, Eigensolver::Power, &execution)?;
            let product = matrix.multiply(&pair.vector, &execution)?;
            let greatest = pair.vector.iter().copied().fold(0.0, f64::max);
            for (left, entry) in product.iter().zip(&pair.vector) {
                let error = (left - pair.value * entry).abs();
                assert!(error < 2.0 * CONVERGED * pair.value * greatest, "{score:?}: {error}");
            }
        }
        Ok(())
    }
}
