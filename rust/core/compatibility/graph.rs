//! The graph of correspondences that agree in distance, one bit per pair.
//!
//! Two correspondences are connected if `|ds - dt| < tolerance`, Eq. (13) of the paper, and their edges are
//! long enough: points close together keep their distance under any motion. The neighbours of a
//! correspondence are a row of bits; common neighbours are counted 64 at a time. Memory `n^2 / 8` bytes.

use std::cmp::{Ordering, Reverse};
use std::sync::atomic::{self, AtomicU32};

use rayon::prelude::*;

use super::agreement::DistanceAgreement;
use super::long_agreement::LongAgreement;

pub use super::long_agreement::EdgeLengths;

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::memory;
use crate::points::Points;
use crate::simd;

/// Correspondences per word.
const WORD: usize = u64::BITS as usize;

/// Words whose rows are compared with one row at a time: their rows stay in the second-level cache.
const BAND_WORDS: usize = 4;

/// A task collects this multiple of the requested pairs before it drops all but the best.
const SPARE: usize = 4;

/// Two agreeing correspondences, and the number of others that agree with both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Edge {
    /// Number of common neighbours.
    pub common: u32,
    /// The lower index.
    pub i: u32,
    /// The higher index.
    pub j: u32,
}

impl Edge {
    /// Sort key: most common neighbours first, then by index.
    fn rank(&self) -> (Reverse<u32>, u32, u32) {
        (Reverse(self.common), self.i, self.j)
    }
}

/// The graph.
#[derive(Debug)]
pub struct AgreementGraph {
    len: usize,
    words: usize,
    bits: Vec<u64>,
}

impl AgreementGraph {
    /// Connects the pairs of matched points whose lengths differ by less than `tolerance` and exceed
    /// `shortest`.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if the graph needs more than `execution.max_memory` bytes;
    /// [`Error::Interrupted`],
    /// [`Error::OutOfMemory`].
    pub fn new(
        source: &Points,
        target: &Points,
        tolerance: f64,
        shortest: f64,
        execution: &Execution,
    ) -> Result<Self> {
        Self::with_edges(source, target, tolerance, EdgeLengths::EachAbove(shortest), execution)
    }

