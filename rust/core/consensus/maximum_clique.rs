//! The largest set of correspondences that are all connected to each other.
//!
//! Exact branch and bound on rows of bits: Tomita, Seki, *An efficient branch-and-bound algorithm for finding
//! a maximum clique* (DMTCS 2003), in the bit-parallel form of San Segundo et al. (2011).
//!
//! 1. Vertices are removed level by level, which gives core numbers and an order. The first clique is greedy:
//!    from the last vertex removed to the first, each that is connected to all before it.
//! 2. If its size is the greatest core number plus one, no clique is larger. Else vertices that may be in a
//!    larger one are kept: those with a core number of at least its size, in reverse order of removal.
//! 3. For each of them, a greedy clique of it and those before it replaces the first if it is larger.
//! 4. For each of them, the connected ones before it are searched: they are coloured, and no clique has more
//!    members than there are colours. From the last colour on, each in turn is fixed, and those connected to
//!    it are searched in the same way.

use super::coloring::{Colored, all, color};
use super::cores::Cores;
use crate::compatibility::graph::{AgreementGraph, ones};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;

/// Result of a search.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// Members, ascending.
    pub clique: Vec<u32>,
    /// Whether the search is complete, so that no clique is larger.
    pub complete: bool,
    /// Number of vertices coloured.
    pub steps: usize,
}

/// The largest clique, or the largest found before `most_steps` vertices are coloured; the first found of
/// several.
///
/// # Errors
/// [`crate::Error::InvalidInput`] if the graph of vertices that may be in a larger clique does not fit
/// `execution.max_memory`; [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn maximum_clique(
    graph: &AgreementGraph,
    cores: &Cores,
    most_steps: usize,
    execution: &Execution,
) -> Result<Found> {
    let first = greedy_clique(graph, &cores.from_last(0)?)?;
    if first.len() == cores.greatest() as usize + 1 || graph.is_empty() {
        return Ok(Found { clique: ascending(first), complete: true, steps: 0 });
    }
    let kept = cores.from_last(first.len() as u32)?;
    let inner = graph.induced(&kept, execution)?;
    let mut search =
        Search { graph: &inner, execution, most_steps, steps: 0, best: Vec::new(), size: first.len() };
    search.grow_from_each()?;
    let complete = search.branch_on_each()?;
    let steps = search.steps;
    let mut best = search.best;
    best.iter_mut().for_each(|vertex| *vertex = kept[*vertex as usize]);
    Ok(Found { clique: ascending(if best.is_empty() { first } else { best }), complete, steps })
}

/// Greedy clique: each vertex, in the given order, that is connected to all selected before it.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn greedy_clique(graph: &AgreementGraph, order: &[u32]) -> Result<Vec<u32>> {
    let mut candidates = all(graph.len())?;
    let mut clique = Vec::new();
    for &vertex in order {
        if candidates[vertex as usize / 64] >> (vertex % 64) & 1 == 1 {
            memory::push(&mut clique, vertex)?;
            retain(&mut candidates, graph.row(vertex as usize));
        }
    }
    Ok(clique)
}

fn ascending(mut clique: Vec<u32>) -> Vec<u32> {
    clique.sort_unstable();
    clique
}

fn retain(candidates: &mut [u64], row: &[u64]) {
    candidates.iter_mut().zip(row).for_each(|(word, row)| *word &= row);
}

fn count(bits: &[u64]) -> usize {
    bits.iter().map(|word| word.count_ones() as usize).sum()
}

/// The neighbours of a vertex with lower indices.
fn before(graph: &AgreementGraph, vertex: usize) -> Result<Vec<u64>> {
    let mut bits = memory::copied(&graph.row(vertex)[..=vertex / 64])?;
    bits[vertex / 64] &= (1 << (vertex % 64)) - 1;
    Ok(bits)
}

struct Search<'a> {
    graph: &'a AgreementGraph,
    execution: &'a Execution,
    most_steps: usize,
    steps: usize,
    /// The largest clique found, if it is larger than the first one.
    best: Vec<u32>,
    /// Size of the largest known clique.
    size: usize,
}

/// Candidates connected to all members so far, and those left to branch on, by colour.
struct Branch {
    candidates: Vec<u64>,
    colored: Vec<Colored>,
}

