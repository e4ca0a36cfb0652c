//! The affinity matrix M of some rows, stored densely: faster than bit lookups if many pairs agree.

use rayon::prelude::*;

use super::affinity::{Affinity, Terms};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::simd;

/// Number of partial sums computed in parallel; the width of a row is a multiple of it.
const SUMS: usize = 16;

/// Most bytes of the entries.
const MOST_BYTES: usize = 32 << 20;

/// Marks rows of M that are not stored.
const NOWHERE: u32 = u32::MAX;

/// The entries of M among some rows; 0 on the diagonal.
#[derive(Debug)]
pub struct Dense {
    rows: Vec<usize>,
    /// Stored index of each row of M.
    places: Vec<u32>,
    width: usize,
    entries: Vec<f32>,
}

impl Dense {
    /// Stores some rows, ascending; `None` if they need too much memory.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn new(
        affinity: &Affinity,
        n: usize,
        rows: Vec<usize>,
        execution: &Execution,
    ) -> Result<Option<Self>> {
        let width = rows.len().next_multiple_of(SUMS);
        let bytes = size_of::<f32>() * width * rows.len();
        if rows.is_empty() || bytes > MOST_BYTES.min(execution.max_memory.saturating_sub(affinity.bytes())) {
            return Ok(None);
        }
        let mut places = memory::filled(NOWHERE, n)?;
        for (place, &row) in (0..).zip(&rows) {
            places[row] = place;
        }
        let mut entries = memory::filled(0.0, width * rows.len())?;
        entries.par_chunks_mut(width).zip(&rows).with_min_len(8).try_for_each_init(
            Default::default,
            |scratch, (entries, &row)| {
                affinity.for_each(row, scratch, |j, weight| {
                    if let Some(entry) = entries.get_mut(places[j as usize] as usize) {
                        *entry = weight;
                    }
                })?;
                execution.check()
            },
        )?;
        Ok(Some(Self { rows, places, width, entries }))
    }

    /// Restricts the matrix to some of its rows, ascending.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn among(&self, rows: Vec<usize>) -> Result<Self> {
        let width = rows.len().next_multiple_of(SUMS);
        let kept = memory::collect(rows.iter().map(|&row| self.places[row] as usize))?;
        let mut places = memory::filled(NOWHERE, self.places.len())?;
        for (place, &row) in (0..).zip(&rows) {
            places[row] = place;
        }
        let mut entries = memory::filled(0.0, width * rows.len())?;
        entries.par_chunks_mut(width.max(1)).zip(&kept).with_min_len(32).for_each(|(entries, &row)| {
            let from = &self.entries[row * self.width..][..self.width];
            entries.iter_mut().zip(&kept).for_each(|(entry, &place)| *entry = from[place]);
        });
        Ok(Self { rows, places, width, entries })
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether a row of M is stored.
    pub fn has(&self, row: usize) -> bool {
        self.places[row] != NOWHERE
    }

    /// The terms of some stored rows of a non-negative vector that is 0 in all other rows.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn terms(&self, u: &[f64], rows: &[usize], execution: &Execution) -> Result<Vec<Terms>> {
        let total: f64 = u.iter().sum();
        let mut values = memory::with_capacity(self.width)?;
        values.extend(self.rows.iter().map(|&row| u[row]));
        values.resize(self.width, 0.0);
        let terms = rows.par_iter().with_min_len(32).map(|&row| {
            execution.check()?;
            let start = self.places[row] as usize * self.width;
            let [affinity, agreement] = sums(&self.entries[start..start + self.width], &values);
            Ok([affinity + u[row], total - agreement - u[row]])
        });
        memory::par_try_collect(terms)
    }
}

/// Weighted sum of the values, and sum of those with a nonzero weight.
fn sums(weights: &[f32], values: &[f64]) -> [f64; 2] {
    let [weighted, plain] = simd::run(
        #[inline(always)]
        || {
            let (mut weighted, mut plain) = ([0.0; SUMS], [0.0; SUMS]);
            for (weights, values) in weights.as_chunks::<SUMS>().0.iter().zip(values.as_chunks::<SUMS>().0) {
                for k in 0..SUMS {
                    weighted[k] += f64::from(weights[k]) * values[k];
                    plain[k] += if weights[k] > 0.0 { values[k] } else { 0.0 };
                }
            }
            [weighted, plain]
        },
    );
    [weighted.iter().sum(), plain.iter().sum()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compatibility::graph::AgreementGraph;
    use crate::points::Points;

    #[test]
    fn terms_are_those_of_the_whole_matrix() -> Result<()> {
        let place = |i: usize, k: f64| [(i as f64 * k).sin(), (i as f64 * 1.7 * k).cos(), (i as f64).cos()];
        let points = |k: f64| Points::from_rows("points", &(0..200).map(|i| place(i, k)).collect::<Vec<_>>());
        let (source, target) = (points(0.37)?, points(0.4)?);
        let execution = Execution::default();
        let graph = AgreementGraph::new(&source, &target, 0.3, 0.0, &execution)?;
        for affinity in [
            Affinity::binary(&graph),
            Affinity::weighted(&graph, &source, &target, 0.1, &execution)?,
            Affinity::weighted(&graph, &source, &target, 0.1, &Execution::new(graph.bytes()))?,
        ] {
            let rows: Vec<usize> = (0..200).filter(|i| i % 3 > 0).collect();
            let u: Vec<f64> =
                (0..200).map(|i| if i % 3 > 0 { f64::from(i).sin().max(0.0) } else { 0.0 }).collect();
            let expected = affinity.terms(&u, &rows, &execution)?;
            let dense = Dense::new(&affinity, 200, rows.clone(), &execution)?;
            let found =
                dense.map(|dense| dense.terms(&u, &rows, &execution)).transpose()?.unwrap_or_default();
            assert_eq!(found.len(), rows.len());
            let all = Dense::new(&affinity, 200, (0..200).collect(), &execution)?;
            let again = all.map(|all| all.among(rows.clone())?.terms(&u, &rows, &execution)).transpose()?;
            assert_eq!(again.as_ref(), Some(&found));
            for (a, b) in found.as_flattened().iter().zip(expected.as_flattened()) {
                assert!((a - b).abs() < 1e-12);
            }
        }
        Ok(())
    }
}
