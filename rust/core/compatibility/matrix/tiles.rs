//! Tiling of a symmetric matrix: bands of rows, divided into tiles that fit the first-level cache.
//!
//! Only the entries from the diagonal to the right are used; each is used twice, for its row and, mirrored,
//! for its column. The tiling depends on the size alone, so sums are the same for any number of threads.

use std::ops::Range;

use rayon::prelude::*;

use super::products::{Entry, ROW_GROUP};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::simd::{Aligned, SINGLES};

/// Number of bands: enough for many threads, few enough that their sums are cheap to add.
const BANDS: usize = 64;

/// Fewest rows of a band. A matrix this small is summed row by row, so that equal rows, from duplicates, have
/// bit-equal products.
const MIN_BAND: usize = 256;

/// Columns of a tile.
pub(super) const TILE: usize = 1024;

/// Rows of a tile whose products with f32 vectors are summed in f32.
const SHORT_SUM: usize = 256;

/// Some rows at some columns; entries of rows that pad the group are ignored.
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub(super) rows: Range<usize>,
    pub(super) columns: Range<usize>,
}

/// The tiling of a matrix.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cut {
    rows: usize,
    columns: usize,
}

/// A tile: its band, the band's first row, its start in the band's entries, and its columns.
pub(super) struct Tile {
    band: usize,
    first_row: usize,
    offset: usize,
    columns: Range<usize>,
}

impl Cut {
    /// Tiling of a matrix with `size` rows and columns.
    pub(super) fn of(size: usize) -> Self {
        Self { rows: size, columns: size }
    }

    /// Pads columns to whole groups of f32.
    pub(super) fn in_whole_groups(self) -> Self {
        Self { columns: self.rows.next_multiple_of(SINGLES), ..self }
    }

    /// Rows of the bands, in whole groups except for the last one.
    fn bands(self) -> impl IndexedParallelIterator<Item = (usize, Range<usize>)> {
        let height = self.rows.div_ceil(BANDS).next_multiple_of(SINGLES).max(MIN_BAND);
        let bands = (0..self.rows.div_ceil(height)).into_par_iter();
        bands.map(move |band| (band, band * height..((band + 1) * height).min(self.rows)))
    }

    /// Tiles of a band: first its square on the diagonal, then the part to the right of it.
    fn tiles(self, band: usize, rows: &Range<usize>) -> impl Iterator<Item = Tile> {
        let cut =
            |from: usize, to: usize| (from..to).step_by(TILE).map(move |first| first..(first + TILE).min(to));
        let (first_row, square_end) = (rows.start, self.square_end(rows));
        let height = rows.len().next_multiple_of(ROW_GROUP);
        cut(rows.start, square_end).chain(cut(square_end, self.columns)).scan(0, move |offset, columns| {
            let tile = Tile { band, first_row, offset: *offset, columns };
            *offset += height * tile.columns.len();
            Some(tile)
        })
    }

    /// End of the columns of the band's square; the last band's square takes all.
    fn square_end(self, rows: &Range<usize>) -> usize {
        if rows.end == self.rows { self.columns } else { rows.end }
    }

    /// Entries of a band; its rows are padded to whole groups.
    fn band_entries(self, rows: &Range<usize>) -> usize {
        rows.len().next_multiple_of(ROW_GROUP).saturating_mul(self.columns - rows.start)
    }

    /// All tiles, filled by groups of rows, if they fit into memory.
    pub(super) fn fill_if_fits<T: Entry>(
        self,
        execution: &Execution,
        fill: impl Fn(&Part, &mut [T]) + Sync,
    ) -> Result<Option<Vec<Vec<T>>>> {
        let entries: usize = self.bands().map(|(_, rows)| self.band_entries(&rows)).sum();
        if entries == 0 || entries.saturating_mul(size_of::<T>()) > execution.max_memory {
            return Ok(None);
        }
        let fill_band = |(band, rows): (usize, Range<usize>)| {
            let mut entries = memory::with_capacity(self.band_entries(&rows))?;
            // Filled in the cache and copied; overwriting zeros would go through memory twice.
            let mut of_group = Aligned([T::default(); ROW_GROUP * TILE]);
            for Tile { columns, .. } in self.tiles(band, &rows) {
                let of_group = &mut of_group.0[..ROW_GROUP * columns.len()];
                for group in groups(&rows) {
                    fill(&Part { rows: group, columns: columns.clone() }, of_group);
                    entries.extend_from_slice(of_group);
                }
                execution.check()?;
            }
            Ok(entries)
        };
        memory::par_try_collect(self.bands().map(fill_band)).map(Some)
    }

