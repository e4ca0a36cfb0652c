//! The matrices of affinities and of agreement, and their products with a vector.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use rayon::prelude::*;

use crate::compatibility::graph::{AgreementGraph, ones};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;
use crate::simd::arithmetic::exp_of_negative;
use crate::simd::{self, Kernel, Lanes};

/// Correspondences per word.
const WORD: usize = u64::BITS as usize;

/// Number of partial sums computed in parallel.
const SUMS: usize = 4;

/// M and C of the pairs connected by a graph; both have 1 on the diagonal.
#[derive(Debug)]
pub struct Affinity<'a> {
    graph: &'a AgreementGraph,
    weights: Weights<'a>,
}

/// The entries of M.
#[derive(Debug)]
enum Weights<'a> {
    /// All entries are 1.
    Binary,
    /// Entries by rows, in the order of the bits; row i starts at `starts[i]`.
    Kept { starts: Vec<usize>, entries: Vec<f32> },
    /// Entries computed for each product.
    Computed(Gauss<'a>),
}

/// `exp(-delta^2 / (2 sigma^2))`.
#[derive(Debug, Clone, Copy)]
struct Gauss<'a> {
    source: &'a Points,
    target: &'a Points,
    factor: f64,
}

/// Terms of row i: `(M u)_i`, and the part of u that it excludes, `((1 1' - C) u)_i`.
pub type Terms = [f64; 2];

impl<'a> Affinity<'a> {
    /// Affinity with M = C.
    pub fn binary(graph: &'a AgreementGraph) -> Self {
        Self { graph, weights: Weights::Binary }
    }

    /// Affinity with M a Gaussian of the distance difference; stored if it fits `execution.max_memory` beside
    /// the graph.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn weighted(
        graph: &'a AgreementGraph,
        source: &'a Points,
        target: &'a Points,
        deviation: f64,
        execution: &Execution,
    ) -> Result<Self> {
        let n = graph.len();
        let gauss = Gauss { source, target, factor: -0.5 / (deviation * deviation) };
        let degrees = memory::par_collect((0..n).into_par_iter().map(|i| graph.degree(i) as usize))?;
        let total: usize = degrees.iter().sum();
        if graph.bytes() + size_of::<f32>() * total > execution.max_memory {
            return Ok(Self { graph, weights: Weights::Computed(gauss) });
        }
        let mut entries = memory::filled(0.0, total)?;
        let mut starts = memory::with_capacity(n)?;
        let mut rows = memory::with_capacity(n)?;
        let mut rest = entries.as_mut_slice();
        for &degree in &degrees {
            starts.push(total - rest.len());
            let (row, after) = rest.split_at_mut(degree);
            rows.push(row);
            rest = after;
        }
        let rows = rows.into_par_iter().enumerate().with_min_len(8);
        rows.try_for_each_init(Scratch::default, |scratch, (i, row)| {
            gauss.fill(i, graph.row(i), scratch)?;
            row.copy_from_slice(&scratch.weights);
            execution.check()
        })?;
        Ok(Self { graph, weights: Weights::Kept { starts, entries } })
    }

    /// Memory of the graph and the entries.
    pub fn bytes(&self) -> usize {
        let entries = match &self.weights {
            Weights::Kept { entries, .. } => size_of_val(entries.as_slice()),
            Weights::Binary | Weights::Computed(_) => 0,
        };
        self.graph.bytes() + entries
    }

    /// Calls `give` with the neighbours of a row, ascending, and their entries of M.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn for_each(&self, i: usize, scratch: &mut Scratch, mut give: impl FnMut(u32, f32)) -> Result<()> {
        let row = self.graph.row(i);
        let neighbors = row.iter().enumerate().flat_map(|(word, &bits)| ones(word, bits));
        match &self.weights {
            Weights::Binary => neighbors.for_each(|j| give(j, 1.0)),
            Weights::Kept { starts, entries } => {
                neighbors.zip(&entries[starts[i]..]).for_each(|(j, &weight)| give(j, weight));
            }
            Weights::Computed(gauss) => {
                gauss.fill(i, row, scratch)?;
                neighbors.zip(&scratch.weights).for_each(|(j, &weight)| give(j, weight));
            }
        }
        Ok(())
    }

    /// The terms of some rows of a non-negative vector.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn terms(&self, u: &[f64], rows: &[usize], execution: &Execution) -> Result<Vec<Terms>> {
        let total: f64 = u.iter().sum();
        let mut blocks = memory::filled([0.0; WORD], u.len().div_ceil(WORD))?;
        let mut support = memory::filled(0_u64, blocks.len())?;
        for ((block, bits), entries) in blocks.iter_mut().zip(&mut support).zip(u.chunks(WORD)) {
            block[..entries.len()].copy_from_slice(entries);
            *bits =
                entries.iter().enumerate().fold(0, |bits, (k, &entry)| bits | u64::from(entry > 0.0) << k);
        }
        let terms = rows.par_iter().with_min_len(32).map_init(Scratch::default, |scratch, &i| {
            execution.check()?;
            let row = self.graph.row(i);
            let [affinity, agreement] = match &self.weights {
                Weights::Binary => simd::run(
                    #[inline(always)]
                    || [plain_sum(row, &support, &blocks); 2],
                ),
                Weights::Kept { starts, entries } => sums(row, &entries[starts[i]..], &support, &blocks),
                Weights::Computed(gauss) => {
                    gauss.fill(i, row, scratch)?;
                    sums(row, &scratch.weights, &support, &blocks)
                }
            };
            Ok([affinity + u[i], total - agreement - u[i]])
        });
        memory::par_try_collect(terms)
    }
}

