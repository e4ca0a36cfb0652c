//! The heaviest maximal clique of each vertex, by the search for all of them.
//!
//! Bron and Kerbosch's search (CACM 1973) with pivots (Tomita et al., 2006) from each vertex in degeneracy order (Eppstein
//! et al., 2010): cliques of the vertex and of later ones that no earlier one would extend. The search from a vertex
//! knows nothing of the others, and so the result is the same on any number of threads, also where it is cut short.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashSet};
use std::sync::Arc;

use rayon::prelude::*;

use super::graph::{SECOND_ORDER_BITS, SecondOrderGraph};
use super::neighborhood::{NOWHERE, Neighborhood, Scratch, neighbors};
use super::walk::{Walk, Walked};
use crate::error::Result;
use crate::execution::Execution;

/// What is searched for, and for how long.
#[derive(Debug, Clone, Copy)]
pub struct Search {
    /// Least members of a clique.
    pub min_size: usize,
    /// Ends of the search, maximal cliques or dead ends.
    pub max_ends: usize,
}

/// A maximal clique.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Clique {
    /// Sum of the weights of its pairs.
    pub weight: u64,
    /// Ascending.
    pub members: Vec<u32>,
}

impl Clique {
    /// The heavier one first; of equals the one whose members come first.
    pub fn rank(&self) -> (Reverse<u64>, &[u32]) {
        (Reverse(self.weight), &self.members)
    }
}

/// Of each vertex the heaviest clique that was found with it.
#[derive(Debug)]
pub struct Heaviest {
    of_vertices: Vec<Option<Arc<Clique>>>,
    /// Number of cliques found.
    pub cliques: usize,
    /// Whether there may be others.
    pub cut_short: bool,
}

impl Heaviest {
    /// Cliques that are some vertex's heaviest, each once, the heaviest first, and no more than `most`.
    pub fn distinct(&self, most: usize) -> Vec<&Clique> {
        let once: HashSet<&Clique> = self.of_vertices.iter().flatten().map(Arc::as_ref).collect();
        let mut cliques: Vec<&Clique> = once.into_iter().collect();
        cliques.sort_unstable_by(|a, b| a.rank().cmp(&b.rank()));
        cliques.truncate(most);
        cliques
    }

    /// Of each vertex the weight of its heaviest clique, 0 where it is in none.
    pub fn weights(&self) -> impl Iterator<Item = f64> + '_ {
        let unit = f64::from(1_u32 << SECOND_ORDER_BITS);
        self.of_vertices
            .iter()
            .map(move |clique| clique.as_ref().map_or(0.0, |clique| clique.weight as f64 / unit))
    }

    fn keep(&mut self, vertex: u32, clique: Arc<Clique>) {
        let kept = &mut self.of_vertices[vertex as usize];
        if kept.as_ref().is_none_or(|other| clique.rank() < other.rank()) {
            *kept = Some(clique);
        }
    }
}

/// Vertices that are searched from before what they found is put together.
const BLOCK: usize = 256;

/// The rank of a vertex that is not taken away yet.
const LEFT: u32 = NOWHERE - 1;

/// Shares of the ends that each search gets: the first the same for all, the second of what is left.
const ROUNDS: usize = 2;

impl Search {
    /// Of each vertex the heaviest of the maximal cliques among `vertices`, which ascend.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`].
    pub fn heaviest_cliques(
        &self,
        graph: &SecondOrderGraph,
        vertices: &[u32],
        execution: &Execution,
    ) -> Result<Heaviest> {
        let ranks = degeneracy_ranks(graph, vertices);
        let ranks = &ranks;
        let later =
            |i: u32| neighbors(graph, ranks, i).filter(move |&(j, _)| ranks[j as usize] > ranks[i as usize]);
        let starts = vertices.iter().copied().filter(|&i| later(i).count() + 1 >= self.min_size);
        let mut left: Vec<u32> = starts.collect();
        let mut found = Heaviest { of_vertices: vec![None; graph.len()], cliques: 0, cut_short: false };
        let (mut ends, mut share, mut of_unfinished) = (self.max_ends, 0, 0);
        for _ in 0..ROUNDS {
            let larger = (ends / left.len().max(1)).max(1);
            if left.is_empty() || larger <= share || execution.is_stopped() {
                break;
            }
            share = larger;
            let mut unfinished = Vec::new();
            execution.report(0, left.len())?;
            for block in left.chunks(BLOCK) {
                let search = |hood: &mut Scratch, &start: &u32| {
                    execution.advance()?;
                    Walk::new(Neighborhood::new(graph, ranks, start, hood), self.min_size, share, execution)
                        .run()
                };
                let walks: Vec<Walked> =
                    block.par_iter().map_init(Scratch::default, search).collect::<Result<_>>()?;
                for (&start, walked) in block.iter().zip(walks) {
                    if walked.finished {
                        ends = ends.saturating_sub(walked.ends);
                        found.cliques += walked.cliques;
                    } else {
                        unfinished.push((start, walked.cliques));
                    }
                    walked.heaviest.into_iter().for_each(|(i, clique)| found.keep(i, clique));
                }
            }
            let (starts, cliques): (Vec<u32>, Vec<usize>) = unfinished.into_iter().unzip();
            (left, of_unfinished) = (starts, cliques.iter().sum());
        }
        found.cliques += of_unfinished;
        found.cut_short = !left.is_empty();
        Ok(found)
    }
}

/// The place of each vertex in the order that takes away, again and again, the one with the fewest neighbours left, ties
/// to the lowest index; `NOWHERE` for others than `vertices`.
fn degeneracy_ranks(graph: &SecondOrderGraph, vertices: &[u32]) -> Vec<u32> {
    let mut ranks = vec![NOWHERE; graph.len()];
    vertices.iter().for_each(|&i| ranks[i as usize] = LEFT);
    let mut degrees = vec![0; graph.len()];
    vertices.iter().for_each(|&i| degrees[i as usize] = neighbors(graph, &ranks, i).count());
    let mut queue: BinaryHeap<_> = vertices.iter().map(|&i| Reverse((degrees[i as usize], i))).collect();
    let mut next = 0;
    while let Some(Reverse((degree, i))) = queue.pop() {
        if ranks[i as usize] != LEFT || degree != degrees[i as usize] {
            continue; // taken already, or it stands in the queue with the degree of now as well
        }
        ranks[i as usize] = next;
        next += 1;
        for (j, _) in neighbors(graph, &ranks, i).filter(|&(j, _)| ranks[j as usize] == LEFT) {
            degrees[j as usize] -= 1;
            queue.push(Reverse((degrees[j as usize], j)));
        }
    }
    ranks
}
