//! Upper bound on the number of inliers of any other pose.
//!
//! Match i is an inlier of a pose if `|R p_i + t - q_i| <= e`. Let S be the k inliers of the given pose, and
//! `h = floor(k / 2)`. A rival is a pose with at most h inliers in S. Any pose that moves at least half of the
//! source points of S by more than 2 e from where the given pose moves them is a rival: if match i is an inlier
//! of both poses, both move `p_i` to within e of `q_i`, hence to within 2 e of each other.
//!
//! The bound: let C be the inliers of a rival. Of two matches i, j in C, the moved points keep their distance ds, and
//! the targets are each within e of them, so that `|ds - dt| <= 2 e`: C is a clique of the graph of pairs with
//! that property. Let B be the part of C outside S. If B is empty, C has at most h members. Else order the
//! matches outside S, and let v be the first member of B. All others of C are neighbours of v: those in S are
//! at most `min(h, |N(v) and S|)`, and those in B are a clique among the neighbours of v that follow it, with no
//! more members than these have colours ([`coloring`](crate::consensus::coloring)). So
//! `|C| <= max(h, max over v of 1 + min(h, |N(v) and S|) + colours(N(v) after v))`. Where that is not below k,
//! the same is done with two members of B, and so on, until a number of steps.
//!
//! If the bound is below k, no rival has as many inliers as the given pose.

use crate::compatibility::graph::{AgreementGraph, EdgeLengths, count_common};
use crate::consensus::coloring::{Colored, color};
use crate::consensus::cores::Cores;
use crate::error::positive;
use crate::geometry::rigid::Rigid;
use crate::grouping::match_posterior::scale_of;
use crate::{Correspondences, Execution, Points, Result, memory};
use nalgebra::Matrix4;

/// Rounding of distances, relative to the extent of the points, and of the tolerance.
const ROUNDING: f64 = 1e-12;

/// Most vertices coloured: a few tenths of a second.
const MOST_STEPS: usize = 2_000_000;

/// A bound, and what it is compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bound {
    /// Number of inliers of the given pose.
    pub inliers: usize,
    /// No rival has more inliers.
    pub rivals: usize,
}

/// Bounds the number of inliers of the rivals of a model, at the scale of the model.
///
/// # Errors
/// [`crate::Error::MissingField`] without points; [`crate::Error::InvalidInput`] for a tolerance that is not
/// positive, a model that is not a similarity, or if the graph of all matches does not fit
/// `execution.max_memory`; [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
pub fn bound_rivals(
    correspondences: &Correspondences,
    model: &Matrix4<f64>,
    tolerance: f64,
    execution: &Execution,
) -> Result<Bound> {
    let (source, target) = correspondences.positions("certify")?;
    let (scale, tolerance) = (scale_of(model)?, positive("tolerance", tolerance)?);
    let source = source.scaled(scale)?;
    let Rigid { rotation, translation } = Rigid::from_matrix(model);
    let pose = Rigid { rotation: rotation / scale, translation }.centered(&source, target);
    bound_of_rivals(&source, target, &pose, tolerance, execution)
}

/// As [`bound_rivals`], for a rigid pose between the centred points.
fn bound_of_rivals(
    source: &Points,
    target: &Points,
    pose: &Rigid,
    tolerance: f64,
    execution: &Execution,
) -> Result<Bound> {
    let is_inlier = |i: &usize| (pose.apply(&source.get(*i)) - target.get(*i)).norm() <= tolerance;
    let inside = memory::collect((0..source.len()).filter(is_inlier))?;
    let outside = memory::collect((0..source.len()).filter(|i| !is_inlier(i)).map(|i| i as u32))?;
    let slack = ROUNDING * (source.diagonal() + target.diagonal() + tolerance);
    let difference = 2.0 * tolerance + slack;
    let graph = AgreementGraph::with_edges(source, target, difference, EdgeLengths::Any, execution)?;
    let mut members = memory::filled(0_u64, source.len().div_ceil(64))?;
    inside.iter().for_each(|&i| members[i / 64] |= 1 << (i % 64));
    let among = graph.induced(&outside, execution)?;
    let order = Cores::of(&among, execution)?.from_last(0)?;
    let among = among.induced(&order, execution)?;
    let rows = memory::collect(order.iter().map(|&k| outside[k as usize] as usize))?;
    let inliers = inside.len();
    let mut search = Search {
        graph: &graph,
        among: &among,
        rows: &rows,
        members: &members,
        half: inliers / 2,
        inliers,
        steps: 0,
        bound: inliers / 2,
        execution,
    };
    search.bound_each()?;
    Ok(Bound { inliers, rivals: search.bound })
}

/// Members of B, with the bits of the members of S and of the candidates that are neighbours of all of them.
struct Branch {
    count: usize,
    inside: Vec<u64>,
    candidates: Vec<u64>,
}

struct Search<'a> {
    /// Of all matches.
    graph: &'a AgreementGraph,
    /// Of those outside S, the last to be removed by core number first.
    among: &'a AgreementGraph,
    /// The row in `graph` of each vertex of `among`.
    rows: &'a [usize],
    /// S.
    members: &'a [u64],
    half: usize,
    inliers: usize,
    steps: usize,
    bound: usize,
    execution: &'a Execution,
}