    /// The product with `x`.
    pub(super) fn multiply<T: Entry>(
        self,
        matrix: &Rows<T, impl Fn(&Part, &mut [T]) + Sync>,
        x: &[f64],
        execution: &Execution,
    ) -> Result<Vec<f64>> {
        let filled_up = x.iter().copied().chain(std::iter::repeat(0.0));
        let x = memory::collect(filled_up.take(self.columns).map(T::number))?;
        let products = self.bands().map(|band| self.multiply_band(matrix, band, &x, execution));
        let products = memory::par_try_collect(products)?;
        let mut result = memory::with_capacity(self.rows)?;
        products.iter().for_each(|product| result.extend_from_slice(&product.own));
        result.par_chunks_mut(TILE).enumerate().for_each(|(chunk, entries)| {
            let first = chunk * TILE;
            for BandProduct { rows, mirrored, .. } in &products {
                let (skipped, shift) = (rows.end.saturating_sub(first), first.saturating_sub(rows.end));
                for (entry, below) in entries.iter_mut().skip(skipped).zip(mirrored.iter().skip(shift)) {
                    *entry += below;
                }
            }
        });
        Ok(result)
    }

    fn multiply_band<T: Entry>(
        self,
        matrix: &Rows<T, impl Fn(&Part, &mut [T]) + Sync>,
        (band, rows): (usize, Range<usize>),
        x: &[T::Number],
        execution: &Execution,
    ) -> Result<BandProduct> {
        let square_end = self.square_end(&rows);
        let mut own = memory::filled(0.0, rows.len())?;
        let mut mirrored = memory::filled(0.0, self.columns - square_end)?;
        let mut buffer = matrix.buffer()?;
        for tile in self.tiles(band, &rows) {
            execution.check()?;
            let columns = &tile.columns;
            for first in rows.clone().step_by(SHORT_SUM) {
                let part = first..(first + SHORT_SUM).min(rows.end);
                let mut below = Aligned([T::Number::default(); TILE]);
                for group in groups(&part) {
                    let entries = matrix.group(&tile, &group, &mut buffer);
                    let own_x = &x[group.clone()];
                    // 0 for rows that pad the group.
                    let weights = std::array::from_fn(|row| own_x.get(row).copied().unwrap_or_default());
                    let products = T::add_products(entries, &x[columns.clone()], weights, &mut below.0);
                    let own = &mut own[group.start - rows.start..group.end - rows.start];
                    own.iter_mut().zip(products).for_each(|(entry, product)| *entry += product);
                }
                if columns.start >= square_end {
                    let mirrored = &mut mirrored[columns.start - square_end..columns.end - square_end];
                    mirrored.iter_mut().zip(below.0).for_each(|(entry, sum)| *entry += sum.into());
                }
            }
        }
        Ok(BandProduct { rows, own, mirrored })
    }
}

/// The rows in groups.
fn groups(rows: &Range<usize>) -> impl Iterator<Item = Range<usize>> + use<> {
    let Range { start, end } = *rows;
    (start..end).step_by(ROW_GROUP).map(move |first| first..(first + ROW_GROUP).min(end))
}

/// Contribution of the rows of a band to a product.
#[derive(Clone, Default)]
struct BandProduct {
    rows: Range<usize>,
    /// To the band's own entries.
    own: Vec<f64>,
    /// To the entries after the band.
    mirrored: Vec<f64>,
}

/// Rows of tiles: stored, or computed for each product.
pub(super) struct Rows<'a, T, F> {
    pub(super) stored: Option<&'a [Vec<T>]>,
    pub(super) fill: F,
}

impl<T: Entry, F: Fn(&Part, &mut [T])> Rows<'_, T, F> {
    /// Buffer for rows that are not stored.
    fn buffer(&self) -> Result<Vec<T>> {
        memory::filled(T::default(), if self.stored.is_some() { 0 } else { ROW_GROUP * TILE })
    }

    /// A group of rows of a tile.
    fn group<'a>(&'a self, tile: &Tile, rows: &Range<usize>, buffer: &'a mut [T]) -> &'a [T] {
        let length = ROW_GROUP * tile.columns.len();
        if let Some(bands) = self.stored {
            let first = tile.offset + (rows.start - tile.first_row) * tile.columns.len();
            return &bands[tile.band][first..first + length];
        }
        let buffer = &mut buffer[..length];
        (self.fill)(&Part { rows: rows.clone(), columns: tile.columns.clone() }, buffer);
        buffer
    }
}
