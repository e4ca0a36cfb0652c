//! The matrix of pairwise scores of all correspondences: stored while it fits, else recomputed by rows.

use rayon::prelude::*;

use super::kernels::{Element, Side, dispatch, dot, fill_row, sum};
use crate::error::Result;
use crate::execution::Execution;
use crate::points::Points;

/// Above this many correspondences pair scores are kept in f32; sums stay in f64.
const F64_LIMIT: usize = 4000;

/// Rows that one task computes between two looks at the interruption flag.
const ROWS_PER_TASK: usize = 16;

/// What a pair of correspondences scores. Pairs with a zero-length edge score 0 unless said otherwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PairScore {
    /// `rho = min(ds/dt, dt/ds)`.
    DistanceRatio,
    /// rho where it is at least this, else 0.
    DistanceRatioFrom(f64),
    /// 1 where rho is at least this, else 0.
    DistanceRatioIndicator(f64),
    /// 1 where `|ds - dt|` is at most `tolerance`, else 0.
    DistanceDifferenceIndicator {
        /// Greatest difference, a length.
        tolerance: f64,
        /// Whether pairs that share a source or a target point score 0.
        one_to_one: bool,
    },
}

/// Source and target coordinates in the storage type.
#[derive(Debug, Clone)]
pub struct PairPositions<T> {
    source: Side<T>,
    target: Side<T>,
    /// Factor from the data's unit to the stored one; f32 squares would under- or overflow without it.
    scale: f64,
}

impl<T: Element> PairPositions<T> {
    /// Converts the coordinates.
    pub fn new(source: &Points, target: &Points) -> Self {
        // A power of two, so that scaling is exact.
        let extent = source.diagonal().max(target.diagonal());
        let scale = if extent > 0.0 { (-extent.log2().round()).exp2() } else { 1.0 };
        let side = |points: &Points| {
            let convert = |axis: &[f64]| axis.iter().map(|value| T::from_f64(value * scale)).collect();
            let zero = points.zero_length() * scale;
            Side {
                x: convert(&points.x),
                y: convert(&points.y),
                z: convert(&points.z),
                zero_squared: T::from_f64(zero * zero),
            }
        };
        Self { source: side(source), target: side(target), scale }
    }

    /// The rows `indices` alone.
    #[must_use]
    pub fn subset(&self, indices: &[usize]) -> Self {
        let side = |side: &Side<T>| {
            let pick = |axis: &[T]| indices.iter().map(|&i| axis[i]).collect();
            Side { x: pick(&side.x), y: pick(&side.y), z: pick(&side.z), zero_squared: side.zero_squared }
        };
        Self { source: side(&self.source), target: side(&self.target), scale: self.scale }
    }

