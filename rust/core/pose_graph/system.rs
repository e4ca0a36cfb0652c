//! A sparse symmetric positive definite system of square blocks, one row of blocks per unknown node.

use super::conjugate::Conjugate;
use super::factor::{Factor, Order};
use crate::error::{Error, Result};
use crate::memory;

/// Multiplications of a factorization, per entry of the matrix, above which conjugate gradients solve the
/// system.
const DENSE_FACTOR: f64 = 2000.0;
/// Cost of a step of conjugate gradients, in multiplications of a factorization per entry of the matrix.
const PRODUCTS_OF_A_STEP: f64 = 24.0;

/// The lower triangle of a matrix.
pub struct Matrix {
    size: usize,
    pub unknowns: usize,
    pub block_starts: Vec<usize>,
    pub block_rows: Vec<u32>,
    pub column_starts: Vec<u32>,
    pub rows: Vec<u32>,
    pub values: Vec<f64>,
}

/// A matrix with its solver.
pub struct System {
    matrix: Matrix,
    order: Order,
    sides: usize,
    solver: Solver,
}

enum Solver {
    Factor(Factor),
    Conjugate(Conjugate),
}

/// Position of a block below the diagonal.
#[derive(Clone, Copy)]
pub struct Place {
    column: usize,
    place: usize,
}

impl Matrix {
    /// A zero matrix with blocks for pairs of different nodes.
    fn new(unknowns: usize, size: usize, pairs: impl Iterator<Item = (usize, usize)>) -> Result<Self> {
        if unknowns.checked_mul(size).is_none_or(|rows| rows > i32::MAX as usize) {
            return Err(Error::invalid("poses", unknowns, "give fewer nodes"));
        }
        let mut pairs = memory::collect(pairs.map(|(a, b)| (a.min(b) as u32, a.max(b) as u32)))?;
        pairs.sort_unstable();
        pairs.dedup();
        let mut block_starts = memory::filled(0, unknowns + 1)?;
        pairs.iter().for_each(|&(column, _)| block_starts[column as usize + 1] += 1);
        (0..unknowns).for_each(|column| block_starts[column + 1] += block_starts[column]);
        let block_rows = memory::collect(pairs.iter().map(|&(_, row)| row))?;
        let entries = unknowns * size * (size + 1) / 2 + block_rows.len() * size * size;
        if entries > i32::MAX as usize {
            return Err(Error::OutOfMemory { bytes: entries.saturating_mul(size_of::<f64>()) });
        }
        let mut rows = memory::with_capacity(entries)?;
        let mut column_starts = memory::with_capacity(unknowns * size + 1)?;
        for column in 0..unknowns {
            let below = &block_rows[block_starts[column]..block_starts[column + 1]];
            for k in 0..size {
                column_starts.push(rows.len() as u32);
                rows.extend((k..size).map(|row| (column * size + row) as u32));
                below.iter().for_each(|&block| {
                    rows.extend((0..size).map(|row| (block as usize * size + row) as u32));
                });
            }
        }
        column_starts.push(rows.len() as u32);
        let values = memory::filled(0.0, rows.len())?;
        Ok(Self { size, unknowns, block_starts, block_rows, column_starts, rows, values })
    }

    /// Number of scalar rows.
    pub fn len(&self) -> usize {
        self.unknowns * self.size
    }

    /// Rows of a block.
    pub fn block_size(&self) -> usize {
        self.size
    }

    /// An entry of a diagonal block, `row >= column`.
    pub fn diagonal_entry(&self, node: usize, row: usize, column: usize) -> f64 {
        self.values[self.column_starts[node * self.size + column] as usize + row - column]
    }

    /// Multiplies the whole symmetric matrix by a vector.
    pub fn multiply(&self, vector: &[f64], image: &mut [f64]) {
        image.fill(0.0);
        for column in 0..self.unknowns {
            let below = &self.block_rows[self.block_starts[column]..self.block_starts[column + 1]];
            for k in 0..self.size {
                let scalar = column * self.size + k;
                let start = self.column_starts[scalar] as usize;
                let (diagonal, blocks) =
                    self.values[start..self.column_starts[scalar + 1] as usize].split_at(self.size - k);
                let factor = vector[scalar];
                let mut sum = diagonal[0] * factor;
                for (row, entry) in diagonal.iter().enumerate().skip(1) {
                    image[scalar + row] += entry * factor;
                    sum += entry * vector[scalar + row];
                }
                for (block, &node) in blocks.chunks_exact(self.size).zip(below) {
                    let rows = node as usize * self.size..(node as usize + 1) * self.size;
                    let slots = image[rows.clone()].iter_mut().zip(&vector[rows]);
                    for ((slot, other), entry) in slots.zip(block) {
                        *slot += entry * factor;
                        sum += entry * other;
                    }
                }
                image[scalar] += sum;
            }
        }
    }
}