/// Weighted and plain sum of the entries whose bits are set in a row.
fn sums(row: &[u64], weights: &[f32], support: &[u64], blocks: &[[f64; WORD]]) -> [f64; 2] {
    simd::run(
        #[inline(always)]
        || {
            let mut weighted = [0.0; SUMS];
            let mut plain = [0.0; SUMS];
            let mut weights = weights;
            for ((&word, &support), block) in row.iter().zip(support).zip(blocks) {
                let mut bits = word;
                let (here, rest) = weights.split_at((word.count_ones() as usize).min(weights.len()));
                weights = rest;
                if word & support == 0 {
                    continue;
                }
                let mut groups = here.chunks_exact(SUMS);
                for group in &mut groups {
                    for k in 0..SUMS {
                        let value = block[bits.trailing_zeros() as usize % WORD];
                        bits &= bits.wrapping_sub(1);
                        weighted[k] += f64::from(group[k]) * value;
                        plain[k] += value;
                    }
                }
                for (k, &weight) in groups.remainder().iter().enumerate() {
                    let value = block[bits.trailing_zeros() as usize % WORD];
                    bits &= bits.wrapping_sub(1);
                    weighted[k] += f64::from(weight) * value;
                    plain[k] += value;
                }
            }
            [weighted, plain].map(
                #[inline(always)]
                |parts: [f64; SUMS]| (parts[0] + parts[1]) + (parts[2] + parts[3]),
            )
        },
    )
}

/// Sum of the entries whose bits are set in a row.
#[inline(always)]
fn plain_sum(row: &[u64], support: &[u64], blocks: &[[f64; WORD]]) -> f64 {
    let mut parts = [0.0; SUMS];
    for ((&word, &support), block) in row.iter().zip(support).zip(blocks) {
        let mut bits = word & support;
        let mut k = 0;
        while bits != 0 {
            parts[k % SUMS] += block[bits.trailing_zeros() as usize % WORD];
            bits &= bits.wrapping_sub(1);
            k += 1;
        }
    }
    (parts[0] + parts[1]) + (parts[2] + parts[3])
}