    /// Number of correspondences.
    pub fn len(&self) -> usize {
        self.source.x.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Writes the scores of correspondence `i` with all others; its score with itself is 0.
    pub fn fill_row(&self, score: PairScore, i: usize, row: &mut [T]) {
        let (source, target, zero) = (&self.source, &self.target, T::default());
        let rho = |ds: T, dt: T| T::ratio(ds, dt).sqrt();
        match score {
            PairScore::DistanceRatio => dispatch(
                #[inline(always)]
                || fill_row(source, target, i, row, rho),
            ),
            PairScore::DistanceRatioFrom(least) => {
                let least = T::from_f64(least);
                dispatch(
                    #[inline(always)]
                    || {
                        fill_row(source, target, i, row, |ds, dt| {
                            let value = rho(ds, dt);
                            if value >= least { value } else { zero }
                        });
                    },
                );
            }
            PairScore::DistanceRatioIndicator(least) => {
                let least = T::from_f64(least);
                dispatch(
                    #[inline(always)]
                    || {
                        fill_row(
                            source,
                            target,
                            i,
                            row,
                            |ds, dt| if rho(ds, dt) >= least { T::ONE } else { zero },
                        );
                    },
                );
            }
            PairScore::DistanceDifferenceIndicator { tolerance, .. } => {
                let tolerance = T::from_f64(tolerance * self.scale);
                dispatch(
                    #[inline(always)]
                    || {
                        fill_row(source, target, i, row, |ds, dt| {
                            let difference = T::absolute_difference(ds.sqrt(), dt.sqrt());
                            if difference <= tolerance { T::ONE } else { zero }
                        });
                    },
                );
            }
        }
        row[i] = zero;
    }

    fn allow_shared_points(&mut self) {
        let below_any = T::from_f64(-1.0);
        self.source.zero_squared = below_any;
        self.target.zero_squared = below_any;
    }
}

/// Symmetric matrix of pair scores with a given diagonal.
#[derive(Debug)]
pub enum PairMatrix {
    /// Entries in f64.
    Double(Rows<f64>),
    /// Entries in f32.
    Single(Rows<f32>),
}

/// The matrix in one storage type.
#[derive(Debug)]
pub struct Rows<T> {
    positions: PairPositions<T>,
    score: PairScore,
    diagonal: Option<Vec<f64>>,
    dense: Option<Vec<T>>,
}

impl PairMatrix {
    /// Builds the matrix; `diagonal` is zero where it is not given.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn new(
        source: &Points,
        target: &Points,
        score: PairScore,
        diagonal: Option<Vec<f64>>,
        execution: &Execution,
    ) -> Result<Self> {
        if source.len() <= F64_LIMIT {
            let positions = PairPositions::new(source, target);
            return Ok(Self::Double(Rows::new(positions, score, diagonal, execution)?));
        }
        let positions = PairPositions::new(source, target);
        Ok(Self::Single(Rows::new(positions, score, diagonal, execution)?))
    }

    /// The matrix of the correspondences `indices` alone.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn subset(&self, indices: &[usize], execution: &Execution) -> Result<Self> {
        Ok(match self {
            Self::Double(rows) => Self::Double(rows.subset(indices, execution)?),
            Self::Single(rows) => Self::Single(rows.subset(indices, execution)?),
        })
    }

    /// Number of correspondences.
    pub fn len(&self) -> usize {
        match self {
            Self::Double(rows) => rows.positions.len(),
            Self::Single(rows) => rows.positions.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// `M x`.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn multiply(&self, x: &[f64], execution: &Execution) -> Result<Vec<f64>> {
        match self {
            Self::Double(rows) => rows.map(execution, |row| {
                dispatch(
                    #[inline(always)]
                    || dot(row, x),
                )
            }),
            Self::Single(rows) => rows.map(execution, |row| {
                dispatch(
                    #[inline(always)]
                    || dot(row, x),
                )
            }),
        }
    }

    /// Row `i` in f64.
    pub fn row(&self, i: usize) -> Vec<f64> {
        match self {
            Self::Double(rows) => rows.row(i),
            Self::Single(rows) => rows.row(i),
        }
    }

    /// Mean of the row sums.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn mean_row_sum(&self, execution: &Execution) -> Result<f64> {
        let row_sums = self.multiply(&vec![1.0; self.len()], execution)?;
        Ok(sum(&row_sums) / self.len().max(1) as f64)
    }
}

impl<T: Element> Rows<T> {
    fn new(
        mut positions: PairPositions<T>,
        score: PairScore,
        diagonal: Option<Vec<f64>>,
        execution: &Execution,
    ) -> Result<Self> {
        if matches!(score, PairScore::DistanceDifferenceIndicator { one_to_one: false, .. }) {
            positions.allow_shared_points();
        }
        let n = positions.len();
        let mut rows = Self { positions, score, diagonal, dense: None };
        let bytes = n.saturating_mul(n).saturating_mul(size_of::<T>());
        if n > 0 && bytes <= execution.max_memory {
            rows.dense = Some(rows.compute_dense(execution)?);
        }
        Ok(rows)
    }

    fn subset(&self, indices: &[usize], execution: &Execution) -> Result<Self> {
        let diagonal = self.diagonal.as_ref().map(|values| indices.iter().map(|&i| values[i]).collect());
        Self::new(self.positions.subset(indices), self.score, diagonal, execution)
    }

