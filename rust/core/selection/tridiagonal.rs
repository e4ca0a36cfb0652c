//! The greatest eigenvalue of a symmetric tridiagonal matrix, and its eigenvector.

use crate::error::Result;
use crate::memory;
use crate::simd::sums::dot;

/// Solutions of inverse iteration: the first has most of the eigenvector's digits, unless the second
/// eigenvalue is equal up to rounding.
const SOLUTIONS: usize = 4;

/// A matrix T without negative off-diagonal entries and with an eigenvalue greater than 0.
#[derive(Debug, Default)]
pub struct Tridiagonal {
    /// The diagonal.
    pub diagonal: Vec<f64>,
    /// The off-diagonal, one entry fewer.
    pub beside: Vec<f64>,
}

impl Tridiagonal {
    /// The least number that is greater than all eigenvalues, up to rounding.
    ///
    /// By bisection: `s - T` is positive definite if and only if s exceeds all eigenvalues, and no such s is
    /// below an entry of the diagonal.
    pub fn greatest_eigenvalue(&self) -> f64 {
        let greatest_entry = self.diagonal.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let (mut low, mut high) = (greatest_entry, self.bound());
        while self.has_one_from(high) {
            high += f64::EPSILON * high.abs().max(f64::MIN_POSITIVE); // the bound's own rounding
        }
        loop {
            let middle = f64::midpoint(low, high);
            if middle <= low || middle >= high {
                return high;
            }
            if self.has_one_from(middle) { low = middle } else { high = middle }
        }
    }

    /// The unit eigenvector of the result of [`Self::greatest_eigenvalue`], without negative entries.
    ///
    /// By inverse iteration: `s - T` is positive definite without positive off-diagonal entries, so it needs
    /// no pivoting and loses no digits.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn eigenvector(&self, eigenvalue: f64) -> Result<Vec<f64>> {
        let pivots = memory::collect(self.pivots(eigenvalue))?;
        let mut vector = memory::filled(1.0, self.diagonal.len())?;
        for _ in 0..SOLUTIONS {
            self.solve(&pivots, &mut vector);
            let greatest = vector.iter().copied().fold(0.0, f64::max);
            vector.iter_mut().for_each(|entry| *entry /= greatest);
        }
        let length = dot(&vector, &vector).sqrt();
        vector.iter_mut().for_each(|entry| *entry /= length);
        Ok(vector)
    }

    /// Upper bound of the eigenvalues: the greatest row sum.
    fn bound(&self) -> f64 {
        let beside = |i: usize| self.beside.get(i).copied().unwrap_or_default();
        let sums = (0..self.diagonal.len())
            .map(|i| self.diagonal[i] + beside(i) + i.checked_sub(1).map_or(0.0, beside));
        sums.fold(f64::NEG_INFINITY, f64::max)
    }

    /// Whether an eigenvalue is at least `least`.
    fn has_one_from(&self, least: f64) -> bool {
        self.pivots(least).any(|pivot| pivot <= 0.0)
    }

    /// Pivots of the elimination of `shift - T`.
    fn pivots(&self, shift: f64) -> impl Iterator<Item = f64> + '_ {
        let before = std::iter::once(0.0).chain(self.beside.iter().copied());
        self.diagonal.iter().zip(before).scan(1.0, move |last, (&entry, beside)| {
            *last = shift - entry - beside / *last * beside;
            Some(*last)
        })
    }

    /// Solves `(s - T) x = b` in place.
    fn solve(&self, pivots: &[f64], b: &mut [f64]) {
        for (i, beside) in self.beside.iter().enumerate() {
            b[i + 1] += beside / pivots[i] * b[i];
        }
        for (i, pivot) in pivots.iter().enumerate().rev() {
            let after = self.beside.get(i).map_or(0.0, |beside| beside * b[i + 1]);
            b[i] = (b[i] + after) / pivot;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_eigenpair_of_a_path() -> Result<()> {
        for n in [1, 2, 3, 50, 400] {
            let path = Tridiagonal { diagonal: vec![1.0; n], beside: vec![1.0; n - 1] };
            let angle = std::f64::consts::PI / (n + 1) as f64;
            let value = path.greatest_eigenvalue();
            assert!((value - 1.0 - 2.0 * angle.cos()).abs() < 1e-14, "{n}: {value}");
            let factor = (2.0 / (n + 1) as f64).sqrt();
            for (i, entry) in path.eigenvector(value)?.into_iter().enumerate() {
                assert!((entry - factor * ((i + 1) as f64 * angle).sin()).abs() < 1e-9, "{n}: {i}");
            }
        }
        Ok(())
    }

    #[test]
    fn a_zero_off_the_diagonal_splits_the_matrix() -> Result<()> {
        let parted = Tridiagonal { diagonal: vec![1.0, 3.0, 2.0], beside: vec![0.0, 0.0] };
        let value = parted.greatest_eigenvalue();
        assert!((value - 3.0).abs() < 1e-14);
        assert!((parted.eigenvector(value)?[1] - 1.0).abs() < 1e-14);
        Ok(())
    }
}
