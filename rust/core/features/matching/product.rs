//! One pass over the matrix product of two sides, which bounds all squared distances.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::candidates::Candidates;
use super::columns::Columns;
use super::descriptors::Descriptors;
use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::points::unit_scale;
use crate::simd;

/// Source rows and target rows of one matrix product: the product stays in the second-level cache.
const SOURCE_BLOCK: usize = 96;
const TARGET_BLOCK: usize = 1024;
/// Half a unit in the last place of 1 in single precision.
const UNIT_ROUNDOFF: f64 = 1.0 / (1 << 24) as f64;

/// A target, and its distance from a source row, scaled.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Near {
    pub index: u32,
    pub distance: f64,
}

/// The nearest targets of every source row, and what is known of the nearest source rows.
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
    fn new(side: &Descriptors, unit: f64) -> Self {
        let values = side.values().iter().map(|value| (value * unit) as f32).collect();
        let norm = |row: &[f64]| row.iter().map(|value| (value * unit).powi(2)).sum::<f64>().sqrt();
        let norms: Vec<f64> = side.values().chunks_exact(side.length.max(1)).map(norm).collect();
        let squared_norms = norms.iter().map(|norm| (norm * norm) as f32).collect();
        let farthest = norms.iter().copied().fold(0.0, f64::max);
        Self { values, squared_norms, norms, farthest }
    }
}

/// Two sides, ready to be multiplied.
pub(super) struct Product<'a> {
    source: &'a Descriptors,
    target: &'a Descriptors,
    a: Scaled,
    b: Scaled,
    /// The power of two that brings the largest value to about 1.
    pub unit: f64,
}

impl<'a> Product<'a> {
    pub fn new(source: &'a Descriptors, target: &'a Descriptors) -> Self {
        let largest = source.largest().max(target.largest());
        // The inverse of anything smaller is infinite.
        let unit = if largest > 0.0 { unit_scale(largest.max(f64::MIN_POSITIVE)) } else { 1.0 };
        Self::with_unit(source, target, unit)
    }

    pub fn with_unit(source: &'a Descriptors, target: &'a Descriptors, unit: f64) -> Self {
        Self { source, target, a: Scaled::new(source, unit), b: Scaled::new(target, unit), unit }
    }

    /// Number of targets.
    pub fn targets(&self) -> usize {
        self.target.len()
    }

    /// Some of the targets as sources, and the sources as targets.
    pub fn reversed(&self, targets: &[usize]) -> (Descriptors, &'a Descriptors) {
        (self.target.subset(targets), self.source)
    }

    /// Whether single precision leaves open which source row is nearest to target `j`.
    pub fn is_open(&self, columns: &Columns, j: usize) -> bool {
        columns.lead(j) <= 2.0 * error_bound(self.source.length, self.b.norms[j], self.a.farthest)
    }

    /// The `count` nearest targets of every source row, as many as there are, by (distance, index).
    ///
    /// # Errors
    /// [`Error::InvalidInput`] where descriptors that are not equal have a distance of 0; [`Error::Interrupted`].
    pub fn nearest(&self, count: usize, execution: &Execution) -> Result<Found> {
        let (targets, width) = (self.targets(), count.min(self.targets()));
        let mut nearest = vec![Near::default(); width * self.source.len()];
        let blocks = nearest.par_chunks_mut((SOURCE_BLOCK * width).max(1)).enumerate();
        let columns = blocks
            .try_fold(
                || Columns::new(targets),
                |mut columns, (block, results)| {
                    self.search(block * SOURCE_BLOCK, width, results, &mut columns, execution)?;
                    Ok(columns)
                },
            )
            .try_reduce(|| Columns::new(targets), |one, other| Ok(one.merge(&other)))?;
        Ok(Found { width, nearest, columns })
    }

    /// The nearest targets of the source rows from `start` on.
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
        let mut candidates: Vec<_> = (start..end).map(|i| Candidates::new(width, slack(i))).collect();
        self.scan_targets(start, &mut candidates, columns, execution)?;
        for ((i, found), result) in (start..).zip(&candidates).zip(results.chunks_exact_mut(width)) {
            self.select(i, found.indices(), result)?;
        }
        Ok(())
    }

    /// Offers every target to every source row of a block, and the other way round.
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
        let mut product = vec![0.0_f32; count * TARGET_BLOCK];
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
                        found.scan(products, squared_norms, first as u32);
                        columns.scan(products, own, row, first);
                    },
                );
            }
        }
        Ok(())
    }

    /// The nearest of the candidates, in double precision.
    fn select(&self, i: usize, candidates: impl Iterator<Item = u32>, result: &mut [Near]) -> Result<()> {
        let row = self.source.row(i);
        let mut exact = Vec::with_capacity(result.len());
        for index in candidates {
            let other = self.target.row(index as usize);
            let difference = row.iter().zip(other).map(|(a, b)| a * self.unit - b * self.unit);
            let square: f64 = difference.map(|d| d * d).sum();
            if square == 0.0 && row != other {
                let remedy =
                    "their squares vanish beside the largest value; leave such rows out or scale them";
                return Err(Error::invalid("source, target", "descriptors of very different size", remedy));
            }
            exact.push(Near { index, distance: square.sqrt() });
        }
        exact.sort_unstable_by(|a, b| a.distance.total_cmp(&b.distance).then(a.index.cmp(&b.index)));
        result.copy_from_slice(&exact[..result.len()]);
        Ok(())
    }
}

/// Bound on the error of `|b|^2 - 2 a.b` as it is computed, whatever the order of summation.
fn error_bound(length: usize, norm: f64, farthest: f64) -> f32 {
    (2.0 * UNIT_ROUNDOFF * (length + 8) as f64 * (norm + farthest) * farthest + 1e-30) as f32
}
