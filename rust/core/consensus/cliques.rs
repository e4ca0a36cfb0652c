//! Poses from cliques of correspondences that agree in distance.
//!
//! A clique grows, member by member, from each of the pairs with the most common neighbours. The
//! least-squares motion of its members is a hypothesis.

use rayon::prelude::*;

use crate::compatibility::graph::{AgreementGraph, Edge};
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::{Rigid, fit_rows};
use crate::memory;
use crate::points::Points;
use crate::simd;

/// Most members of a clique: more change the pose little.
const MOST_MEMBERS: usize = 12;

/// Most common neighbours considered per pair, those of the lowest indices: if there are more, most are
/// correct.
const MOST_CANDIDATES: usize = 256;

/// The motions of the cliques grown from the `most` heaviest edges, the heaviest first, without repeated
/// cliques. The indices of `source` and `target` are those of the graph.
///
/// # Errors
/// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn clique_poses(
    graph: &AgreementGraph,
    source: &Points,
    target: &Points,
    most: usize,
    execution: &Execution,
) -> Result<Vec<Rigid>> {
    let edges = graph.heaviest_edges(most, execution)?;
    let grow = |edge: &Edge| execution.check().and_then(|()| grow(graph, *edge));
    let cliques = memory::par_try_collect(edges.par_iter().map(grow))?;
    let pose = |clique: &&[u32]| fit_rows(source, target, clique.iter().map(|&i| i as usize));
    let poses = memory::par_try_collect(distinct(&cliques)?.par_iter().map(pose))?;
    memory::collect(poses.into_iter().flatten())
}

/// Grows a clique from an edge: adds the common neighbour that is connected to the most others of them, until
/// none is left; ties to the lowest index. Ascending.
fn grow(graph: &AgreementGraph, edge: Edge) -> Result<Vec<u32>> {
    let among = graph.common_neighbors(edge.i as usize, edge.j as usize, MOST_CANDIDATES)?;
    let mut left = Candidates::new(&among)?;
    let mut members = vec![edge.i, edge.j];
    // Upper bound of each candidate's number of connected candidates.
    let mut candidates = memory::collect(among.iter().map(|&k| (k, u32::MAX)))?;
    while members.len() < MOST_MEMBERS
        && let Some(best) = left.most_joined(graph, &mut candidates)
    {
        members.push(best);
        left.retain(graph.row(best as usize));
        let mut kept = 0;
        for row in 0..candidates.len() {
            // Each candidate that is left was connected to the new member. Written first and counted only if it is left.
            let (vertex, most) = candidates[row];
            candidates[kept] = (vertex, most.saturating_sub(1));
            kept += usize::from(left.contains(vertex));
        }
        candidates.truncate(kept);
    }
    members.sort_unstable();
    Ok(members)
}

/// Vertices that are connected to all members, as bits of the words of a row that hold them.
struct Candidates {
    first: usize,
    words: Vec<u64>,
}

impl Candidates {
    /// Candidates from ascending vertices.
    fn new(vertices: &[u32]) -> Result<Self> {
        let place = |vertex: u32| (vertex / u64::BITS) as usize;
        let [first, last] = [vertices.first(), vertices.last()].map(|vertex| vertex.map_or(0, |&k| place(k)));
        let mut words = memory::filled(0, last - first + 1)?;
        vertices.iter().for_each(|&k| words[place(k) - first] |= 1 << (k % u64::BITS));
        Ok(Self { first, words })
    }

    fn contains(&self, vertex: u32) -> bool {
        self.words[(vertex / u64::BITS) as usize - self.first] >> (vertex % u64::BITS) & 1 == 1
    }

    fn retain(&mut self, row: &[u64]) {
        self.words.iter_mut().zip(&row[self.first..]).for_each(|(word, row)| *word &= row);
    }

