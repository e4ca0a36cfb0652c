//! Candidates for the nearest neighbours of one source descriptor.

#![expect(clippy::inline_always, reason = "must inherit the vector features of the surrounding loop")]

use crate::error::Result;
use crate::memory;

/// Values compared at once with the bound.
const CHUNK: usize = 32;
/// Candidates kept before the list is pruned.
const MAX_CANDIDATES: usize = 256;

/// Targets that may be among the nearest of one source row, by a value with bounded error.
pub(super) struct Candidates {
    slack: f32,
    /// The smallest values so far, ascending.
    lowest: Vec<f32>,
    found: Vec<(f32, u32)>,
}

impl Candidates {
    /// Candidates for the `count` nearest, with values that have an error of up to `slack`.
    pub fn new(count: usize, slack: f32) -> Result<Self> {
        Ok(Self { slack: 2.0 * slack, lowest: memory::filled(f32::INFINITY, count)?, found: Vec::new() })
    }

    /// A target with a greater value cannot be among the nearest.
    #[inline(always)]
    fn limit(&self) -> f32 {
        self.lowest[self.lowest.len() - 1] + self.slack
    }

    /// Scans `product + squared norm` of targets from `first` on.
    #[inline(always)]
    pub fn scan(&mut self, products: &[f32], squared_norms: &[f32], first: u32) -> Result<()> {
        let chunks = products.chunks(CHUNK).zip(squared_norms.chunks(CHUNK));
        for ((products, norms), start) in chunks.zip((first..).step_by(CHUNK)) {
            let limit = self.limit();
            let hits: u32 = products.iter().zip(norms).map(|(p, n)| u32::from(p + n <= limit)).sum();
            if hits > 0 {
                self.offer_all(products, norms, start)?;
            }
        }
        Ok(())
    }

    fn offer_all(&mut self, products: &[f32], norms: &[f32], start: u32) -> Result<()> {
        for ((product, norm), index) in products.iter().zip(norms).zip(start..) {
            self.offer(product + norm, index)?;
        }
        Ok(())
    }

    fn offer(&mut self, value: f32, index: u32) -> Result<()> {
        if value > self.limit() {
            return Ok(());
        }
        let place = self.lowest.partition_point(|&lower| lower <= value);
        if place < self.lowest.len() {
            self.lowest[place..].rotate_right(1);
            self.lowest[place] = value;
        }
        memory::push(&mut self.found, (value, index))?;
        if self.found.len().is_multiple_of(MAX_CANDIDATES) {
            let limit = self.limit();
            self.found.retain(|&(value, _)| value <= limit);
        }
        Ok(())
    }

    /// The candidates in ascending order.
    pub fn indices(&self) -> impl Iterator<Item = u32> {
        let limit = self.limit();
        self.found.iter().filter(move |&&(value, _)| value <= limit).map(|&(_, index)| index)
    }
}
