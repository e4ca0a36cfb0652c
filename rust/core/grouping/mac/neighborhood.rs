//! The neighbours of one vertex as a small graph of bit rows, for the search from that vertex.

use super::graph::SecondOrderGraph;
use crate::error::Result;
use crate::memory;

/// Rank of a vertex that is not searched.
pub const NOWHERE: u32 = u32::MAX;

/// Vertices per word.
const WORD: usize = u64::BITS as usize;

/// Working space: the index of each vertex in the small graph.
pub type Scratch = Vec<u32>;

/// The searched neighbours of a vertex, with their weights.
pub fn neighbors<'a>(
    graph: &'a SecondOrderGraph,
    ranks: &'a [u32],
    vertex: u32,
) -> impl Iterator<Item = (u32, u32)> + 'a {
    let (neighbors, weights) = graph.row(vertex as usize);
    let all = neighbors.iter().copied().zip(weights.iter().copied());
    all.filter(|&(j, weight)| weight > 0 && ranks[j as usize] != NOWHERE)
}

/// The small graph. The neighbours of higher rank (later ones) are the candidates; those of lower rank
/// (earlier ones) only decide whether a clique is maximal. Both are ascending.
#[derive(Debug)]
pub struct Neighborhood {
    /// The vertex itself.
    pub center: u32,
    /// Neighbours of higher rank, by their indices in the large graph.
    pub later: Vec<u32>,
    /// Number of neighbours of lower rank.
    pub earlier: usize,
    /// A row of bits for each later neighbour, then for each earlier one: the later ones connected to it.
    joined: Vec<u64>,
    /// A row of bits for each later neighbour: the earlier ones connected to it.
    joined_earlier: Vec<u64>,
    /// Weights between the vertex and each later neighbour.
    to_center: Vec<u32>,
    /// Weights between later neighbours, by rows.
    weights: Vec<u32>,
}

impl Neighborhood {
    /// The small graph of a vertex.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(graph: &SecondOrderGraph, ranks: &[u32], center: u32, numbers: &mut Scratch) -> Result<Self> {
        memory::resize(numbers, graph.len(), NOWHERE)?;
        let rank = ranks[center as usize];
        let of_rank = |later: bool| {
            neighbors(graph, ranks, center).filter(move |&(j, _)| (ranks[j as usize] > rank) == later)
        };
        let later = memory::collect(of_rank(true).map(|(j, _)| j))?;
        let to_center = memory::collect(of_rank(true).map(|(_, weight)| weight))?;
        let earlier = memory::collect(of_rank(false).map(|(j, _)| j))?;
        let all = || later.iter().chain(&earlier);
        all().zip(0..).for_each(|(&j, number)| numbers[j as usize] = number);
        let mut hood = Self {
            center,
            earlier: earlier.len(),
            joined: memory::filled(0, all().count() * later.len().div_ceil(WORD))?,
            joined_earlier: memory::filled(0, later.len() * earlier.len().div_ceil(WORD))?,
            weights: memory::filled(0, later.len() * later.len())?,
            to_center,
            later: Vec::new(),
        };
        for (a, &i) in later.iter().enumerate() {
            let (around, weights) = graph.row(i as usize);
            let around = around.iter().zip(weights).map(|(&j, &weight)| (numbers[j as usize], weight));
            around
                .filter(|&(b, weight)| b != NOWHERE && weight > 0)
                .for_each(|(b, weight)| hood.join(a, b as usize, weight, later.len()));
        }
        all().for_each(|&j| numbers[j as usize] = NOWHERE);
        Ok(Self { later, ..hood })
    }

    /// Connects a later neighbour to another neighbour; the first `later` neighbours are later ones.
    fn join(&mut self, a: usize, b: usize, weight: u32, later: usize) {
        let words = later.div_ceil(WORD);
        if b < later {
            self.joined[a * words + b / WORD] |= 1 << (b % WORD);
            self.weights[a * later + b] = weight;
        } else {
            let b = b - later;
            let earlier_words = self.earlier.div_ceil(WORD);
            self.joined_earlier[a * earlier_words + b / WORD] |= 1 << (b % WORD);
            self.joined[(later + b) * words + a / WORD] |= 1 << (a % WORD);
        }
    }

    /// The later neighbours connected to a neighbour.
    #[inline]
    pub fn joined(&self, a: usize) -> &[u64] {
        let words = self.later.len().div_ceil(WORD);
        &self.joined[a * words..(a + 1) * words]
    }

    /// The earlier neighbours connected to a later one.
    #[inline]
    pub fn joined_earlier(&self, a: usize) -> &[u64] {
        let words = self.earlier.div_ceil(WORD);
        &self.joined_earlier[a * words..(a + 1) * words]
    }

    /// Increase of the weight of the clique of the vertex and `members` by another later neighbour.
    pub fn gain(&self, a: usize, members: &[usize]) -> u64 {
        let row = &self.weights[a * self.later.len()..(a + 1) * self.later.len()];
        u64::from(self.to_center[a]) + members.iter().map(|&b| u64::from(row[b])).sum::<u64>()
    }
}
