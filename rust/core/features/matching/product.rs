//! One pass over the matrix product of two sides, which bounds all squared distances.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::candidates::Candidates;
use super::columns::Columns;
use super::descriptors::Descriptors;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;
use crate::points::unit_scale;
use crate::simd;

/// Source rows and target rows of one matrix product: the product stays in the second-level cache.
const SOURCE_BLOCK: usize = 96;
const TARGET_BLOCK: usize = 1024;
/// Bytes that the matrix product allocates on a thread's first use; a failure would end the process.
const MATMUL_MEMORY: usize = 4 << 20;
/// Half a unit in the last place of 1 in single precision.
const UNIT_ROUNDOFF: f64 = 1.0 / (1 << 24) as f64;

/// Squares of lengths around 1 below this have lost digits, or their terms have.
const LEAST_SQUARE: f64 = 1e-300;

/// A target, and its scaled distance from a source row.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Near {
    pub index: u32,
    pub distance: f64,
}

/// The nearest targets of every source row, and bounds for the nearest source rows.
pub(super) struct Found {
    width: usize,
    nearest: Vec<Near>,
    pub columns: Columns,
}

impl Found {
    pub fn row(&self, i: usize) -> &[Near] {
        &self.nearest[i * self.width..(i + 1) * self.width]
    }

    pub fn rows(&self) -> impl Iterator<Item = &[Near]> {
        self.nearest.chunks_exact(self.width.max(1))
    }
}

/// Single-precision copy of one side, scaled so that nothing over- or underflows.
struct Scaled {
    values: Vec<f32>,
    squared_norms: Vec<f32>,
    norms: Vec<f64>,
    farthest: f64,
}

impl Scaled {
    fn new(side: &Descriptors, unit: f64) -> Result<Self> {
        let values = memory::collect(side.values().iter().map(|value| (value * unit) as f32))?;
        let norm = |row: &[f64]| row.iter().map(|value| (value * unit).powi(2)).sum::<f64>().sqrt();
        let norms = memory::collect(side.values().chunks_exact(side.length.max(1)).map(norm))?;
        let squared_norms = memory::collect(norms.iter().map(|norm| (norm * norm) as f32))?;
        let farthest = norms.iter().copied().fold(0.0, f64::max);
        Ok(Self { values, squared_norms, norms, farthest })
    }
}

/// Two sides, prepared for multiplication.
pub(super) struct Product<'a> {
    source: &'a Descriptors,
    target: &'a Descriptors,
    a: Scaled,
    b: Scaled,
    /// The power of two that scales the largest value to about 1.
    pub unit: f64,
}

impl<'a> Product<'a> {
    pub fn new(source: &'a Descriptors, target: &'a Descriptors) -> Result<Self> {
        let largest = source.largest().max(target.largest());
        Self::with_unit(source, target, unit_scale(largest))
    }

    pub fn with_unit(source: &'a Descriptors, target: &'a Descriptors, unit: f64) -> Result<Self> {
        Ok(Self { source, target, a: Scaled::new(source, unit)?, b: Scaled::new(target, unit)?, unit })
    }

    /// Number of targets.
    pub fn targets(&self) -> usize {
        self.target.len()
    }

    /// Some of the targets as sources, with the sources as targets.
    pub fn reversed(&self, targets: &[usize]) -> Result<(Descriptors, &'a Descriptors)> {
        Ok((self.target.subset(targets)?, self.source))
    }

    /// Whether single precision does not determine the source row nearest to target `j`.
    pub fn is_open(&self, columns: &Columns, j: usize) -> bool {
        columns.lead(j) <= 2.0 * error_bound(self.source.length, self.b.norms[j], self.a.farthest)
    }

