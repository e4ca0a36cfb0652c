//! Descriptors of one side.

use crate::error::{Error, Result};

/// Descriptors of one side; rows that are not finite stand for keypoints without a descriptor and are
/// left out.
#[derive(Debug, Clone, Default)]
pub struct Descriptors {
    values: Vec<f64>,
    pub(super) length: usize,
    /// Which of the given rows these are.
    pub(super) rows: Vec<usize>,
}

impl Descriptors {
    /// Takes descriptors of `length` numbers each, row after row.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] for a length of 0 or an incomplete last row; `name` is used in it.
    pub fn new<T: Copy + Into<f64>>(name: &str, values: &[T], length: usize) -> Result<Self> {
        if length == 0 || !values.len().is_multiple_of(length) {
            let got = format!("{} values for rows of {length}", values.len());
            return Err(Error::invalid(name, got, "give one row of equal length per keypoint"));
        }
        let is_complete = |row: &&[T]| row.iter().all(|&value| value.into().is_finite());
        let complete = values.chunks_exact(length).enumerate().filter(|(_, row)| is_complete(row));
        let rows = complete.map(|(i, _)| i).collect::<Vec<_>>();
        let kept = rows.iter().flat_map(|&i| &values[i * length..(i + 1) * length]);
        let values = kept.map(|&value| value.into()).collect();
        Ok(Self { values, length, rows })
    }

    /// Number of descriptors that take part.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether none takes part.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    pub(super) fn row(&self, i: usize) -> &[f64] {
        &self.values[i * self.length..(i + 1) * self.length]
    }

    pub(super) fn values(&self) -> &[f64] {
        &self.values
    }

    /// Those of the descriptors alone.
    pub(super) fn subset(&self, indices: &[usize]) -> Self {
        let values = indices.iter().flat_map(|&i| self.row(i)).copied().collect();
        Self { values, length: self.length, rows: indices.to_vec() }
    }

    pub(super) fn largest(&self) -> f64 {
        self.values.iter().fold(0.0, |largest, value| value.abs().max(largest))
    }
}
