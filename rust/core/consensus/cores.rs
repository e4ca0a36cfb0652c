//! Core numbers of correspondences: a measure of the density of their neighbourhoods in the graph.
//!
//! The k-core is the graph that remains after all vertices with fewer than k neighbours are removed
//! repeatedly; the core number of a vertex is the greatest k whose core contains it (Seidman, 1983). A clique
//! of m members lies in the (m - 1)-core, so no clique has more members than the greatest core number plus
//! one.

use rayon::prelude::*;

use crate::compatibility::graph::{AgreementGraph, ones};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;

/// Core numbers of a graph's vertices, and the order of their removal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cores {
    /// The core number of each vertex.
    pub numbers: Vec<u32>,
    /// By round: all vertices whose degree is at most the level, by index; the level rises when there are
    /// none.
    pub order: Vec<u32>,
}

impl Cores {
    /// Removes the vertices of the graph level by level. Cost: each edge twice.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn of(graph: &AgreementGraph, execution: &Execution) -> Result<Self> {
        let mut peeling = Peeling::new(graph)?;
        let mut left = memory::collect(0..graph.len() as u32)?;
        while let Some(level) = left.iter().map(|&vertex| peeling.degrees[vertex as usize]).min() {
            let of_level = |vertex: &u32| peeling.degrees[*vertex as usize] == level;
            let mut round = memory::collect(left.iter().copied().filter(of_level))?;
            while !round.is_empty() {
                round = peeling.take_out(&round, level, execution)?;
            }
            left.retain(|&vertex| peeling.is_left(vertex));
        }
        Ok(Self { numbers: peeling.numbers, order: peeling.order })
    }

    /// The greatest core number; 0 for an empty graph.
    pub fn greatest(&self) -> u32 {
        self.numbers.iter().copied().max().unwrap_or_default()
    }

    /// The vertices with at least that core number, in reverse order of removal.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn from_last(&self, least: u32) -> Result<Vec<u32>> {
        let order = self.order.iter().rev().copied();
        memory::collect(order.filter(|&vertex| self.numbers[vertex as usize] >= least))
    }
}

/// The remaining part of a graph.
struct Peeling<'a> {
    graph: &'a AgreementGraph,
    /// Number of remaining neighbours.
    degrees: Vec<u32>,
    left: Vec<u64>,
    numbers: Vec<u32>,
    order: Vec<u32>,
}

impl<'a> Peeling<'a> {
    fn new(graph: &'a AgreementGraph) -> Result<Self> {
        let degrees = (0..graph.len()).into_par_iter().map(|vertex| graph.degree(vertex));
        Ok(Self {
            graph,
            degrees: memory::par_collect(degrees)?,
            left: memory::filled(u64::MAX, graph.len().div_ceil(64))?,
            numbers: memory::filled(0, graph.len())?,
            order: memory::with_capacity(graph.len())?,
        })
    }

    fn is_left(&self, vertex: u32) -> bool {
        self.left[vertex as usize / 64] >> (vertex % 64) & 1 == 1
    }

    /// Removes a round of vertices; returns those whose degree thereby falls to the level.
    fn take_out(&mut self, round: &[u32], level: u32, execution: &Execution) -> Result<Vec<u32>> {
        let mut next = Vec::new();
        for &vertex in round {
            execution.check()?;
            self.numbers[vertex as usize] = level;
            self.order.push(vertex);
            self.left[vertex as usize / 64] &= !(1 << (vertex % 64));
            let joined = self.graph.row(vertex as usize).iter().zip(&self.left).map(|(a, b)| a & b);
            for neighbor in joined.enumerate().flat_map(|(word, bits)| ones(word, bits)) {
                let degree = &mut self.degrees[neighbor as usize];
                *degree -= 1;
                if *degree == level {
                    memory::push(&mut next, neighbor)?;
                }
            }
        }
        next.sort_unstable();
        Ok(next)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::points::Points;

    /// A graph of points in the plane, some of which have moved.
    pub fn graph(n: usize, tolerance: f64) -> Result<AgreementGraph> {
        let place = |i: usize, k: f64| [(i as f64 * k).sin(), (i as f64 * 1.7 * k).cos(), (i as f64).cos()];
        let rows = |k: f64| (0..n).map(|i| place(i, k)).collect::<Vec<_>>();
        let (source, target) =
            (Points::from_rows("source", &rows(0.37))?, Points::from_rows("target", &rows(0.4))?);
        AgreementGraph::new(&source, &target, tolerance, 0.0, &Execution::default())
    }

    #[test]
    fn the_k_core_remains_after_removing_lower_degrees() -> Result<()> {
        for n in [0, 1, 2, 64, 65, 200] {
            let graph = graph(n, 0.3)?;
            let cores = Cores::of(&graph, &Execution::default())?;
            for k in 0..=cores.greatest() + 1 {
                let mut core: Vec<usize> = (0..n).collect();
                loop {
                    let before = core.clone();
                    let degree = |&i: &usize| before.iter().filter(|&&j| graph.joined(i, j)).count();
                    core.retain(|i| degree(i) >= k as usize);
                    if core.len() == before.len() {
                        break;
                    }
                }
                let expected: Vec<usize> = (0..n).filter(|&i| cores.numbers[i] >= k).collect();
                assert_eq!(core, expected, "{n} {k}");
            }
        }
        Ok(())
    }

    #[test]
    fn no_vertex_has_more_later_neighbors_than_its_core_number() -> Result<()> {
        let graph = graph(200, 0.3)?;
        let cores = Cores::of(&graph, &Execution::default())?;
        let mut sorted = cores.order.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..200).collect::<Vec<u32>>());
        for (rank, &i) in cores.order.iter().enumerate() {
            let after = cores.order[rank..].iter().filter(|&&j| graph.joined(i as usize, j as usize)).count();
            assert!(after <= cores.numbers[i as usize] as usize);
        }
        assert_eq!(cores.from_last(0)?.first(), cores.order.last());
        assert!(cores.from_last(cores.greatest() + 1)?.is_empty());
        Ok(())
    }
}