impl Search<'_> {
    fn grow_from_each(&mut self) -> Result<()> {
        for vertex in 0..self.graph.len() {
            self.execution.check()?;
            let mut candidates = before(self.graph, vertex)?;
            if count(&candidates) < self.size {
                continue;
            }
            let mut clique = vec![vertex as u32];
            while let Some(word) = candidates.iter().position(|&word| word != 0) {
                let next = word * 64 + candidates[word].trailing_zeros() as usize;
                memory::push(&mut clique, next as u32)?;
                retain(&mut candidates, self.graph.row(next));
            }
            self.keep(clique);
        }
        Ok(())
    }

    fn keep(&mut self, clique: Vec<u32>) {
        if clique.len() > self.size {
            self.size = clique.len();
            self.best = clique;
        }
    }

    /// Branches on each candidate; returns whether the search is complete.
    fn branch_on_each(&mut self) -> Result<bool> {
        for vertex in 0..self.graph.len() {
            let candidates = before(self.graph, vertex)?;
            if count(&candidates) >= self.size {
                self.branch(vertex as u32, candidates)?;
            }
            if self.steps > self.most_steps {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn branch(&mut self, vertex: u32, candidates: Vec<u64>) -> Result<()> {
        let mut members = vec![vertex];
        let mut branches = Vec::from_iter(self.open(&members, candidates)?);
        while let Some(branch) = branches.last_mut() {
            if self.steps > self.most_steps {
                return Ok(());
            }
            let next = branch.colored.pop();
            let Some((vertex, _)) = next.filter(|&(_, color)| members.len() + color as usize > self.size)
            else {
                branches.pop();
                members.pop();
                continue;
            };
            branch.candidates[vertex as usize / 64] &= !(1 << (vertex % 64));
            let mut candidates = memory::copied(&branch.candidates)?;
            retain(&mut candidates, self.graph.row(vertex as usize));
            memory::push(&mut members, vertex)?;
            match self.open(&members, candidates)? {
                Some(branch) => memory::push(&mut branches, branch)?,
                None => drop(members.pop()),
            }
        }
        Ok(())
    }

    /// The branch of the candidates; `None` if they are a clique themselves.
    fn open(&mut self, members: &[u32], candidates: Vec<u64>) -> Result<Option<Branch>> {
        self.execution.check()?;
        let population = count(&candidates);
        if members.len() + population <= self.size {
            return Ok(None);
        }
        self.steps += population;
        let mut colored = Vec::new();
        let (mut left, mut class) = (memory::copied(&candidates)?, memory::copied(&candidates)?);
        let least = self.size.saturating_sub(members.len()) as u32;
        let colors = color(self.graph, &mut left, &mut class, least, &mut colored)?;
        if colors as usize == population {
            let all = candidates.iter().enumerate().flat_map(|(word, &bits)| ones(word, bits));
            self.keep(memory::collect(members.iter().copied().chain(all))?);
            return Ok(None);
        }
        Ok((!colored.is_empty()).then_some(Branch { candidates, colored }))
    }
}

#[cfg(test)]
mod tests {
    use super::super::cores::tests::graph;
    use super::*;

    /// Size of the largest clique that extends one, by plain recursion.
    fn largest(graph: &AgreementGraph, members: usize, candidates: &[usize]) -> usize {
        let with = |(k, &i): (usize, &usize)| {
            let joined: Vec<usize> =
                candidates[k + 1..].iter().copied().filter(|&j| graph.joined(i, j)).collect();
            largest(graph, members + 1, &joined)
        };
        candidates.iter().enumerate().map(with).max().unwrap_or(members)
    }

    fn search(graph: &AgreementGraph, most_steps: usize) -> Result<Found> {
        let execution = Execution::default();
        maximum_clique(graph, &Cores::of(graph, &execution)?, most_steps, &execution)
    }

    #[test]
    fn is_as_large_as_by_brute_force() -> Result<()> {
        for (n, tolerance) in
            [(0, 1.0), (1, 1.0), (2, 9.0), (40, 0.5), (64, 0.4), (65, 0.3), (130, 0.2), (150, 0.1)]
        {
            let graph = graph(n, tolerance)?;
            let found = search(&graph, usize::MAX)?;
            assert!(found.complete && found.clique.is_sorted());
            assert_eq!(
                found.clique.len(),
                largest(&graph, 0, &(0..n).collect::<Vec<_>>()),
                "{n} {tolerance}"
            );
            for (&i, &j) in found.clique.iter().flat_map(|i| found.clique.iter().map(move |j| (i, j))) {
                assert!(i == j || graph.joined(i as usize, j as usize));
            }
        }
        Ok(())
    }

    #[test]
    fn a_search_cut_short_is_reported_and_returns_a_clique() -> Result<()> {
        let graph = graph(150, 0.4)?;
        let (short, whole) = (search(&graph, 0)?, search(&graph, usize::MAX)?);
        assert!(!short.complete && whole.complete && short.steps < whole.steps);
        assert!(short.clique.len() > 2 && short.clique.len() <= whole.clique.len());
        Ok(())
    }
}