    /// The `count` nearest targets of every source row (all if there are fewer), by (distance, index).
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if descriptors that are not equal have a distance too small to square;
    /// [`Error::Interrupted`], [`Error::OutOfMemory`].
    pub fn nearest(&self, count: usize, execution: &Execution) -> Result<Found> {
        let (targets, width) = (self.targets(), count.min(self.targets()));
        let mut nearest = memory::filled(Near::default(), width * self.source.len())?;
        let blocks = nearest.par_chunks_mut((SOURCE_BLOCK * width).max(1)).enumerate();
        let columns = blocks
            .try_fold(Columns::default, |columns, (block, results)| {
                let mut columns = columns.or_new(targets)?;
                self.search(block * SOURCE_BLOCK, width, results, &mut columns, execution)?;
                Ok(columns)
            })
            .try_reduce(Columns::default, |one, other| Ok(one.merge(other)))?;
        Ok(Found { width, nearest, columns: columns.or_new(targets)? })
    }

    /// Finds the nearest targets of the source rows from `start` on.
    fn search(
        &self,
        start: usize,
        width: usize,
        results: &mut [Near],
        columns: &mut Columns,
        execution: &Execution,
    ) -> Result<()> {
        let length = self.source.length;
        let slack = |i: usize| error_bound(length, self.a.norms[i], self.b.farthest);
        let end = start + results.len() / width;
        let mut candidates = memory::try_collect((start..end).map(|i| Candidates::new(width, slack(i))))?;
        self.scan_targets(start, &mut candidates, columns, execution)?;
        for ((i, found), result) in (start..).zip(&candidates).zip(results.chunks_exact_mut(width)) {
            self.select(i, found.indices(), result)?;
        }
        Ok(())
    }

    /// Scans all targets for every source row of a block, and vice versa.
    fn scan_targets(
        &self,
        start: usize,
        candidates: &mut [Candidates],
        columns: &mut Columns,
        execution: &Execution,
    ) -> Result<()> {
        let (count, length) = (candidates.len(), self.source.length);
        let lhs = MatRef::from_row_major_slice(
            &self.a.values[start * length..(start + count) * length],
            count,
            length,
        );
        let own_norms = &self.a.squared_norms[start..start + count];
        let mut product = memory::filled(0.0_f32, count * TARGET_BLOCK)?;
        memory::probe::<u8>(MATMUL_MEMORY)?;
        for (block, values) in self.b.values.chunks(TARGET_BLOCK * length).enumerate() {
            execution.check()?;
            let width = values.len() / length;
            let rhs = MatRef::from_row_major_slice(values, width, length).transpose();
            let used = &mut product[..count * width];
            matmul(
                MatMut::from_row_major_slice_mut(used, count, width),
                Accum::Replace,
                lhs,
                rhs,
                -2.0,
                Par::Seq,
            );
            let first = block * TARGET_BLOCK;
            let squared_norms = &self.b.squared_norms[first..first + width];
            let rows = candidates.iter_mut().zip(product.chunks_exact(width));
            for (((found, products), &own), row) in rows.zip(own_norms).zip(start as u32..) {
                simd::run(
                    #[inline(always)]
                    || {
                        columns.scan(products, own, row, first);
                        found.scan(products, squared_norms, first as u32)
                    },
                )?;
            }
        }
        Ok(())
    }

    /// Selects the nearest of the candidates, in double precision.
    fn select(&self, i: usize, candidates: impl Iterator<Item = u32>, result: &mut [Near]) -> Result<()> {
        let row = self.source.row(i);
        let mut exact = memory::with_capacity(result.len())?;
        for index in candidates {
            let other = self.target.row(index as usize);
            let difference = row.iter().zip(other).map(|(a, b)| a * self.unit - b * self.unit);
            let square: f64 = difference.map(|d| d * d).sum();
            if square < LEAST_SQUARE && row != other {
                let remedy = "squares of their differences vanish beside the largest value; leave such rows out or scale them";
                return Err(Error::invalid("source, target", "descriptors of very different size", remedy));
            }
            memory::push(&mut exact, Near { index, distance: square.sqrt() })?;
        }
        exact.sort_unstable_by(|a, b| a.distance.total_cmp(&b.distance).then(a.index.cmp(&b.index)));
        result.copy_from_slice(&exact[..result.len()]);
        Ok(())
    }
}

/// Bound on the error of the computed `|b|^2 - 2 a.b`, for any order of summation.
fn error_bound(length: usize, norm: f64, farthest: f64) -> f32 {
    (2.0 * UNIT_ROUNDOFF * (length + 8) as f64 * (norm + farthest) * farthest + 1e-30) as f32
}
