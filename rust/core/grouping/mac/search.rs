//! The heaviest maximal clique of each vertex, by the search for all of them.
//!
//! Bron and Kerbosch's search (CACM 1973) with pivots (Tomita et al., 2006) from each vertex: the cliques of
//! it and of vertices later in an order that no earlier one extends (Eppstein et al., 2010). The order is
//! that of degrees: no vertex of E pairs has more than sqrt(2 E) later neighbours, and it is cheaper than
//! degeneracy order. The searches from the vertices are independent, so the result is the same on any number
//! of threads, even if a search is cut short.

use std::sync::Arc;

use rayon::prelude::*;

use super::graph::{SECOND_ORDER_BITS, SecondOrderGraph};
use super::neighborhood::{NOWHERE, Neighborhood, Scratch, neighbors};
use super::walk::{Clique, Walk, Walked};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;

/// Limits of the search.
#[derive(Debug, Clone, Copy)]
pub struct Search {
    /// Least number of members of a clique.
    pub min_size: usize,
    /// Most results of the search, maximal cliques or dead ends.
    pub max_ends: usize,
}

/// The heaviest clique found with each vertex.
#[derive(Debug)]
pub struct Heaviest {
    of_vertices: Vec<Option<Arc<Clique>>>,
    /// Number of cliques found.
    pub cliques: usize,
    /// Whether the search may have missed cliques.
    pub cut_short: bool,
}

impl Heaviest {
    /// The distinct heaviest cliques of the vertices, the heaviest first, at most `most`.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn distinct(&self, most: usize) -> Result<Vec<&Clique>> {
        let mut seen = memory::set(self.of_vertices.len())?;
        let all = self.of_vertices.iter().flatten().map(Arc::as_ref);
        let mut cliques = memory::collect(all.filter(|&clique| seen.insert(clique)))?;
        cliques.sort_unstable_by(|a, b| a.rank().cmp(&b.rank()));
        cliques.truncate(most);
        Ok(cliques)
    }

    /// Weight of each vertex' heaviest clique, 0 if it is in none.
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

/// Start vertices that share an equal part of the results. Vertices of low degree, which come first, leave
/// most of theirs.
const BLOCK: usize = 32;

impl Search {
    /// The heaviest maximal clique of each vertex among `vertices`, which are ascending.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn heaviest_cliques(
        &self,
        graph: &SecondOrderGraph,
        vertices: &[u32],
        execution: &Execution,
    ) -> Result<Heaviest> {
        let ranks = ranks_by_degree(graph, vertices)?;
        let ranks = &ranks;
        let later =
            |i: u32| neighbors(graph, ranks, i).filter(move |&(j, _)| ranks[j as usize] > ranks[i as usize]);
        let starts = vertices.iter().copied().filter(|&i| later(i).count() + 1 >= self.min_size);
        let mut starts = memory::collect(starts)?;
        starts.sort_unstable_by_key(|&i| ranks[i as usize]);
        let of_vertices = memory::filled(None, graph.len())?;
        let mut found = Heaviest { of_vertices, cliques: 0, cut_short: false };
        let (mut ends, mut left) = (self.max_ends, starts.len());
        execution.report(0, left)?;
        for block in starts.chunks(BLOCK) {
            let share = (ends / left).max(1);
            let search = |hood: &mut Scratch, &start: &u32| {
                execution.advance()?;
                let hood = Neighborhood::new(graph, ranks, start, hood)?;
                Walk::new(hood, self.min_size, share, execution)?.run()
            };
            let walks: Vec<Walked> =
                memory::par_try_collect(block.par_iter().map_init(Scratch::default, search))?;
            for walked in walks {
                ends = ends.saturating_sub(walked.ends);
                found.cliques += walked.cliques;
                found.cut_short |= !walked.finished;
                walked.heaviest.into_iter().for_each(|(i, clique)| found.keep(i, clique));
            }
            left -= block.len();
        }
        Ok(found)
    }
}

/// The rank of each of the vertices by degree, ties to the lowest index; `NOWHERE` for others.
fn ranks_by_degree(graph: &SecondOrderGraph, vertices: &[u32]) -> Result<Vec<u32>> {
    let mut ranks = memory::filled(NOWHERE, graph.len())?;
    vertices.iter().for_each(|&i| ranks[i as usize] = 0);
    let mut order = memory::collect(vertices.iter().map(|&i| (neighbors(graph, &ranks, i).count(), i)))?;
    order.sort_unstable();
    order.into_iter().zip(0..).for_each(|((_, i), rank)| ranks[i as usize] = rank);
    Ok(ranks)
}