/// Working space for the weights of a row: squared lengths on both sides.
#[derive(Debug, Default)]
pub struct Scratch {
    squares: [Vec<f64>; 2],
    weights: Vec<f32>,
}

impl Gauss<'_> {
    /// Computes the weights of a row's neighbours, rounded to f32, so that stored ones take half the memory.
    fn fill(&self, i: usize, row: &[u64], scratch: &mut Scratch) -> Result<()> {
        let degree = row.iter().map(|word| word.count_ones() as usize).sum();
        let [source, target] = &mut scratch.squares;
        memory::resize(source, degree, 0.0)?;
        memory::resize(target, degree, 0.0)?;
        let (from, to) = (self.source.get(i), self.target.get(i));
        let mut squares = source.iter_mut().zip(target);
        for (word, &bits) in row.iter().enumerate() {
            for (j, (source, target)) in ones(word, bits).zip(&mut squares) {
                *source = (self.source.get(j as usize) - from).norm_squared();
                *target = (self.target.get(j as usize) - to).norm_squared();
            }
        }
        scratch.weights.clear();
        memory::resize(&mut scratch.weights, degree, 0.0)?;
        let [source, target] = &scratch.squares;
        simd::run(FillWeights { source, target, factor: self.factor, weights: &mut scratch.weights });
        Ok(())
    }
}

struct FillWeights<'a> {
    source: &'a [f64],
    target: &'a [f64],
    factor: f64,
    weights: &'a mut [f32],
}

impl Kernel for FillWeights<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        for ((weight, source), target) in self.weights.iter_mut().zip(self.source).zip(self.target) {
            let delta = source.sqrt() - target.sqrt();
            *weight = exp_of_negative(lanes, self.factor * delta * delta) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(n: usize, k: f64) -> Result<Points> {
        let place = |i: usize| [(i as f64 * k).sin(), (i as f64 * 1.7 * k).cos(), (i as f64).cos()];
        Points::from_rows("points", &(0..n).map(place).collect::<Vec<_>>())
    }

    #[test]
    fn products_are_those_of_the_dense_matrices() -> Result<()> {
        for n in [0, 1, 64, 65, 200] {
            let (source, target) = (points(n, 0.37)?, points(n, 0.4)?);
            let execution = Execution::default();
            let graph = AgreementGraph::new(&source, &target, 0.3, 0.1, &execution)?;
            let u: Vec<f64> = (0..n).map(|i| (i as f64 * 2.3).sin().max(0.0)).collect();
            let entry = |i: usize, j: usize| {
                let delta = source.distance(i, j) - target.distance(i, j);
                if i == j {
                    1.0
                } else {
                    f64::from(u8::from(graph.joined(i, j))) * (-delta * delta / 0.02).exp()
                }
            };
            let weighted = Affinity::weighted(&graph, &source, &target, 0.1, &execution)?;
            let rows: Vec<usize> = (0..n).rev().collect();
            let terms = weighted.terms(&u, &rows, &execution)?;
            let binary = Affinity::binary(&graph).terms(&u, &rows, &execution)?;
            for (&i, (weighted, binary)) in rows.iter().zip(terms.iter().zip(&binary)) {
                let sum: f64 = (0..n).map(|j| entry(i, j) * u[j]).sum();
                assert!((weighted[0] - sum).abs() < 1e-5, "{n} {i}");
                let excluded: f64 = (0..n).filter(|&j| j != i && !graph.joined(i, j)).map(|j| u[j]).sum();
                assert!((weighted[1] - excluded).abs() < 1e-12 && (binary[1] - excluded).abs() < 1e-12);
            }
            let little = Execution::new(graph.bytes());
            let computed = Affinity::weighted(&graph, &source, &target, 0.1, &little)?;
            assert_eq!(computed.terms(&u, &rows, &execution)?, terms);
        }
        Ok(())
    }
}
