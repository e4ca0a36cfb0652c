//! The symmetric matrix of pairwise scores of all correspondences: stored while it fits, else recomputed.
//!
//! Only the part from the diagonal to the right is stored or computed. It is cut into bands of rows, and
//! these into tiles that fit the first-level cache; each entry is used twice, for its row and, mirrored,
//! for its column. The cut depends on the size alone, so sums are the same for any number of threads.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use std::ops::Range;

use rayon::prelude::*;

use super::kernels::{Element, ROW_GROUP, RowsTimesVector, dispatch, dot, sum};
use super::lanes::{LaneWork, Lanes, with_lanes};
use super::pair_scores::{PairPositions, PairScore};
use crate::error::Result;
use crate::execution::Execution;
use crate::points::Points;

/// Above this many correspondences pair scores are kept in f32; sums stay in f64.
const F64_LIMIT: usize = 4000;

/// Bands that the rows are cut into: enough for many threads, few enough that their sums are cheap to add.
const BANDS: usize = 64;

/// Fewest rows of a band. So few correspondences are summed row by row, so that equal rows, as
/// duplicates have, get bit-equal products.
const MIN_BAND: usize = 256;

/// Columns of a tile.
const TILE: usize = 1024;

/// Symmetric matrix of pair scores with a given diagonal.
#[derive(Debug)]
pub enum PairMatrix {
    /// Entries in f64.
    Double(Half<f64>),
    /// Entries in f32.
    Single(Half<f32>),
}

/// The matrix in one storage type.
#[derive(Debug)]
pub struct Half<T> {
    positions: PairPositions<T>,
    score: PairScore,
    diagonal: Option<Vec<f64>>,
    /// Tile after tile of every band, if all of them fit.
    stored: Option<Vec<Vec<T>>>,
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
            return Ok(Self::Double(Half::new(positions, score, diagonal, execution)?));
        }
        let positions = PairPositions::new(source, target);
        Ok(Self::Single(Half::new(positions, score, diagonal, execution)?))
    }

    /// The matrix of the correspondences `indices` alone.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn subset(&self, indices: &[usize], execution: &Execution) -> Result<Self> {
        Ok(match self {
            Self::Double(half) => Self::Double(half.subset(indices, execution)?),
            Self::Single(half) => Self::Single(half.subset(indices, execution)?),
        })
    }

    /// The matrix of the correspondences `indices` alone, in place of this one: never both in memory.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn into_subset(mut self, indices: &[usize], execution: &Execution) -> Result<Self> {
        match &mut self {
            Self::Double(half) => half.stored = None,
            Self::Single(half) => half.stored = None,
        }
        self.subset(indices, execution)
    }

    /// Number of correspondences.
    pub fn len(&self) -> usize {
        match self {
            Self::Double(half) => half.positions.len(),
            Self::Single(half) => half.positions.len(),
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
            Self::Double(half) => half.multiply(x, execution),
            Self::Single(half) => half.multiply(x, execution),
        }
    }

    /// Row `i` in f64.
    pub fn row(&self, i: usize) -> Vec<f64> {
        match self {
            Self::Double(half) => half.row(i),
            Self::Single(half) => half.row(i),
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

/// Rows of the band, in whole groups but for the last band.
fn bands(n: usize) -> impl IndexedParallelIterator<Item = Range<usize>> {
    let height = n.div_ceil(BANDS).next_multiple_of(ROW_GROUP).max(MIN_BAND);
    (0..n.div_ceil(height)).into_par_iter().map(move |band| band * height..((band + 1) * height).min(n))
}

/// Columns of the tiles of a band: first its square on the diagonal, then what is right of it.
fn tiles(band: &Range<usize>, n: usize) -> impl Iterator<Item = Range<usize>> {
    let cut =
        |from: usize, to: usize| (from..to).step_by(TILE).map(move |first| first..(first + TILE).min(to));
    cut(band.start, band.end).chain(cut(band.end, n))
}

/// What the rows of a band contribute to a product.
struct BandProduct {
    band: Range<usize>,
    /// To their own entries.
    own: Vec<f64>,
    /// To the entries after the band.
    mirrored: Vec<f64>,
}

impl<T: Element> Half<T> {
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
        let mut half = Self { positions, score, diagonal, stored: None };
        let entries: usize = bands(n).map(|band| band.len().saturating_mul(n - band.start)).sum();
        if n > 0 && entries.saturating_mul(size_of::<T>()) <= execution.max_memory {
            half.stored = Some(half.compute(execution)?);
        }
        Ok(half)
    }

    fn subset(&self, indices: &[usize], execution: &Execution) -> Result<Self> {
        let diagonal = self.diagonal.as_ref().map(|values| indices.iter().map(|&i| values[i]).collect());
        Self::new(self.positions.subset(indices), self.score, diagonal, execution)
    }

    fn compute(&self, execution: &Execution) -> Result<Vec<Vec<T>>> {
        let n = self.positions.len();
        let band_tiles = |band: Range<usize>| {
            let mut entries = vec![T::default(); band.len() * (n - band.start)];
            let mut rest = entries.as_mut_slice();
            for columns in tiles(&band, n) {
                let (tile, after) = rest.split_at_mut(band.len() * columns.len());
                self.fill_tile(&band, &columns, tile);
                rest = after;
                execution.check()?;
            }
            Ok(entries)
        };
        bands(n).map(band_tiles).collect()
    }

    /// Writes the rows of a band for some columns, row after row.
    fn fill_tile(&self, band: &Range<usize>, columns: &Range<usize>, tile: &mut [T]) {
        for (i, row) in band.clone().zip(tile.chunks_exact_mut(columns.len())) {
            self.fill(i, columns.start, row);
        }
    }

    fn fill(&self, i: usize, first: usize, row: &mut [T]) {
        self.positions.fill_part(self.score, i, first, row);
        let itself = i.checked_sub(first).and_then(|at| row.get_mut(at));
        if let (Some(entry), Some(diagonal)) = (itself, &self.diagonal) {
            *entry = T::from_f64(diagonal[i]);
        }
    }

    fn multiply(&self, x: &[f64], execution: &Execution) -> Result<Vec<f64>> {
        let n = self.positions.len();
        let products: Vec<BandProduct> = bands(n)
            .enumerate()
            .map(|(index, band)| {
                let product = self.multiply_band(index, band, x);
                execution.check().map(|()| product)
            })
            .collect::<Result<_>>()?;
        let mut result: Vec<f64> = products.iter().flat_map(|product| product.own.iter().copied()).collect();
        result.par_chunks_mut(TILE).enumerate().for_each(|(chunk, entries)| {
            let first = chunk * TILE;
            for BandProduct { band, mirrored, .. } in &products {
                let (skipped, shift) = (band.end.saturating_sub(first), first.saturating_sub(band.end));
                for (entry, below) in entries.iter_mut().skip(skipped).zip(mirrored.iter().skip(shift)) {
                    *entry += below;
                }
            }
        });
        Ok(result)
    }

    fn multiply_band(&self, index: usize, band: Range<usize>, x: &[f64]) -> BandProduct {
        let n = self.positions.len();
        let mut own = vec![0.0; band.len()];
        let mut mirrored = vec![0.0; n - band.end];
        let mut computed = Vec::new();
        let mut offset = 0;
        for columns in tiles(&band, n) {
            let size = band.len() * columns.len();
            let tile = if let Some(bands) = &self.stored {
                &bands[index][offset..offset + size]
            } else {
                computed.resize(size, T::default());
                self.fill_tile(&band, &columns, &mut computed);
                &computed[..size]
            };
            offset += size;
            if columns.start < band.end {
                multiply_square(tile, &x[columns], &mut own);
            } else {
                let below = columns.start - band.end..columns.end - band.end;
                let (weights, mirrored) = (&x[band.clone()], &mut mirrored[below]);
                with_lanes(TileTimesVector { tile, x: &x[columns], weights, own: &mut own, mirrored });
            }
        }
        BandProduct { band, own, mirrored }
    }

    fn row(&self, i: usize) -> Vec<f64> {
        let mut row = vec![T::default(); self.positions.len()];
        self.fill(i, 0, &mut row);
        row.iter().map(|value| value.to_f64()).collect()
    }
}

/// Adds the products of the rows of a tile on the diagonal, whose entries are all there.
fn multiply_square<T: Element>(tile: &[T], x: &[f64], own: &mut [f64]) {
    dispatch(
        #[inline(always)]
        || {
            for (entry, row) in own.iter_mut().zip(tile.chunks_exact(x.len())) {
                *entry += dot(row, x);
            }
        },
    );
}

/// Adds the products of the rows of a tile to `own`, and those of its mirror image to `mirrored`; `weights`
/// are the entries of the vector at the tile's rows.
struct TileTimesVector<'a, T> {
    tile: &'a [T],
    x: &'a [f64],
    weights: &'a [f64],
    own: &'a mut [f64],
    mirrored: &'a mut [f64],
}