    fn compute_dense(&self, execution: &Execution) -> Result<Vec<T>> {
        let n = self.positions.len();
        let mut dense = vec![T::default(); n * n];
        dense.par_chunks_mut(n).with_min_len(ROWS_PER_TASK).enumerate().try_for_each(|(i, row)| {
            self.fill(i, row);
            execution.check()
        })?;
        Ok(dense)
    }

    fn fill(&self, i: usize, row: &mut [T]) {
        self.positions.fill_row(self.score, i, row);
        if let Some(diagonal) = &self.diagonal {
            row[i] = T::from_f64(diagonal[i]);
        }
    }

    /// One number per row, in parallel.
    fn map(&self, execution: &Execution, of_row: impl Fn(&[T]) -> f64 + Sync) -> Result<Vec<f64>> {
        let n = self.positions.len();
        let mut values = vec![0.0; n];
        values.par_chunks_mut(ROWS_PER_TASK).enumerate().try_for_each(|(task, chunk)| {
            let first = task * ROWS_PER_TASK;
            if let Some(dense) = &self.dense {
                for (value, row) in chunk.iter_mut().zip(dense[first * n..].chunks_exact(n)) {
                    *value = of_row(row);
                }
            } else {
                let mut row = vec![T::default(); n];
                for (offset, value) in chunk.iter_mut().enumerate() {
                    self.fill(first + offset, &mut row);
                    *value = of_row(&row);
                }
            }
            execution.check()
        })?;
        Ok(values)
    }

    fn row(&self, i: usize) -> Vec<f64> {
        let n = self.positions.len();
        if let Some(dense) = &self.dense {
            return dense[i * n..(i + 1) * n].iter().map(|value| value.to_f64()).collect();
        }
        let mut row = vec![T::default(); n];
        self.fill(i, &mut row);
        row.iter().map(|value| value.to_f64()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sides() -> Result<(Points, Points)> {
        let source = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 3.0, 0.0]];
        let target = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], [1.0, 3.0, 0.0]];
        Ok((Points::from_rows("source", &source)?, Points::from_rows("target", &target)?))
    }

    #[test]
    fn hand_computed_ratios() -> Result<()> {
        let (source, target) = sides()?;
        let execution = Execution::default();
        let matrix = PairMatrix::new(&source, &target, PairScore::DistanceRatio, None, &execution)?;
        let expected = [0.0, 0.5, 1.0, 3.0 / 10.0_f64.sqrt()];
        for (got, want) in matrix.row(0).iter().zip(expected) {
            assert!((got - want).abs() < 1e-15, "{got} {want}");
        }
        assert!(matrix.row(2)[3].abs() < 1e-15, "coincident source points score 0");
        Ok(())
    }

    #[test]
    fn shared_points_may_score() -> Result<()> {
        let (source, target) = sides()?;
        let execution = Execution::default();
        for (one_to_one, expected) in [(true, 0.0), (false, 1.0)] {
            let score = PairScore::DistanceDifferenceIndicator { tolerance: 1.5, one_to_one };
            let matrix = PairMatrix::new(&source, &target, score, None, &execution)?;
            assert!((matrix.row(2)[3] - expected).abs() < 1e-15);
            assert!(matrix.row(2)[2].abs() < 1e-15, "no score with itself");
        }
        Ok(())
    }

    #[test]
    fn stored_and_recomputed_rows_are_equal() -> Result<()> {
        let (source, target) = sides()?;
        let x = [0.1, 0.2, 0.3, 0.4];
        let diagonal = Some(vec![1.0; 4]);
        let mut products = Vec::new();
        for max_memory in [0, usize::MAX] {
            let execution = Execution::new(max_memory);
            let matrix =
                PairMatrix::new(&source, &target, PairScore::DistanceRatio, diagonal.clone(), &execution)?;
            products.push(matrix.multiply(&x, &execution)?);
        }
        assert_eq!(products[0], products[1]);
        Ok(())
    }
}
