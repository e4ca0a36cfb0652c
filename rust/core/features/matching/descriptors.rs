//! Descriptors of one side.

use crate::error::{Error, Result};
use crate::memory;

/// Descriptors of one side, without rows that are not finite: keypoints without a descriptor.
#[derive(Debug, Clone, Default)]
pub struct Descriptors {
    values: Vec<f64>,
    pub(super) length: usize,
    /// Indices of the kept rows in the input.
    pub(super) rows: Vec<usize>,
}

impl Descriptors {
    /// Reads descriptors of `length` numbers each, by rows.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a length of 0 or an incomplete last row, with `name` in its message.
    /// [`Error::OutOfMemory`].
    pub fn new<T: Copy + Into<f64>>(name: &str, values: &[T], length: usize) -> Result<Self> {
        if length == 0 || !values.len().is_multiple_of(length) {
            let got = format!("{} values for rows of {length}", values.len());
            return Err(Error::invalid(name, got, "give one row of equal length per keypoint"));
        }
        let mut values = copied(values)?;
        let mut rows = Vec::new();
        for i in 0..values.len() / length {
            let row = i * length..(i + 1) * length;
            if values[row.clone()].iter().all(|value| value.is_finite()) {
                values.copy_within(row, rows.len() * length);
                memory::push(&mut rows, i)?;
            }
        }
        values.truncate(rows.len() * length);
        Ok(Self { values, length, rows })
    }

    /// Number of finite descriptors.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is no finite descriptor.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    pub(super) fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.length..(i + 1) * self.length]
    }

    /// Numbers of the finite descriptors, row by row.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The descriptors at `indices`.
    pub(super) fn subset(&self, indices: &[usize]) -> Result<Self> {
        let mut values = memory::with_capacity(indices.len() * self.length)?;
        indices.iter().for_each(|&i| values.extend_from_slice(self.row(i)));
        Ok(Self { values, length: self.length, rows: memory::copied(indices)? })
    }

    pub(super) fn largest(&self) -> f64 {
        self.values.iter().fold(0.0, |largest, value| value.abs().max(largest))
    }
}

/// Copies the numbers, read once: another process may write to them meanwhile. Never inlined, so that the
/// compiler does not read them a second time.
#[inline(never)]
fn copied<T: Copy + Into<f64>>(values: &[T]) -> Result<Vec<f64>> {
    memory::collect(values.iter().map(|&value| value.into()))
}