    /// The first of the candidates that is connected to the most of them; the number beside each is an upper
    /// bound.
    fn most_joined(&self, graph: &AgreementGraph, candidates: &mut [(u32, u32)]) -> Option<u32> {
        let mut best: Option<(u32, u32)> = None;
        // The one with the greatest bound first: it excludes most of the others.
        let first = candidates.iter().enumerate().max_by_key(|(_, (_, most))| *most)?.0;
        simd::run(
            #[inline(always)]
            || {
                for row in std::iter::once(first).chain(0..candidates.len()) {
                    let (vertex, most) = &mut candidates[row];
                    let is_worse = |(joined, other)| joined > *most || (joined == *most && other <= *vertex);
                    if best.is_some_and(is_worse) {
                        continue;
                    }
                    let row = &graph.row(*vertex as usize)[self.first..];
                    let mut joined = 0;
                    for (word, row) in self.words.iter().zip(row) {
                        joined += (word & row).count_ones();
                    }
                    *most = joined;
                    if best.is_none_or(|(most, other)| joined > most || (joined == most && *vertex < other)) {
                        best = Some((joined, *vertex));
                    }
                }
            },
        );
        best.map(|(_, vertex)| vertex)
    }
}

/// The distinct cliques, in the order of their first occurrence.
fn distinct(cliques: &[Vec<u32>]) -> Result<Vec<&[u32]>> {
    let mut seen = memory::set(cliques.len())?;
    memory::collect(cliques.iter().map(Vec::as_slice).filter(|clique| seen.insert(*clique)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twenty points moved rigidly, among others moved randomly.
    fn problem() -> Result<(Points, Points)> {
        let place = |i: usize, k: f64| [1.1, 2.3, 3.7].map(|f| 50.0 * (i as f64 * f * k + k).sin());
        let source: Vec<[f64; 3]> = (0..90).map(|i| place(i, 1.0)).collect();
        let target = source
            .iter()
            .enumerate()
            .map(|(i, p)| if i < 20 { [5.0 - p[1], p[0], p[2]] } else { place(i, 0.7) });
        let target: Vec<_> = target.collect();
        Ok((Points::from_rows("source", &source)?, Points::from_rows("target", &target)?))
    }

    #[test]
    fn the_heaviest_clique_gives_the_motion_of_its_points() -> Result<()> {
        let (source, target) = problem()?;
        let graph = AgreementGraph::new(&source, &target, 1e-6, 2e-6, &Execution::default())?;
        let poses = clique_poses(&graph, &source, &target, 100, &Execution::default())?;
        assert!(!poses.is_empty());
        for pose in poses {
            let moved = pose.uncentered(&source, &target);
            assert!((moved.rotation[(0, 1)] + 1.0).abs() < 1e-9 && (moved.translation.x - 5.0).abs() < 1e-9);
        }
        Ok(())
    }

    #[test]
    fn members_are_connected_and_cliques_distinct() -> Result<()> {
        let (source, target) = problem()?;
        let graph = AgreementGraph::new(&source, &target, 10.0, 20.0, &Execution::default())?;
        let edges = graph.heaviest_edges(200, &Execution::default())?;
        let grown = memory::try_collect(edges.iter().map(|&edge| grow(&graph, edge)))?;
        for clique in &grown {
            assert!(clique.len() > 2 && clique.len() <= MOST_MEMBERS && clique.is_sorted());
            for (&i, &j) in clique.iter().flat_map(|i| clique.iter().map(move |j| (i, j))) {
                assert!(i == j || graph.joined(i as usize, j as usize), "{clique:?}");
            }
        }
        let once = distinct(&grown)?;
        assert!(once.len() < grown.len() && grown.iter().all(|clique| once.contains(&clique.as_slice())));
        Ok(())
    }

    #[test]
    fn points_on_a_line_give_no_pose() -> Result<()> {
        let rows: Vec<[f64; 3]> = (0..30).map(|i| [f64::from(i), 2.0 * f64::from(i), 0.0]).collect();
        let points = Points::from_rows("points", &rows)?;
        let graph = AgreementGraph::new(&points, &points, 0.1, 0.2, &Execution::default())?;
        assert!(!graph.heaviest_edges(9, &Execution::default())?.is_empty());
        assert!(clique_poses(&graph, &points, &points, 9, &Execution::default())?.is_empty());
        Ok(())
    }

    #[test]
    fn candidates_contain_the_given_vertices() -> Result<()> {
        let vertices = [70, 127, 128, 200];
        let mut candidates = Candidates::new(&vertices)?;
        assert_eq!((candidates.first, candidates.words.len()), (1, 3));
        assert!((64..256).all(|k| candidates.contains(k) == vertices.contains(&k)));
        candidates.retain(&[0, 1 << 6, u64::MAX, 0]);
        assert!((64..256).all(|k| candidates.contains(k) == [70, 128].contains(&k)));
        Ok(())
    }
}
