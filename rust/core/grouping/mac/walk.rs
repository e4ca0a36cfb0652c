//! The search for maximal cliques from one vertex.

use std::cmp::Reverse;
use std::sync::Arc;

use super::neighborhood::Neighborhood;
use crate::compatibility::graph::{count_common, indices};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory;

/// A maximal clique.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Clique {
    /// Sum of the weights of its pairs.
    pub weight: u64,
    /// Ascending.
    pub members: Vec<u32>,
}

impl Clique {
    /// Sort key: the heavier clique first; of equal ones the one with the lower members.
    pub fn rank(&self) -> (Reverse<u64>, &[u32]) {
        (Reverse(self.weight), &self.members)
    }
}

/// Sets of neighbours of a vertex that are connected to all members of a clique.
#[derive(Debug, Clone, Default)]
struct Sets {
    /// Later neighbours that may be added next.
    candidates: Vec<u64>,
    /// Later neighbours whose cliques are already found.
    done: Vec<u64>,
    /// Earlier neighbours.
    earlier: Vec<u64>,
}

/// Result of a search.
#[derive(Debug, Clone, Default)]
pub struct Walked {
    /// Number of maximal cliques with enough members.
    pub cliques: usize,
    /// Number of maximal cliques and dead ends.
    pub ends: usize,
    /// Whether the search is complete.
    pub finished: bool,
    /// Vertices, each with the heaviest clique found with it.
    pub heaviest: Vec<(u32, Arc<Clique>)>,
}

/// A search in progress.
pub struct Walk<'a> {
    hood: Neighborhood,
    min_size: usize,
    max_ends: usize,
    execution: &'a Execution,
    /// Later neighbours that form a clique with the vertex.
    members: Vec<usize>,
    /// The heaviest clique of each later neighbour, and then of the vertex.
    heaviest: Vec<Option<Arc<Clique>>>,
    walked: Walked,
    /// Unused sets for reuse.
    spare: Vec<Sets>,
}

impl<'a> Walk<'a> {
    /// A search from the centre of a neighbourhood, for cliques of at least `min_size` members, for at most
    /// `max_ends` results.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn new(
        hood: Neighborhood,
        min_size: usize,
        max_ends: usize,
        execution: &'a Execution,
    ) -> Result<Self> {
        Ok(Self {
            heaviest: memory::filled(None, hood.later.len() + 1)?,
            hood,
            min_size,
            max_ends,
            execution,
            members: Vec::new(),
            walked: Walked::default(),
            spare: Vec::new(),
        })
    }

    /// Runs the search.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn run(mut self) -> Result<Walked> {
        let sets = Sets {
            candidates: first_bits(self.hood.later.len())?,
            done: memory::filled(0, self.hood.later.len().div_ceil(64))?,
            earlier: first_bits(self.hood.earlier)?,
        };
        self.walked.finished = self.extend(sets, 0)?;
        let vertices = self.hood.later.iter().copied().chain([self.hood.center]);
        let found = vertices.zip(self.heaviest).filter_map(|(i, clique)| Some((i, clique?)));
        Ok(Walked { heaviest: memory::collect(found)?, ..self.walked })
    }

    /// Finds the cliques of the members and of candidates; returns whether it found all of them.
    fn extend(&mut self, mut sets: Sets, weight: u64) -> Result<bool> {
        self.execution.check()?;
        if self.walked.ends >= self.max_ends || self.execution.is_stopped() {
            return Ok(false);
        }
        let pivot = self.pivot(&sets)?;
        let mut branches = memory::copied(&sets.candidates)?;
        if let Some(pivot) = pivot {
            branches.iter_mut().zip(self.hood.joined(pivot)).for_each(|(word, joined)| *word &= !joined);
        }
        if branches.iter().all(|&word| word == 0) {
            if pivot.is_none() {
                self.report(weight)?;
            }
            self.walked.ends += 1;
            memory::push(&mut self.spare, sets)?;
            return Ok(true);
        }
        // The pivot's branch has the most candidates: its cliques are large.
        let first = pivot.filter(|&a| a < self.hood.later.len() && has(&sets.candidates, a));
        let others = indices(&branches).map(|a| a as usize).filter(|&a| Some(a) != first);
        for a in first.into_iter().chain(others) {
            let narrowed = self.narrowed(&sets, a)?;
            let gain = self.hood.gain(a, &self.members);
            memory::push(&mut self.members, a)?;
            let goes_on = self.extend(narrowed, weight + gain)?;
            self.members.pop();
            if !goes_on {
                return Ok(false);
            }
            sets.candidates[a / 64] &= !(1 << (a % 64));
            sets.done[a / 64] |= 1 << (a % 64);
        }
        memory::push(&mut self.spare, sets)?;
        Ok(true)
    }

    /// The neighbour connected to the most candidates, among those connected to all members; ties to the
    /// first, later neighbours before earlier ones.
    fn pivot(&self, sets: &Sets) -> Result<Option<usize>> {
        let later = memory::collect(sets.candidates.iter().zip(&sets.done).map(|(a, b)| a | b))?;
        let earlier = indices(&sets.earlier).map(|b| self.hood.later.len() + b as usize);
        let mut best: Option<(u32, usize)> = None;
        for a in indices(&later).map(|a| a as usize).chain(earlier) {
            let joined = count_common(self.hood.joined(a), &sets.candidates);
            if best.is_none_or(|(most, _)| joined > most) {
                best = Some((joined, a));
            }
        }
        Ok(best.map(|(_, a)| a))
    }

    /// The sets restricted to neighbours of one more member.
    fn narrowed(&mut self, sets: &Sets, a: usize) -> Result<Sets> {
        let mut narrowed = self.spare.pop().unwrap_or_default();
        let fill = |to: &mut Vec<u64>, from: &[u64], row: &[u64]| {
            to.clear();
            memory::reserve(to, from.len())?;
            to.extend(from.iter().zip(row).map(|(a, b)| a & b));
            Ok(())
        };
        fill(&mut narrowed.candidates, &sets.candidates, self.hood.joined(a))?;
        fill(&mut narrowed.done, &sets.done, self.hood.joined(a))?;
        fill(&mut narrowed.earlier, &sets.earlier, self.hood.joined_earlier(a))?;
        Ok(narrowed)
    }

    /// Records the clique of the vertex and the members for those of them whose heaviest it is.
    fn report(&mut self, weight: u64) -> Result<()> {
        if self.members.len() + 1 < self.min_size {
            return Ok(());
        }
        self.walked.cliques += 1;
        let center = self.hood.later.len();
        let of_clique = || self.members.iter().copied().chain([center]);
        if !of_clique().any(|a| self.heaviest[a].as_ref().is_none_or(|other| weight >= other.weight)) {
            return Ok(());
        }
        let mut members = memory::with_capacity(self.members.len() + 1)?;
        members.extend(self.members.iter().map(|&a| self.hood.later[a]));
        members.push(self.hood.center);
        members.sort_unstable();
        let clique = Arc::new(Clique { weight, members });
        for a in self.members.iter().copied().chain([center]) {
            let kept = &mut self.heaviest[a];
            if kept.as_ref().is_none_or(|other| clique.rank() < other.rank()) {
                *kept = Some(Arc::clone(&clique));
            }
        }
        Ok(())
    }
}

fn first_bits(count: usize) -> Result<Vec<u64>> {
    let mut words = memory::filled(0, count.div_ceil(64))?;
    (0..count).for_each(|a| words[a / 64] |= 1 << (a % 64));
    Ok(words)
}

fn has(words: &[u64], a: usize) -> bool {
    words[a / 64] >> (a % 64) & 1 == 1
}