impl System {
    /// An empty system of `unknowns` nodes with blocks of `size` rows, and edges between `pairs` of different
    /// nodes; solves for `sides` right-hand sides at once.
    pub fn new(
        unknowns: usize,
        size: usize,
        pairs: impl Iterator<Item = (usize, usize)>,
        sides: usize,
    ) -> Result<Self> {
        let matrix = Matrix::new(unknowns, size, pairs)?;
        let order = Order::new(&matrix)?;
        let products = order.products * (size * size * size) as f64 / matrix.values.len().max(1) as f64;
        let solver = if products > DENSE_FACTOR {
            let most_steps = (products / PRODUCTS_OF_A_STEP) as usize; // beyond these, a factor is faster
            Solver::Conjugate(Conjugate::new(matrix.len(), size, most_steps)?)
        } else {
            Solver::Factor(Factor::new(&matrix, &order, sides)?)
        };
        Ok(Self { matrix, order, sides, solver })
    }

    /// Number of scalar rows.
    pub fn len(&self) -> usize {
        self.matrix.len()
    }

    /// Position of the block of two nodes, `row > column`; `None` if they share no edge.
    pub fn place(&self, row: usize, column: usize) -> Option<Place> {
        let Matrix { block_rows, block_starts, .. } = &self.matrix;
        let below = &block_rows[block_starts[column]..block_starts[column + 1]];
        below.binary_search(&(row as u32)).ok().map(|place| Place { column, place })
    }

    /// Sets the matrix to zero.
    pub fn clear(&mut self) {
        self.matrix.values.fill(0.0);
    }

    /// Adds a symmetric block, by columns, on the diagonal.
    pub fn add_diagonal(&mut self, node: usize, block: &[f64]) {
        let Matrix { size, column_starts, values, .. } = &mut self.matrix;
        for (k, column) in block.chunks_exact(*size).enumerate() {
            let start = column_starts[node * *size + k] as usize;
            add(&mut values[start..start + *size - k], &column[k..]);
        }
    }

    /// Adds a block, by columns, below the diagonal.
    pub fn add_below(&mut self, place: Place, block: &[f64]) {
        let Matrix { size, column_starts, values, .. } = &mut self.matrix;
        for (k, column) in block.chunks_exact(*size).enumerate() {
            let start = column_starts[place.column * *size + k] as usize;
            let start = start + *size - k + place.place * *size;
            add(&mut values[start..start + *size], column);
        }
    }

    /// The entries on the diagonal.
    pub fn diagonal(&self) -> impl Iterator<Item = f64> + '_ {
        self.matrix.column_starts[..self.len()].iter().map(|&start| self.matrix.values[start as usize])
    }

    /// Sets the entries on the diagonal.
    pub fn set_diagonal(&mut self, entries: impl Iterator<Item = f64>) {
        for (&start, entry) in self.matrix.column_starts.iter().zip(entries) {
            self.matrix.values[start as usize] = entry;
        }
    }

    /// Prepares to solve with the current matrix; returns false if it is not found to be positive definite.
    pub fn factorize(&mut self) -> bool {
        match &mut self.solver {
            Solver::Factor(factor) => factor.prepare(&self.matrix),
            Solver::Conjugate(conjugate) => conjugate.prepare(&self.matrix),
        }
    }

    /// Solves in place for concatenated right-hand sides; returns false if the matrix is not positive
    /// definite. Conjugate gradients end once a residual is reduced by the factor `reduction`; a
    /// factorization is exact. If conjugate gradients do not converge, later solves factorize the matrix.
    pub fn solve(&mut self, sides: &mut [f64], reduction: f64) -> Result<bool> {
        let rows = self.len();
        if rows == 0 {
            return Ok(true);
        }
        if let Solver::Conjugate(conjugate) = &mut self.solver {
            let given = memory::copied(sides)?;
            if sides.chunks_exact_mut(rows).all(|side| conjugate.solve(&self.matrix, side, reduction)) {
                return Ok(true);
            }
            sides.copy_from_slice(&given);
            let mut factor = Factor::new(&self.matrix, &self.order, self.sides)?;
            let is_definite = factor.prepare(&self.matrix);
            self.solver = Solver::Factor(factor);
            if !is_definite {
                return Ok(false);
            }
        }
        if let Solver::Factor(factor) = &mut self.solver {
            factor.solve(rows, sides);
        }
        Ok(true)
    }
}