    /// Connects the pairs of matched points whose lengths differ by less than `tolerance` and satisfy
    /// `lengths`.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_edges(
        source: &Points,
        target: &Points,
        tolerance: f64,
        lengths: EdgeLengths,
        execution: &Execution,
    ) -> Result<Self> {
        let len = source.len();
        let words = len.div_ceil(WORD);
        let bytes = 8 * len * words;
        if bytes > execution.max_memory {
            let remedy = format!(
                "the graph of {len} correspondences takes {bytes} bytes; allow that many, or give fewer correspondences"
            );
            return Err(Error::invalid("max_memory", execution.max_memory, remedy));
        }
        let agreement = LongAgreement::new(DistanceAgreement::new(source, target, tolerance)?, lengths);
        let mut bits = memory::filled(0, len * words)?;
        let rows = bits.par_chunks_mut(words.max(1)).enumerate().with_min_len(8);
        rows.try_for_each_init(
            || memory::filled(0, words),
            |unsure, (i, row)| {
                agreement.fill_row(i, row, memory::ready(unsure)?);
                execution.check()
            },
        )?;
        Ok(Self { len, words, bits })
    }

    /// Most correspondences whose graph needs at most `max_memory` bytes.
    pub fn most_vertices(max_memory: usize) -> usize {
        let words = ((max_memory / (8 * WORD)) as f64).sqrt() as usize; // rows are whole words
        let full = words * WORD;
        full + (max_memory / 8 / (words + 1)).saturating_sub(full).min(WORD)
    }

    /// The induced subgraph of some vertices: the k-th of them is vertex k of the result.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if both graphs need more than `execution.max_memory` bytes;
    /// [`Error::Interrupted`],
    /// [`Error::OutOfMemory`].
    pub fn induced(&self, vertices: &[u32], execution: &Execution) -> Result<Self> {
        let (len, words) = (vertices.len(), vertices.len().div_ceil(WORD));
        let bytes = 8 * (self.bits.len() + len * words);
        if bytes > execution.max_memory {
            let remedy = format!(
                "the graph of {} correspondences and that of {len} of them take {bytes} bytes; allow that many, \
                 or give fewer correspondences",
                self.len
            );
            return Err(Error::invalid("max_memory", execution.max_memory, remedy));
        }
        let mut places = memory::filled(0, self.len)?;
        let mut kept = memory::filled(0_u64, self.words)?;
        for (place, &vertex) in (0_u32..).zip(vertices) {
            places[vertex as usize] = place;
            kept[vertex as usize / WORD] |= 1 << (vertex as usize % WORD);
        }
        let mut bits = memory::filled(0, len * words)?;
        let rows = bits.par_chunks_mut(words.max(1)).zip(vertices).with_min_len(8);
        rows.try_for_each(|(row, &vertex)| {
            let joined = self.row(vertex as usize).iter().zip(&kept).map(|(a, b)| a & b).enumerate();
            for neighbor in joined.flat_map(|(word, bits)| ones(word, bits)) {
                let place = places[neighbor as usize] as usize;
                row[place / WORD] |= 1 << (place % WORD);
            }
            execution.check()
        })?;
        Ok(Self { len, words, bits })
    }

    /// Number of correspondences.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Memory of the bits.
    pub fn bytes(&self) -> usize {
        size_of_val(self.bits.as_slice())
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The neighbours of a correspondence, one bit each.
    pub fn row(&self, i: usize) -> &[u64] {
        &self.bits[i * self.words..(i + 1) * self.words]
    }

    /// Number of neighbours of a correspondence.
    pub fn degree(&self, i: usize) -> u32 {
        count(self.row(i))
    }

    /// The neighbours of a correspondence, ascending.
    pub fn neighbors(&self, i: usize) -> impl Iterator<Item = usize> {
        indices(self.row(i)).map(|j| j as usize)
    }

    /// Whether two correspondences are connected.
    #[inline]
    pub fn joined(&self, i: usize, j: usize) -> bool {
        self.row(i)[j / WORD] >> (j % WORD) & 1 == 1
    }

    /// Common neighbours of two correspondences, ascending; at most `most`, of the lowest indices.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn common_neighbors(&self, i: usize, j: usize, most: usize) -> Result<Vec<u32>> {
        let words = self.row(i).iter().zip(self.row(j)).map(|(a, b)| a & b).enumerate();
        memory::collect(words.flat_map(|(word, bits)| ones(word, bits)).take(most))
    }

    /// Calls `give` with each vertex of `others`, a row of bits, and its number of common neighbours with
    /// `i`; ascending.
    pub fn count_common_with(&self, i: usize, others: &[u64], mut give: impl FnMut(u32, u32)) {
        let own = self.row(i);
        simd::run(
            #[inline(always)]
            || {
                for (word, &bits) in others.iter().enumerate() {
                    let mut left = bits;
                    while left != 0 {
                        let j = (word * WORD) as u32 + left.trailing_zeros();
                        left &= left - 1;
                        let mut sum = 0;
                        for (a, b) in own.iter().zip(self.row(j as usize)) {
                            sum += (a & b).count_ones();
                        }
                        give(j, sum);
                    }
                }
            },
        );
    }

    /// The `most` pairs with the most common neighbours, one at least; ties to the lowest indices.
    ///
    /// # Errors
    /// [`Error::Interrupted`], [`Error::OutOfMemory`].
    pub fn heaviest_edges(&self, most: usize, execution: &Execution) -> Result<Vec<Edge>> {
        let degrees = memory::collect((0..self.len).map(|i| count(self.row(i))))?;
        let floor = AtomicU32::new(1);
        let bands = self.words.div_ceil(BAND_WORDS);
        let of_band = |band| self.heaviest_of_band(band, most, &degrees, &floor, execution);
        let found = memory::par_try_collect((0..bands).into_par_iter().map(of_band))?;
        let mut edges = memory::concat(&found)?;
        keep_heaviest(&mut edges, most);
        edges.sort_unstable_by_key(Edge::rank);
        Ok(edges)
    }

    /// As [`Self::heaviest_edges`] among the pairs whose lower index is in a band. `floor` is a number of
    /// common neighbours that `most` pairs reach, in any band.
    fn heaviest_of_band(
        &self,
        band: usize,
        most: usize,
        degrees: &[u32],
        floor: &AtomicU32,
        execution: &Execution,
    ) -> Result<Vec<Edge>> {
        let words = band * BAND_WORDS..((band + 1) * BAND_WORDS).min(self.words);
        let mut edges = Vec::new();
        for j in words.start * WORD..self.len {
            let row = self.row(j);
            for word in words.clone() {
                for i in ones(word, row[word] & below(word, j)) {
                    let least = floor.load(atomic::Ordering::Relaxed);
                    if degrees[i as usize].min(degrees[j]) < least {
                        continue;
                    }
                    let common = count_common(row, self.row(i as usize));
                    if common >= least {
                        memory::push(&mut edges, Edge { common, i, j: j as u32 })?;
                    }
                }
            }
            if edges.len() >= SPARE.saturating_mul(most) {
                keep_heaviest(&mut edges, most);
                let least = edges.iter().map(|edge| edge.common).min().unwrap_or_default();
                floor.fetch_max(least, atomic::Ordering::Relaxed);
                execution.check()?;
            }
        }
        execution.check()?;
        keep_heaviest(&mut edges, most);
        Ok(edges)
    }
}