#[cfg(test)]
mod tests {
    use std::cmp::Reverse;

    use super::*;
    use crate::grouping::mac::graph::Kernel;
    use crate::points::Points;

    /// A third of the points follow one motion, a third another, the rest move randomly.
    fn graph(n: usize) -> Result<SecondOrderGraph> {
        let place = |i: usize, k: f64| [1.1, 2.3, 3.7].map(|f| 3.0 * (i as f64 * f * k + k).sin());
        let source: Vec<[f64; 3]> = (0..n).map(|i| place(i, 1.0)).collect();
        let moved = |(i, p): (usize, &[f64; 3])| match i % 3 {
            0 => [p[1] + 0.1 * place(i, 0.9)[0], p[2], p[0]],
            1 => [9.0 - p[1], p[0], p[2] + 0.1 * place(i, 0.9)[0]],
            _ => place(i, 0.7),
        };
        let target: Vec<_> = source.iter().enumerate().map(moved).collect();
        let (source, target) = (Points::from_rows("source", &source)?, Points::from_rows("target", &target)?);
        let kernel = Kernel { bound: 0.2, min_weight: 0.9 };
        SecondOrderGraph::new(&source, &target, kernel, &Execution::default())
    }

    fn search(graph: &SecondOrderGraph, max_ends: usize, execution: &Execution) -> Result<Heaviest> {
        let vertices: Vec<u32> = (0..graph.len() as u32).collect();
        Search { min_size: 3, max_ends }.heaviest_cliques(graph, &vertices, execution)
    }

    /// The weight of a pair, 0 if it does not agree.
    fn weight(graph: &SecondOrderGraph, i: u32, j: u32) -> u64 {
        let (neighbors, weights) = graph.row(i as usize);
        neighbors.binary_search(&j).map_or(0, |at| u64::from(weights[at]))
    }

    /// All maximal cliques, by extending each by each vertex in turn.
    fn all_cliques(graph: &SecondOrderGraph) -> Vec<Vec<u32>> {
        let joins = |clique: &[u32], k: u32| clique.iter().all(|&i| weight(graph, i, k) > 0);
        let vertices = 0..graph.len() as u32;
        let mut cliques = vec![Vec::new()];
        for k in vertices.clone() {
            for at in 0..cliques.len() {
                if joins(&cliques[at], k) {
                    let mut larger = cliques[at].clone();
                    larger.push(k);
                    cliques.push(larger);
                }
            }
        }
        let open = |clique: &Vec<u32>| vertices.clone().any(|k| !clique.contains(&k) && joins(clique, k));
        cliques.retain(|clique| clique.len() >= 3 && !open(clique));
        cliques
    }

    #[test]
    fn each_vertex_has_the_heaviest_of_all_cliques() -> Result<()> {
        let graph = graph(45)?;
        let found = search(&graph, usize::MAX, &Execution::default())?;
        let cliques = all_cliques(&graph);
        assert!(cliques.len() > 9);
        assert_eq!((found.cliques, found.cut_short), (cliques.len(), false));
        let pairs = |clique: &[u32]| -> u64 {
            let ordered = clique.iter().flat_map(|&i| clique.iter().map(move |&j| (i, j)));
            ordered.filter(|(i, j)| i < j).map(|(i, j)| weight(&graph, i, j)).sum()
        };
        for (i, kept) in found.of_vertices.iter().enumerate() {
            let with = cliques.iter().filter(|clique| clique.contains(&(i as u32)));
            let expected = with.map(|clique| (Reverse(pairs(clique)), clique.as_slice())).min();
            assert_eq!(kept.as_ref().map(|clique| clique.rank()), expected);
        }
        let distinct = found.distinct(usize::MAX)?;
        assert!(distinct.is_sorted_by(|a, b| a.rank() < b.rank()));
        assert_eq!(found.distinct(1)?, distinct[..1]);
        Ok(())
    }

    #[test]
    fn a_search_cut_short_is_reported() -> Result<()> {
        let graph = graph(300)?;
        let all = search(&graph, usize::MAX, &Execution::default())?;
        let few = search(&graph, all.cliques / 4, &Execution::default())?;
        assert!(few.cut_short && !all.cut_short && few.cliques < all.cliques);
        let stopped = Execution::default();
        stopped.stop();
        let none = search(&graph, usize::MAX, &stopped)?;
        assert_eq!((none.cut_short, none.cliques), (true, 0));
        Ok(())
    }
}
