//! The sparse Cholesky factor of a matrix of blocks, and the order of nodes that keeps it sparse.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::amd;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};

use super::system::Matrix;
use crate::error::{Error, Result};
use crate::memory;

/// A fill-reducing order of the nodes by approximate minimum degree.
pub struct Order {
    nodes: Vec<u32>,
    /// Number of multiplications of the factorization with blocks of one row.
    pub products: f64,
}

impl Order {
    pub fn new(matrix: &Matrix) -> Result<Self> {
        let unknowns = matrix.unknowns;
        let starts = memory::collect(matrix.block_starts.iter().map(|&start| start as u32))?;
        let pattern =
            SymbolicSparseColMatRef::new_checked(unknowns, unknowns, &starts, None, &matrix.block_rows);
        let (mut nodes, mut places) = (memory::filled(0_u32, unknowns)?, memory::filled(0_u32, unknowns)?);
        let needed = amd::order_scratch::<u32>(unknowns, matrix.block_rows.len());
        let mut scratch = MemBuffer::try_new(needed).map_err(|_| refused::<u8>(needed.size_bytes()))?;
        let stack = MemStack::new(&mut scratch);
        let count = amd::order(&mut nodes, &mut places, pattern, amd::Control::default(), stack)
            .map_err(|_| refused::<u32>(matrix.block_rows.len()))?;
        Ok(Self { nodes, products: count.n_mult_subs_ldl })
    }

    /// The scalar rows in order, and the place of each row.
    fn scalars(&self, size: usize) -> Result<(Vec<u32>, Vec<u32>)> {
        let rows = |&node: &u32| (0..size).map(move |k| node * size as u32 + k as u32);
        let forward = memory::collect(self.nodes.iter().flat_map(rows))?;
        let mut backward = memory::filled(0_u32, forward.len())?;
        forward.iter().enumerate().for_each(|(place, &row)| backward[row as usize] = place as u32);
        Ok((forward, backward))
    }
}

/// The factor, and its working memory.
pub struct Factor {
    symbolic: SymbolicCholesky<u32>,
    values: Vec<f64>,
    scratch: MemBuffer,
}

impl Factor {
    /// Allocates the factor of a matrix, to solve for `sides` right-hand sides at once.
    pub fn new(matrix: &Matrix, order: &Order, sides: usize) -> Result<Self> {
        let (forward, backward) = order.scalars(matrix.block_size())?;
        let ordering = SymmetricOrdering::Custom(PermRef::new_checked(&forward, &backward, matrix.len()));
        let symbolic = factorize_symbolic_cholesky(
            pattern(matrix),
            Side::Lower,
            ordering,
            CholeskySymbolicParams::default(),
        )
        .map_err(|_| refused::<f64>(matrix.rows.len()))?;
        let values = memory::filled(0.0, symbolic.len_val())?;
        let needed = StackReq::any_of(&[
            symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default()),
            symbolic.solve_in_place_scratch::<f64>(sides, Par::Seq),
        ]);
        let scratch = MemBuffer::try_new(needed).map_err(|_| refused::<u8>(needed.size_bytes()))?;
        Ok(Self { symbolic, values, scratch })
    }

    /// Factorizes the matrix; returns false if it is not positive definite.
    pub fn prepare(&mut self, matrix: &Matrix) -> bool {
        let factored = self.symbolic.factorize_numeric_llt(
            &mut self.values,
            SparseColMatRef::new(pattern(matrix), &matrix.values),
            Side::Lower,
            LltRegularization::default(),
            Par::Seq, // the same bits on any number of threads
            MemStack::new(&mut self.scratch),
            Spec::default(),
        );
        factored.is_ok() && self.values.iter().all(|entry| entry.is_finite())
    }

    /// Solves in place for concatenated right-hand sides.
    pub fn solve(&mut self, rows: usize, sides: &mut [f64]) {
        let columns = sides.len() / rows;
        LltRef::new(&self.symbolic, &self.values).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(sides, rows, columns),
            Par::Seq,
            MemStack::new(&mut self.scratch),
        );
    }
}

fn pattern(matrix: &Matrix) -> SymbolicSparseColMatRef<'_, u32> {
    SymbolicSparseColMatRef::new_checked(
        matrix.len(),
        matrix.len(),
        &matrix.column_starts,
        None,
        &matrix.rows,
    )
}

/// The error for a refused block of `len` items in a library.
fn refused<T>(len: usize) -> Error {
    Error::OutOfMemory { bytes: len.saturating_mul(size_of::<T>()) }
}