fn keep_heaviest(edges: &mut Vec<Edge>, most: usize) {
    if edges.len() > most {
        edges.select_nth_unstable_by_key(most, Edge::rank);
        edges.truncate(most);
    }
}

/// Mask of a word's bits with indices lower than `j`.
fn below(word: usize, j: usize) -> u64 {
    match (j / WORD).cmp(&word) {
        Ordering::Greater => u64::MAX,
        Ordering::Equal => (1 << (j % WORD)) - 1,
        Ordering::Less => 0,
    }
}

/// The indices of the bits set in a row, ascending.
pub fn indices(row: &[u64]) -> impl Iterator<Item = u32> + '_ {
    row.iter().enumerate().flat_map(|(word, &bits)| ones(word, bits))
}

/// The indices of the bits set in a word of a row.
pub(crate) fn ones(word: usize, mut bits: u64) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        let bit = bits.trailing_zeros();
        bits &= bits.wrapping_sub(1);
        (bit < u64::BITS).then_some((word * WORD) as u32 + bit)
    })
}

fn count(row: &[u64]) -> u32 {
    row.iter().map(|word| word.count_ones()).sum()
}

/// Number of bits that are set in both rows.
pub fn count_common(a: &[u64], b: &[u64]) -> u32 {
    simd::run(
        #[inline(always)]
        || {
            let mut sum = 0;
            for (a, b) in a.iter().zip(b) {
                sum += (a & b).count_ones();
            }
            sum
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn graph(n: usize) -> Result<AgreementGraph> {
        let place = |i: usize, k: f64| [(i as f64 * k).sin(), (i as f64 * 1.7 * k).cos(), (i as f64).cos()];
        let rows = |k: f64| (0..n).map(|i| place(i, k)).collect::<Vec<_>>();
        let (source, target) =
            (Points::from_rows("source", &rows(0.37))?, Points::from_rows("target", &rows(0.4))?);
        AgreementGraph::new(&source, &target, 0.1, 0.2, &Execution::default())
    }

    #[test]
    fn heaviest_edges_are_those_of_a_plain_count() -> Result<()> {
        for n in [0, 1, 2, 63, 64, 65, 300, 700] {
            let graph = graph(n)?;
            let mut all = Vec::new();
            for j in 0..n {
                for i in (0..j).filter(|&i| graph.joined(i, j)) {
                    let common = (0..n).filter(|&k| graph.joined(i, k) && graph.joined(j, k)).count() as u32;
                    all.push(Edge { common, i: i as u32, j: j as u32 });
                }
            }
            all.retain(|edge| edge.common > 0);
            all.sort_by_key(Edge::rank);
            for most in [1, 10, 1000] {
                let found = graph.heaviest_edges(most, &Execution::default())?;
                assert_eq!(found, all[..most.min(all.len())], "{n} {most}");
            }
        }
        Ok(())
    }

    #[test]
    fn rows_are_symmetric_without_a_diagonal() -> Result<()> {
        let graph = graph(200)?;
        assert!((0..200).any(|i| graph.joined(0, i)));
        for (i, j) in (0..200).flat_map(|i| (0..=i).map(move |j| (i, j))) {
            assert_eq!(graph.joined(i, j), graph.joined(j, i));
            assert!(i != j || !graph.joined(i, j));
        }
        Ok(())
    }

    #[test]
    fn common_neighbors_are_counted_for_the_given_vertices() -> Result<()> {
        let graph = graph(300)?;
        let mut counted = Vec::new();
        graph.count_common_with(3, graph.row(7), |j, common| counted.push((j, common)));
        let expected: Vec<(u32, u32)> = (0..300)
            .filter(|&j| graph.joined(7, j))
            .map(|j| (j as u32, graph.common_neighbors(3, j, 300).map_or(0, |common| common.len()) as u32))
            .collect();
        assert!(!expected.is_empty() && counted == expected);
        Ok(())
    }

    #[test]
    fn common_neighbors_are_ascending_and_limited() -> Result<()> {
        let graph = graph(300)?;
        let both = |i: usize| graph.joined(3, i) && graph.joined(7, i);
        let expected: Vec<u32> = (0..300).filter(|&i| both(i)).map(|i| i as u32).collect();
        assert!(expected.len() > 4);
        assert_eq!(graph.common_neighbors(3, 7, 300)?, expected);
        assert_eq!(graph.common_neighbors(3, 7, 4)?, expected[..4]);
        Ok(())
    }

    #[test]
    fn the_most_vertices_just_fit() {
        for max_memory in (0..5_000).chain([1 << 20, 1 << 30, (1 << 30) + 12_345]) {
            let most = AgreementGraph::most_vertices(max_memory);
            let bytes = |len: usize| 8 * len * len.div_ceil(WORD);
            assert!(bytes(most) <= max_memory && bytes(most + 1) > max_memory, "{max_memory} {most}");
        }
    }

    #[test]
    fn an_induced_graph_connects_the_same_vertices() -> Result<()> {
        let graph = graph(150)?;
        let vertices: Vec<u32> = (0..150).rev().filter(|i| i % 7 != 3).collect();
        let induced = graph.induced(&vertices, &Execution::default())?;
        assert_eq!(induced.len(), vertices.len());
        for (i, &a) in vertices.iter().enumerate() {
            for (j, &b) in vertices.iter().enumerate() {
                assert_eq!(induced.joined(i, j), graph.joined(a as usize, b as usize));
            }
        }
        Ok(())
    }

    #[test]
    fn a_graph_that_does_not_fit_is_refused() -> Result<()> {
        let points = Points::from_rows("points", &[[0.0; 3]; 65])?;
        let refused = AgreementGraph::new(&points, &points, 1.0, 2.0, &Execution::new(65 * 16 - 1));
        let text = refused.err().map(|error| error.to_string()).unwrap_or_default();
        assert!(text.contains("max_memory") && text.contains("1040 bytes"), "{text}");
        Ok(())
    }
}
