//! A sparse symmetric positive definite system of square blocks, one row of blocks per unknown node.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::amd;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};

use crate::error::{Error, Result};
use crate::memory;

/// The lower triangle of the matrix, its factor, and the memory that both need.
pub struct System {
    size: usize,
    unknowns: usize,
    block_starts: Vec<usize>,
    block_rows: Vec<u32>,
    column_starts: Vec<u32>,
    rows: Vec<u32>,
    values: Vec<f64>,
    symbolic: SymbolicCholesky<u32>,
    factor: Vec<f64>,
    scratch: MemBuffer,
}

/// Where a block below the diagonal is.
#[derive(Clone, Copy)]
pub struct Place {
    column: usize,
    place: usize,
}

impl System {
    /// An empty system of `unknowns` nodes with blocks of `size` rows, where `pairs` of different nodes share an edge;
    /// it is solved for `sides` right-hand sides at once.
    pub fn new(
        unknowns: usize,
        size: usize,
        pairs: impl Iterator<Item = (usize, usize)>,
        sides: usize,
    ) -> Result<Self> {
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
        let (forward, backward) = scalar_order(unknowns, size, &block_starts, &block_rows)?;

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

        let scalars = unknowns * size;
        let pattern = SymbolicSparseColMatRef::new_checked(scalars, scalars, &column_starts, None, &rows);
        let order = SymmetricOrdering::Custom(PermRef::new_checked(&forward, &backward, scalars));
        let symbolic =
            factorize_symbolic_cholesky(pattern, Side::Lower, order, CholeskySymbolicParams::default())
                .map_err(|_| refused::<f64>(rows.len()))?;
        let factor = memory::filled(0.0, symbolic.len_val())?;
        let needed = StackReq::any_of(&[
            symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default()),
            symbolic.solve_in_place_scratch::<f64>(sides, Par::Seq),
        ]);
        let scratch = MemBuffer::try_new(needed).map_err(|_| refused::<u8>(needed.size_bytes()))?;
        let values = memory::filled(0.0, rows.len())?;
        Ok(Self {
            size,
            unknowns,
            block_starts,
            block_rows,
            column_starts,
            rows,
            values,
            symbolic,
            factor,
            scratch,
        })
    }

    /// Number of scalar rows.
    pub fn len(&self) -> usize {
        self.unknowns * self.size
    }

    /// Where the block of two nodes is, `row > column`; `None` where they share no edge.
    pub fn place(&self, row: usize, column: usize) -> Option<Place> {
        let below = &self.block_rows[self.block_starts[column]..self.block_starts[column + 1]];
        below.binary_search(&(row as u32)).ok().map(|place| Place { column, place })
    }

    /// Empties the matrix.
    pub fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Adds a symmetric block, column by column, on the diagonal.
    pub fn add_diagonal(&mut self, node: usize, block: &[f64]) {
        for (k, column) in block.chunks_exact(self.size).enumerate() {
            let start = self.column_starts[node * self.size + k] as usize;
            add(&mut self.values[start..start + self.size - k], &column[k..]);
        }
    }

    /// Adds a block, column by column, below the diagonal.
    pub fn add_below(&mut self, place: Place, block: &[f64]) {
        for (k, column) in block.chunks_exact(self.size).enumerate() {
            let start = self.column_starts[place.column * self.size + k] as usize;
            let start = start + self.size - k + place.place * self.size;
            add(&mut self.values[start..start + self.size], column);
        }
    }

    /// The entries on the diagonal.
    pub fn diagonal(&self) -> impl Iterator<Item = f64> + '_ {
        self.column_starts[..self.len()].iter().map(|&start| self.values[start as usize])
    }

    /// Sets the entries on the diagonal.
    pub fn set_diagonal(&mut self, entries: impl Iterator<Item = f64>) {
        for (&start, entry) in self.column_starts.iter().zip(entries) {
            self.values[start as usize] = entry;
        }
    }

    /// Factorizes the matrix; false where it isn't positive definite.
    pub fn factorize(&mut self) -> bool {
        let scalars = self.len();
        let pattern =
            SymbolicSparseColMatRef::new_checked(scalars, scalars, &self.column_starts, None, &self.rows);
        let matrix = SparseColMatRef::new(pattern, &self.values);
        let factored = self.symbolic.factorize_numeric_llt(
            &mut self.factor,
            matrix,
            Side::Lower,
            LltRegularization::default(),
            Par::Seq, // the same bits on any number of threads
            MemStack::new(&mut self.scratch),
            Spec::default(),
        );
        factored.is_ok() && self.factor.iter().all(|entry| entry.is_finite())
    }

    /// Solves in place for right-hand sides that lie one after the other.
    pub fn solve(&mut self, sides: &mut [f64]) {
        let rows = self.len();
        if rows == 0 {
            return;
        }
        let columns = sides.len() / rows;
        LltRef::new(&self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(sides, rows, columns),
            Par::Seq,
            MemStack::new(&mut self.scratch),
        );
    }
}

/// An order of the scalar rows that keeps the factor sparse: that of the nodes by approximate minimum degree.
fn scalar_order(
    unknowns: usize,
    size: usize,
    block_starts: &[usize],
    block_rows: &[u32],
) -> Result<(Vec<u32>, Vec<u32>)> {
    let starts = memory::collect(block_starts.iter().map(|&start| start as u32))?;
    let pattern = SymbolicSparseColMatRef::new_checked(unknowns, unknowns, &starts, None, block_rows);
    let (mut order, mut position) = (memory::filled(0_u32, unknowns)?, memory::filled(0_u32, unknowns)?);
    let needed = amd::order_scratch::<u32>(unknowns, block_rows.len());
    let mut scratch = MemBuffer::try_new(needed).map_err(|_| refused::<u8>(needed.size_bytes()))?;
    amd::order(&mut order, &mut position, pattern, amd::Control::default(), MemStack::new(&mut scratch))
        .map_err(|_| refused::<u32>(block_rows.len()))?;
    let scalars = |nodes: &[u32]| {
        memory::collect(nodes.iter().flat_map(|&node| (0..size).map(move |k| node * size as u32 + k as u32)))
    };
    let forward = scalars(&order)?;
    let mut backward = memory::filled(0_u32, forward.len())?;
    forward.iter().enumerate().for_each(|(place, &row)| backward[row as usize] = place as u32);
    Ok((forward, backward))
}

fn add(sums: &mut [f64], terms: &[f64]) {
    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
}

/// The error of a block of `len` items that the system refused to a library.
fn refused<T>(len: usize) -> Error {
    Error::OutOfMemory { bytes: len.saturating_mul(size_of::<T>()) }
}

#[cfg(test)]
mod tests {
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
            system.solve(&mut sides);
            assert!((dense * DVector::from_column_slice(&sides[rows..]) - expected).amax() < 1e-10);
        }
        Ok(())
    }

    #[test]
    fn says_where_a_matrix_is_not_definite() -> Result<()> {
        let mut system = System::new(2, 1, std::iter::once((0, 1)), 1)?;
        assert!(!system.factorize());
        system.set_diagonal([1.0, 1.0].into_iter());
        assert!(system.factorize());
        assert!((system.diagonal().sum::<f64>() - 2.0).abs() < 1e-15);
        Ok(())
    }
}
