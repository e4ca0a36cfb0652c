//! Lanczos's method: the principal eigenvector of a stored matrix, to full f64 precision.
//!
//! The matrix is projected onto the orthogonalized vectors `x, M x, M^2 x, ...`, where it is tridiagonal.
//! With equal entries in x the greatest eigenvalue is never missed: a non-negative matrix has a corresponding
//! eigenvector without negative entries, and the cosine of its angle to x is at least `1 / sqrt n`. Each
//! vector is orthogonalized against all before it, twice, to remove rounding errors; after n vectors the
//! projection is the matrix itself. If the greatest eigenvalue is a multiple one, the eigenvector is the one
//! nearest to x.
//!
//! Cost O(n^2) per vector. Tens of vectors suffice; up to n are needed if the second eigenvalue is very
//! close. Memory `8 n^2` bytes, and `8 n` per vector.

use rayon::prelude::*;

use super::tridiagonal::Tridiagonal;
use crate::compatibility::matrix::PairMatrix;
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::simd::sums::dot;

/// Entries per task.
const PART: usize = 1024;

/// Passes of orthogonalization: a second one removes the rounding errors of the first.
const PASSES: usize = 2;

/// The matrix by rows, and the power of two that it is scaled by so that no square over- or underflows.
pub struct Dense {
    entries: Vec<f64>,
    size: usize,
    scale: f64,
}

impl Dense {
    /// Bytes of a matrix of that size and as many vectors.
    pub fn bytes(size: usize) -> usize {
        size.saturating_mul(size).saturating_mul(2 * size_of::<f64>())
    }

    /// Copies the entries of a matrix.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn of(matrix: &PairMatrix, execution: &Execution) -> Result<Self> {
        let size = matrix.len();
        let mut entries = memory::filled(0.0, size * size)?;
        entries.par_chunks_mut(size.max(1)).enumerate().try_for_each(|(i, row)| {
            matrix.fill_row(i, row);
            execution.check()
        })?;
        let greatest = |row: &[f64]| row.iter().copied().fold(0.0, f64::max);
        let scale = scale_to_one(entries.par_chunks(size.max(1)).map(greatest).reduce(|| 0.0, f64::max));
        entries.par_iter_mut().for_each(|entry| *entry *= scale);
        Ok(Self { entries, size, scale })
    }

    /// The greatest eigenvalue, and an eigenvector of unit length without negative entries.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn principal_eigenpair(&self, execution: &Execution) -> Result<(f64, Vec<f64>)> {
        let mut projected = Tridiagonal::default();
        let mut basis: Vec<Vec<f64>> = Vec::new();
        let mut next = memory::filled(1.0 / (self.size as f64).sqrt(), self.size)?;
        loop {
            let product = self.multiply(&next, execution)?;
            memory::push(&mut projected.diagonal, dot(&next, &product))?;
            memory::push(&mut basis, std::mem::replace(&mut next, product))?;
            make_orthogonal(&mut next, &basis, execution)?;
            let length = dot(&next, &next).sqrt();
            let value = projected.greatest_eigenvalue();
            let weights = projected.eigenvector(value)?;
            // Residual of `M v - value v` for the eigenvector of the projection.
            let residual = length * weights[weights.len() - 1];
            execution.report(basis.len(), self.size)?;
            if residual <= f64::EPSILON * value || basis.len() == self.size {
                let vector = combine(&basis, &weights)?;
                return Ok((value / self.scale, non_negative(vector)));
            }
            next.iter_mut().for_each(|entry| *entry /= length);
            memory::push(&mut projected.beside, length)?;
        }
    }

    fn multiply(&self, x: &[f64], execution: &Execution) -> Result<Vec<f64>> {
        let entry = |row: &[f64]| execution.check().map(|()| dot(row, x));
        memory::par_try_collect(self.entries.par_chunks(self.size).map(entry))
    }
}

/// The power of two that scales a positive number to about 1, as far as one power can.
pub(super) fn scale_to_one(greatest: f64) -> f64 {
    (-greatest.log2().round()).clamp(-1000.0, 1000.0).exp2()
}

