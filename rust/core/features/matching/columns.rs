//! The nearest source row of every target, within single precision.

#![expect(clippy::inline_always, reason = "must inherit the vector features of the surrounding loop")]

use crate::error::Result;
use crate::memory;

/// The smallest and second-smallest value of every target so far, and the source row of the smallest. Merging
/// in any order gives the same result, except for the row of equal values.
#[derive(Debug, Clone, Default)]
pub(super) struct Columns {
    smallest: Vec<f32>,
    second: Vec<f32>,
    rows: Vec<u32>,
}

impl Columns {
    /// These columns, or new ones for `targets` targets if empty.
    pub fn or_new(self, targets: usize) -> Result<Self> {
        if !self.rows.is_empty() {
            return Ok(self);
        }
        let none = || memory::filled(f32::INFINITY, targets);
        Ok(Self { smallest: none()?, second: none()?, rows: memory::filled(0, targets)? })
    }

    /// Updates the targets from `first` on with `product + squared norm` of source row `row`.
    #[inline(always)]
    pub fn scan(&mut self, products: &[f32], squared_norm: f32, row: u32, first: usize) {
        let range = first..first + products.len();
        let state = self.smallest[range.clone()].iter_mut().zip(&mut self.second[range.clone()]);
        for ((product, (smallest, second)), lowest) in products.iter().zip(state).zip(&mut self.rows[range]) {
            insert(product + squared_norm, row, (smallest, second, lowest));
        }
    }

    /// Merges the columns of another part of the source rows.
    pub fn merge(mut self, other: Self) -> Self {
        if self.rows.is_empty() {
            return other;
        }
        for j in 0..other.rows.len() {
            insert(
                other.smallest[j],
                other.rows[j],
                (&mut self.smallest[j], &mut self.second[j], &mut self.rows[j]),
            );
            self.second[j] = self.second[j].min(other.second[j]);
        }
        self
    }

    /// Source row of the smallest value of every target.
    pub fn lowest(&self) -> &[u32] {
        &self.rows
    }

    /// Difference of the second-smallest and the smallest value of target `j`.
    pub fn lead(&self, j: usize) -> f32 {
        self.second[j] - self.smallest[j]
    }
}

#[inline(always)]
fn insert(value: f32, row: u32, (smallest, second, lowest): (&mut f32, &mut f32, &mut u32)) {
    // Read first and written once: vector code then does not reread values just written.
    let (least, next, holder) = (*smallest, *second, *lowest);
    let is_smaller = value < least;
    let larger = if is_smaller { least } else { value };
    *smallest = if is_smaller { value } else { least };
    *second = if larger < next { larger } else { next };
    *lowest = if is_smaller { row } else { holder };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::run_on_each;

    #[test]
    fn the_two_smallest_of_every_column_in_any_order_of_parts() -> Result<()> {
        let value = |row: u32, j: usize| (f64::from(row) * 1.7 + j as f64 * 0.9).sin() as f32;
        let part = |rows: std::ops::Range<u32>| -> Result<Columns> {
            let mut columns = Columns::default().or_new(70)?;
            for row in rows {
                let products: Vec<f32> = (3..70).map(|j| value(row, j)).collect();
                columns.scan(&products, 0.5, row, 3);
            }
            Ok(columns)
        };
        let (first, last) = (part(0..20)?, part(20..50)?);
        let merged = || Columns::default().merge(last.clone()).merge(first.clone());
        for columns in run_on_each(merged) {
            for j in 3..70 {
                let mut values: Vec<_> = (0..50).map(|row| (value(row, j) + 0.5, row)).collect();
                values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
                assert_eq!(columns.lowest()[j], values[0].1);
                assert!((columns.lead(j) - (values[1].0 - values[0].0)).abs() == 0.0);
            }
            assert!(columns.lead(0).is_nan(), "no value was seen");
        }
        Ok(())
    }
}
