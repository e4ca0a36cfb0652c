//! Poses from sets of correspondences that all keep their distance to each other.
//!
//! From each of the pairs with the most common neighbours grows a clique, member by member; the least-squares
//! motion of its members is a hypothesis.

use rayon::prelude::*;

use crate::compatibility::graph::{AgreementGraph, Edge};
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::{Rigid, fit_rigid, fixes_rotation};
use crate::points::Points;

/// Members that a clique grows to: more of them move the pose little.
const MOST_MEMBERS: usize = 12;

/// Common neighbours of a pair that are looked at, those of the lowest indices: where there are more, most are right.
const MOST_CANDIDATES: usize = 256;

/// Words of a row of the graph among the candidates.
const WORDS: usize = MOST_CANDIDATES / u64::BITS as usize;

/// Candidates, one bit each.
type Candidates = [u64; WORDS];

/// The motions of the cliques grown from the `most` heaviest edges, the heaviest first, each clique once.
/// The indices of `source` and `target` are those of the graph.
///
/// # Errors
/// [`crate::Error::Interrupted`].
pub fn clique_poses(
    graph: &AgreementGraph,
    source: &Points,
    target: &Points,
    most: usize,
    execution: &Execution,
) -> Result<Vec<Rigid>> {
    let edges = graph.heaviest_edges(most, execution)?;
    let cliques: Vec<Vec<u32>> =
        edges.par_iter().map(|edge| execution.check().map(|()| grow(graph, *edge))).collect::<Result<_>>()?;
    let poses = distinct(cliques).into_par_iter().map(|clique| pose_of(&clique, source, target));
    Ok(poses.collect::<Vec<_>>().into_iter().flatten().collect())
}

/// Adds, to both ends of the edge, the common neighbour that is joined with the most others of them, and so on;
/// ties to the lowest index. Ascending.
fn grow(graph: &AgreementGraph, edge: Edge) -> Vec<u32> {
    let among = graph.common_neighbors(edge.i as usize, edge.j as usize, MOST_CANDIDATES);
    let rows = rows_among(graph, &among);
    let mut members = vec![edge.i, edge.j];
    let mut left = first_ones(among.len());
    while members.len() < MOST_MEMBERS {
        let mut best: Option<(u32, usize)> = None;
        for k in (0..among.len()).filter(|&k| left[k / 64] >> (k % 64) & 1 == 1) {
            let joined = count_common(&left, &rows[k]);
            if best.is_none_or(|(most, _)| joined > most) {
                best = Some((joined, k));
            }
        }
        let Some((_, k)) = best else { break };
        members.push(among[k]);
        left.iter_mut().zip(&rows[k]).for_each(|(left, row)| *left &= row);
    }
    members.sort_unstable();
    members
}

/// The graph among some of its vertices.
fn rows_among(graph: &AgreementGraph, among: &[u32]) -> Vec<Candidates> {
    let row = |&i: &u32| {
        let mut row = [0; WORDS];
        for (k, &j) in among.iter().enumerate() {
            row[k / 64] |= u64::from(graph.joined(i as usize, j as usize)) << (k % 64);
        }
        row
    };
    among.iter().map(row).collect()
}

fn first_ones(count: usize) -> Candidates {
    std::array::from_fn(|word| match count.saturating_sub(64 * word) {
        0 => 0,
        more if more < 64 => (1 << more) - 1,
        _ => u64::MAX,
    })
}

fn count_common(a: &Candidates, b: &Candidates) -> u32 {
    a.iter().zip(b).map(|(a, b)| (a & b).count_ones()).sum()
}

/// Each clique once, in the order in which they come first.
fn distinct(cliques: Vec<Vec<u32>>) -> Vec<Vec<u32>> {
    let mut seen = std::collections::HashSet::new();
    cliques.into_iter().filter(|clique| seen.insert(clique.clone())).collect()
}

/// `None` where the points leave a rotation open.
fn pose_of(clique: &[u32], source: &Points, target: &Points) -> Option<Rigid> {
    let of = |points: &Points| clique.iter().map(|&i| points.get(i as usize)).collect::<Vec<_>>();
    let (p, q) = (of(source), of(target));
    fixes_rotation(&p, &q).then(|| fit_rigid(&p, &q))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twenty points moved rigidly, among others that were not.
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
    fn the_heaviest_clique_moves_as_its_points_do() -> Result<()> {
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
    fn members_are_all_joined_and_cliques_all_different() -> Result<()> {
        let (source, target) = problem()?;
        let graph = AgreementGraph::new(&source, &target, 10.0, 20.0, &Execution::default())?;
        let edges = graph.heaviest_edges(200, &Execution::default())?;
        let grown: Vec<_> = edges.iter().map(|&edge| grow(&graph, edge)).collect();
        for clique in &grown {
            assert!(clique.len() > 2 && clique.len() <= MOST_MEMBERS && clique.is_sorted());
            for (&i, &j) in clique.iter().flat_map(|i| clique.iter().map(move |j| (i, j))) {
                assert!(i == j || graph.joined(i as usize, j as usize), "{clique:?}");
            }
        }
        let once = distinct(grown.clone());
        assert!(once.len() < grown.len() && grown.iter().all(|clique| once.contains(clique)));
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
    fn as_many_bits_as_asked_for() {
        for count in [0, 1, 63, 64, 65, 200, 256] {
            let ones: u32 = first_ones(count).iter().map(|word| word.count_ones()).sum();
            assert_eq!(ones as usize, count);
        }
    }
}