fn add(sums: &mut [f64], terms: &[f64]) {
    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
}

#[cfg(test)]
mod tests {
    use super::super::conjugate::EXACT;
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn solves_as_a_dense_matrix_does() -> Result<()> {
        for (unknowns, size) in [(1, 6), (7, 3), (12, 1), (40, 6)] {
            let pairs = || {
                (1..unknowns).map(|k| (k, k - 1)).chain((0..unknowns / 2).map(|k| (k, unknowns - 1 - k / 2)))
            };
            let pairs = || pairs().filter(|(a, b)| a != b);
            let mut system = System::new(unknowns, size, pairs(), 2)?;
            let mut dense = DMatrix::<f64>::zeros(unknowns * size, unknowns * size);
            for (k, (a, b)) in pairs().enumerate() {
                let block =
                    DMatrix::from_fn(size, size, |r, c| (k as f64 + 1.7 * r as f64 - 0.9 * c as f64).sin());
                let (row, column) = (a.max(b), a.min(b));
                if let Some(place) = system.place(row, column) {
                    system.add_below(place, block.as_slice());
                }
                let mut view = dense.view_mut((row * size, column * size), (size, size));
                view += &block;
                let mut view = dense.view_mut((column * size, row * size), (size, size));
                view += block.transpose();
            }
            let heavy = DMatrix::<f64>::identity(size, size) * 40.0 + DMatrix::from_element(size, size, 0.5);
            for node in 0..unknowns {
                system.add_diagonal(node, heavy.as_slice());
                let mut view = dense.view_mut((node * size, node * size), (size, size));
                view += &heavy;
            }
            assert!(system.factorize());
            let rows = unknowns * size;
            let mut sides: Vec<f64> = (0..2 * rows).map(|k| (0.3 * k as f64).cos()).collect();
            let expected = DVector::from_column_slice(&sides[rows..]);
            assert!(system.solve(&mut sides, EXACT)?);
            assert!((dense * DVector::from_column_slice(&sides[rows..]) - expected).amax() < 1e-10);
        }
        Ok(())
    }

    /// Nodes connected across the graph, with a diagonal of some weight.
    fn tied(weight: f64) -> Result<System> {
        let pairs =
            || (0..600_usize).flat_map(|node| (1..8).map(move |k| (node, (node * (k + 6) + 31 * k) % 600)));
        let pairs = || pairs().filter(|(a, b)| a != b);
        let mut system = System::new(600, 3, pairs(), 2)?;
        for (a, b) in pairs() {
            let block: Vec<f64> = (0..9).map(|k| ((a * b + k) as f64).sin()).collect();
            if let Some(place) = system.place(a.max(b), a.min(b)) {
                system.add_below(place, &block);
            }
        }
        let heavy = DMatrix::<f64>::identity(3, 3) * weight + DMatrix::from_element(3, 3, 0.5);
        (0..600).for_each(|node| system.add_diagonal(node, heavy.as_slice()));
        assert!(matches!(system.solver, Solver::Conjugate(_)));
        Ok(system)
    }

    #[test]
    fn conjugate_gradients_solve_as_the_factor_does() -> Result<()> {
        let mut system = tied(60.0)?;
        let given: Vec<f64> = (0..2 * system.len()).map(|k| (0.7 * k as f64).sin()).collect();
        let (mut iterated, mut factored) = (given.clone(), given);
        assert!(system.factorize() && system.solve(&mut iterated, EXACT)?);
        system.solver = Solver::Factor(Factor::new(&system.matrix, &system.order, 2)?);
        assert!(system.factorize() && system.solve(&mut factored, EXACT)?);
        assert!(iterated.iter().zip(&factored).all(|(a, b)| (a - b).abs() < 1e-9));
        Ok(())
    }

    #[test]
    fn a_matrix_that_is_not_definite_is_factorized_and_refused() -> Result<()> {
        let mut system = tied(0.5)?;
        let mut sides = vec![1.0; system.len()];
        assert!(system.factorize());
        assert!(!system.solve(&mut sides, EXACT)?);
        assert!(matches!(system.solver, Solver::Factor(_)));
        assert!(!system.factorize());
        Ok(())
    }

    #[test]
    fn reports_an_indefinite_matrix() -> Result<()> {
        let mut system = System::new(2, 1, std::iter::once((0, 1)), 1)?;
        assert!(!system.factorize());
        system.set_diagonal([1.0, 1.0].into_iter());
        assert!(system.factorize());
        assert!((system.diagonal().sum::<f64>() - 2.0).abs() < 1e-15);
        Ok(())
    }
}