/// Removes from a vector its components along others.
fn make_orthogonal(vector: &mut [f64], basis: &[Vec<f64>], execution: &Execution) -> Result<()> {
    for _ in 0..PASSES {
        let share = |direction: &Vec<f64>| execution.check().map(|()| dot(direction, vector));
        let shares = memory::par_try_collect(basis.par_iter().map(share))?;
        add_multiples(vector, basis, |k| -shares[k]);
    }
    Ok(())
}

/// The weighted sum of the vectors.
fn combine(basis: &[Vec<f64>], weights: &[f64]) -> Result<Vec<f64>> {
    let mut sum = memory::filled(0.0, basis.first().map_or(0, Vec::len))?;
    add_multiples(&mut sum, basis, |k| weights[k]);
    Ok(sum)
}

fn add_multiples(vector: &mut [f64], basis: &[Vec<f64>], factor: impl Fn(usize) -> f64 + Sync) {
    vector.par_chunks_mut(PART).enumerate().for_each(|(part, entries)| {
        for (k, direction) in basis.iter().enumerate() {
            let factor = factor(k);
            entries
                .iter_mut()
                .zip(&direction[part * PART..])
                .for_each(|(entry, value)| *entry += factor * value);
        }
    });
}

/// Replaces entries that are negative by rounding with 0.
fn non_negative(mut vector: Vec<f64>) -> Vec<f64> {
    vector.iter_mut().for_each(|entry| *entry = entry.max(0.0));
    vector
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::{Mat, Side};

    fn dense(size: usize, entry: impl Fn(usize, usize) -> f64) -> Dense {
        Dense { entries: (0..size * size).map(|at| entry(at / size, at % size)).collect(), size, scale: 1.0 }
    }

    fn eigenpair(matrix: &Dense) -> Result<(f64, Vec<f64>)> {
        matrix.principal_eigenpair(&Execution::default())
    }

    #[test]
    fn the_eigenpair_is_that_of_a_full_decomposition() -> Result<()> {
        for n in [1, 2, 3, 17, 200] {
            let number = |i: usize, j: usize| (1.3 * (i * j) as f64 + (i + j) as f64).sin().max(0.0);
            let matrix = dense(n, |i, j| if i == j { 0.1 } else { number(i, j) });
            let (value, vector) = eigenpair(&matrix)?;
            let full = Mat::from_fn(n, n, |i, j| matrix.entries[i * n + j]);
            let Ok(decomposition) = full.self_adjoint_eigen(Side::Lower) else { continue };
            assert!((value - decomposition.S()[n - 1]).abs() < 1e-12 * value, "{n}");
            for (i, entry) in vector.iter().enumerate() {
                assert!((entry - decomposition.U()[(i, n - 1)].abs()).abs() < 1e-11, "{n}: {i}");
            }
        }
        Ok(())
    }

    #[test]
    fn multiple_eigenvalues_give_the_vector_nearest_to_equal_entries() -> Result<()> {
        // Three fully connected blocks of four: each has the eigenvalue 3.
        let blocks = dense(12, |i, j| f64::from(u8::from(i / 4 == j / 4 && i != j)));
        let (value, vector) = eigenpair(&blocks)?;
        assert!((value - 3.0).abs() < 1e-14);
        assert!(vector.iter().all(|entry| (entry - (1.0_f64 / 12.0).sqrt()).abs() < 1e-14));
        Ok(())
    }

    #[test]
    fn close_eigenvalues_are_separated() -> Result<()> {
        // Two blocks, the second heavier by 1e-8.
        let matrix = dense(60, |i, j| match (i < 30, j < 30) {
            (true, true) => 1.0,
            (false, false) => 1.0 + 1e-8,
            _ => 0.0,
        });
        let (_, vector) = eigenpair(&matrix)?;
        assert!(vector[..30].iter().all(|entry| *entry < 1e-7));
        assert!(vector[30..].iter().all(|entry| (entry - (1.0_f64 / 30.0).sqrt()).abs() < 1e-12));
        Ok(())
    }

    #[test]
    fn a_diagonal_matrix_needs_a_vector_per_entry() -> Result<()> {
        let (value, vector) = eigenpair(&dense(100, |i, j| if i == j { (i + 1) as f64 } else { 0.0 }))?;
        assert!((value - 100.0).abs() < 1e-12);
        assert!((vector[99] - 1.0).abs() < 1e-12 && vector[..99].iter().all(|entry| *entry < 1e-9));
        Ok(())
    }
}