impl Search<'_> {
    /// Branches on each vertex with those before it, which were removed later.
    fn bound_each(&mut self) -> Result<()> {
        for vertex in 0..self.rows.len() {
            let mut candidates = memory::copied(self.among.row(vertex))?;
            candidates.truncate(vertex / 64 + 1);
            if let Some(last) = candidates.last_mut() {
                *last &= (1 << (vertex % 64)) - 1;
            }
            let inside = self.inside(self.members, vertex)?;
            self.search(Branch { count: 1, inside, candidates })?;
        }
        Ok(())
    }

    /// Bounds a branch; divides it while that is not below the number of inliers and steps are left.
    fn search(&mut self, first: Branch) -> Result<()> {
        let mut branches = vec![first];
        while let Some(Branch { count, inside, candidates }) = branches.pop() {
            self.execution.check()?;
            let shared = count_common(&inside, &inside) as usize;
            let own = count + shared.min(self.half);
            let open = count_common(&candidates, &candidates) as usize;
            if own + open < self.inliers || own + open <= self.bound {
                self.bound = self.bound.max(own + open);
                continue;
            }
            self.steps += open;
            let least = self.inliers.saturating_sub(own + 1) as u32;
            let (mut left, mut class) = (memory::copied(&candidates)?, memory::copied(&candidates)?);
            let mut colored: Vec<Colored> = Vec::new();
            let colors = color(self.among, &mut left, &mut class, least, &mut colored)? as usize;
            if own >= self.inliers || own + colors < self.inliers || self.steps > MOST_STEPS {
                self.bound = self.bound.max(own + colors);
                continue;
            }
            // A clique of the colours up to `least` is small enough; each other one has a last vertex.
            self.bound = self.bound.max(own + least as usize);
            let mut candidates = candidates;
            while let Some((vertex, _)) = colored.pop() {
                let vertex = vertex as usize;
                candidates[vertex / 64] &= !(1 << (vertex % 64));
                let mut joined = memory::copied(&candidates)?;
                joined.iter_mut().zip(self.among.row(vertex)).for_each(|(word, row)| *word &= row);
                let inside = self.inside(&inside, vertex)?;
                memory::push(&mut branches, Branch { count: count + 1, inside, candidates: joined })?;
            }
        }
        Ok(())
    }

    /// The bits that are also neighbours of a vertex of `among`.
    fn inside(&self, bits: &[u64], vertex: usize) -> Result<Vec<u64>> {
        memory::collect(bits.iter().zip(self.graph.row(self.rows[vertex])).map(|(a, b)| a & b))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grouping::test_problem::problem;

    /// The largest clique with at most `half` of the members, by plain recursion.
    fn largest(joined: &dyn Fn(usize, usize) -> bool, n: usize, inside: &[bool], half: usize) -> usize {
        let mut best = 0;
        let mut stack = vec![(Vec::new(), 0)];
        while let Some((clique, next)) = stack.pop() {
            best = best.max(clique.len());
            for i in next..n {
                let shared = clique.iter().filter(|&&j: &&usize| inside[j]).count() + usize::from(inside[i]);
                if clique.iter().all(|&j| joined(i, j)) && shared <= half {
                    let mut more = clique.clone();
                    more.push(i);
                    stack.push((more, i + 1));
                }
            }
        }
        best
    }

    #[test]
    fn no_clique_of_a_rival_exceeds_the_bound() -> Result<()> {
        for (n, right, tolerance) in [(0, 0, 1.0), (3, 3, 1.0), (40, 10, 2.0), (40, 6, 6.0), (60, 20, 3.0)] {
            let given = problem(n, right)?;
            let (source, target) = given.positions("lc")?;
            let pose = crate::geometry::rigid::fit_rows(source, target, 0..right)?;
            let pose = pose.unwrap_or_else(Rigid::identity);
            let found = bound_of_rivals(source, target, &pose, tolerance, &Execution::default())?;
            let inside: Vec<bool> =
                (0..n).map(|i| (pose.apply(&source.get(i)) - target.get(i)).norm() <= tolerance).collect();
            let joined =
                |i: usize, j: usize| (source.distance(i, j) - target.distance(i, j)).abs() <= 2.0 * tolerance;
            assert_eq!(found.inliers, inside.iter().filter(|&&one| one).count());
            let truth = largest(&joined, n, &inside, found.inliers / 2);
            assert!(truth <= found.rivals, "{truth} {found:?}");
        }
        Ok(())
    }

    #[test]
    fn a_clear_group_is_proven() -> Result<()> {
        let given = problem(400, 60)?;
        let (source, target) = given.positions("lc")?;
        let pose = crate::geometry::rigid::fit_rows(source, target, 0..60)?.unwrap_or_else(Rigid::identity);
        let found = bound_of_rivals(source, target, &pose, 1.0, &Execution::default())?;
        assert!(found.rivals < found.inliers, "{found:?}");
        Ok(())
    }
}