impl<T: Element> LaneWork for TileTimesVector<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Self { x, mirrored, .. } = self;
        let nothing = vec![T::default(); x.len()];
        let groups = self.tile.chunks(ROW_GROUP * x.len());
        let entries = self.own.chunks_mut(ROW_GROUP).zip(self.weights.chunks(ROW_GROUP));
        for (group, (own, of_rows)) in groups.zip(entries) {
            let mut rows = [nothing.as_slice(); ROW_GROUP];
            let mut weights = [0.0; ROW_GROUP];
            for (k, row) in group.chunks_exact(x.len()).enumerate() {
                (rows[k], weights[k]) = (row, of_rows[k]);
            }
            let products = RowsTimesVector { rows, x, weights, mirrored }.run(lanes);
            own.iter_mut().zip(products).for_each(|(entry, product)| *entry += product);
        }
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
    fn products_equal_those_of_whole_rows() -> Result<()> {
        for n in [1, 3, 64, 65, 300, 1500] {
            let place =
                |i: usize, k: f64| [(i as f64 * k).sin(), (i as f64 * 1.7).cos(), (i as f64 * k).cos()];
            let rows = |k: f64| (0..n).map(|i| place(i, k)).collect::<Vec<_>>();
            let (source, target) = (rows(0.37), rows(0.53));
            let (source, target) =
                (Points::from_rows("source", &source)?, Points::from_rows("target", &target)?);
            let diagonal = Some((0..n).map(|i| i as f64).collect());
            let x: Vec<f64> = (0..n).map(|i| (i as f64 * 0.9).sin()).collect();
            let mut products = Vec::new();
            for max_memory in [0, usize::MAX] {
                let execution = Execution::new(max_memory);
                let score = PairScore::DistanceRatio;
                let matrix = PairMatrix::new(&source, &target, score, diagonal.clone(), &execution)?;
                let product = matrix.multiply(&x, &execution)?;
                for (i, entry) in product.iter().enumerate() {
                    let plain: f64 = matrix.row(i).iter().zip(&x).map(|(a, b)| a * b).sum();
                    assert!((entry - plain).abs() < 1e-9, "{n} {i} {entry} {plain}");
                }
                products.push(product);
            }
            assert_eq!(products[0], products[1]);
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
