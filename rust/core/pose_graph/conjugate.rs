//! Conjugate gradients with the inverted diagonal blocks as the preconditioner, for matrices with a nearly
//! full factor: well-conditioned ones of nodes with many edges across the graph.

use nalgebra::{Cholesky, DMatrix};

use super::system::Matrix;
use crate::error::Result;
use crate::memory;

/// Reduction of the residual, in the norm of the inverted blocks, at which the solution is as exact as a
/// factor's.
pub const EXACT: f64 = 1e-10;

/// Inverted diagonal blocks, and the vectors of the iteration.
pub struct Conjugate {
    most_steps: usize,
    inverses: Vec<f64>,
    residual: Vec<f64>,
    scaled: Vec<f64>,
    direction: Vec<f64>,
    image: Vec<f64>,
}

impl Conjugate {
    /// Allocates for a matrix of `rows` rows in blocks of `size`, with at most `most_steps` multiplications.
    pub fn new(rows: usize, size: usize, most_steps: usize) -> Result<Self> {
        let vector = || memory::filled(0.0, rows);
        Ok(Self {
            most_steps,
            inverses: memory::filled(0.0, rows * size)?,
            residual: vector()?,
            scaled: vector()?,
            direction: vector()?,
            image: vector()?,
        })
    }

    /// Inverts the diagonal blocks; returns false if one is not positive definite.
    pub fn prepare(&mut self, matrix: &Matrix) -> bool {
        let size = matrix.block_size();
        for (node, slot) in self.inverses.chunks_exact_mut(size * size).enumerate() {
            let lower =
                |row: usize, column: usize| matrix.diagonal_entry(node, row.max(column), row.min(column));
            let Some(factor) = Cholesky::new(DMatrix::from_fn(size, size, lower)) else { return false };
            slot.copy_from_slice(factor.inverse().as_slice());
        }
        true
    }

    /// Solves in place for one right-hand side, until the residual is reduced by a factor; returns false if
    /// the iteration does not converge.
    pub fn solve(&mut self, matrix: &Matrix, side: &mut [f64], reduction: f64) -> bool {
        self.residual.copy_from_slice(side);
        side.fill(0.0);
        self.precondition(matrix.block_size());
        self.direction.copy_from_slice(&self.scaled);
        let mut square = dot(&self.residual, &self.scaled);
        let enough = reduction * reduction * square;
        for _ in 0..self.most_steps {
            if square <= enough {
                return square.is_finite();
            }
            matrix.multiply(&self.direction, &mut self.image);
            let curvature = dot(&self.direction, &self.image);
            if curvature.is_nan() || curvature <= 0.0 {
                return false;
            }
            add_multiple(side, square / curvature, &self.direction);
            add_multiple(&mut self.residual, -square / curvature, &self.image);
            self.precondition(matrix.block_size());
            let before = std::mem::replace(&mut square, dot(&self.residual, &self.scaled));
            let ratio = square / before;
            self.direction.iter_mut().zip(&self.scaled).for_each(|(slot, term)| *slot = term + ratio * *slot);
        }
        false
    }

    /// Multiplies the residual by the inverted blocks.
    fn precondition(&mut self, size: usize) {
        let blocks = self.inverses.chunks_exact(size * size).zip(self.residual.chunks_exact(size));
        for ((inverse, residual), scaled) in blocks.zip(self.scaled.chunks_exact_mut(size)) {
            for (column, slot) in inverse.chunks_exact(size).zip(scaled) {
                *slot = dot(column, residual); // the inverse is symmetric
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn add_multiple(sums: &mut [f64], factor: f64, terms: &[f64]) {
    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += factor * term);
}
