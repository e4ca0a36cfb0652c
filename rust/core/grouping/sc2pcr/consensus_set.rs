//! The consensus set of a seed, and its pose.

use std::cmp::Reverse;

use super::seeds::POWER_STEPS;
use crate::compatibility::agreement::DistanceAgreement;
use crate::compatibility::distance::distance_difference;
use crate::compatibility::graph::{AgreementGraph, EdgeLengths};
use crate::compatibility::long_agreement::LongAgreement;
use crate::geometry::rigid::{Rigid, fit_weighted, fixes_rotation};
use crate::{Execution, Points, Result, memory};

/// Gathers consensus sets around seeds.
pub(super) struct ConsensusSets<'a> {
    source: &'a Points,
    target: &'a Points,
    max_distance_difference: f64,
    /// Members after each stage.
    sizes: [usize; 2],
    /// `d < D`.
    hard: LongAgreement<'a>,
    /// `d < D / 2`.
    tight: AgreementGraph,
}

/// Working space of one thread.
pub(super) struct Working {
    row: Vec<u64>,
    unsure: Vec<u64>,
    /// Number of common tight-compatible correspondences, and the index.
    counts: Vec<(Reverse<u32>, u32)>,
}

impl<'a> ConsensusSets<'a> {
    pub(super) fn new(
        source: &'a Points,
        target: &'a Points,
        max_distance_difference: f64,
        sizes: [usize; 2],
        execution: &Execution,
    ) -> Result<Self> {
        let (any, d) = (EdgeLengths::Any, max_distance_difference);
        let hard = LongAgreement::new(DistanceAgreement::new(source, target, d)?, any);
        let tight = AgreementGraph::with_edges(source, target, d / 2.0, any, execution)?;
        Ok(Self { source, target, max_distance_difference, sizes, hard, tight })
    }

    pub(super) fn working_space(&self) -> Result<Working> {
        let words = self.source.len().div_ceil(u64::BITS as usize);
        let [row, unsure] = memory::try_map([(); 2], |()| memory::filled(0, words))?;
        Ok(Working { row, unsure, counts: Vec::new() })
    }

    /// The pose of the seed's set, between the centred points; `None` if the set does not determine the
    /// rotation.
    pub(super) fn pose(&self, seed: usize, working: &mut Working) -> Result<Option<Rigid>> {
        let members = self.most_compatible(seed, working)?;
        let members = self.most_connected(&members)?;
        self.fit(&members)
    }

    /// First stage: the seed and the correspondences with the greatest second-order compatibility with it.
    fn most_compatible(&self, seed: usize, working: &mut Working) -> Result<Vec<u32>> {
        self.hard.fill_row(seed, &mut working.row, &mut working.unsure);
        let Working { row, counts, .. } = &mut *working;
        counts.clear();
        memory::reserve(counts, row.iter().map(|word| word.count_ones() as usize).sum())?;
        self.tight.count_common_with(seed, row, |j, common| {
            if j as usize != seed && common > 0 {
                counts.push((Reverse(common), j));
            }
        });
        let best = best(&mut working.counts, self.sizes[0] - 1);
        memory::collect(std::iter::once(seed as u32).chain(best.iter().map(|&(_, j)| j)))
    }

    /// Second stage: the correspondences with the greatest second-order compatibility with the first one
    /// within the set.
    fn most_connected(&self, members: &[u32]) -> Result<Vec<u32>> {
        let differences = self.differences(members)?;
        let hard = memory::collect(differences.iter().map(|&d| d < self.max_distance_difference))?;
        let rows = hard.chunks_exact(members.len());
        let mut counts = memory::filled(0_u32, members.len())?;
        for (row, _) in rows.zip(&hard).filter(|(_, compatible)| **compatible) {
            counts.iter_mut().zip(row).for_each(|(count, &joined)| *count += u32::from(joined));
        }
        let mut ranked = memory::collect(counts.into_iter().map(Reverse).zip(0_u32..))?;
        let best = best(&mut ranked, self.sizes[1]);
        memory::collect(best.iter().map(|&(_, place)| members[place as usize]))
    }

    /// Weighted least-squares pose.
    fn fit(&self, members: &[u32]) -> Result<Option<Rigid>> {
        let weights = self.weights(members)?;
        let kept = || members.iter().zip(&weights).filter(|(_, weight)| **weight > 0.0);
        let of = |points: &Points| memory::collect(kept().map(|(&i, _)| points.get(i as usize)));
        let (p, q) = (of(self.source)?, of(self.target)?);
        let weights = memory::collect(kept().map(|(_, &weight)| weight))?;
        Ok(fixes_rotation(&p, &q).then(|| fit_weighted(&p, &q, &weights)))
    }

    /// The principal eigenvector of the soft compatibility with zeros on the diagonal; zeros if all of it is
    /// zero.
    fn weights(&self, members: &[u32]) -> Result<Vec<f64>> {
        let size = members.len();
        let mut soft = self.differences(members)?;
        for (at, entry) in soft.iter_mut().enumerate() {
            let share = *entry / self.max_distance_difference;
            *entry = if at % (size + 1) == 0 { 0.0 } else { (1.0 - share * share).max(0.0) };
        }
        let mut vector = memory::filled(1.0, size)?;
        for _ in 0..POWER_STEPS {
            let product = |row: &[f64]| row.iter().zip(&vector).map(|(a, b)| a * b).sum::<f64>();
            let mut next = memory::collect(soft.chunks_exact(size).map(product))?;
            let total: f64 = next.iter().sum();
            if total <= 0.0 {
                return Ok(next);
            }
            next.iter_mut().for_each(|entry| *entry /= total);
            vector = next;
        }
        Ok(vector)
    }

    /// `|ds - dt|` of all pairs of members, by rows.
    fn differences(&self, members: &[u32]) -> Result<Vec<f64>> {
        let size = members.len();
        let mut differences = memory::filled(0.0, size * size)?;
        for (a, &i) in members.iter().enumerate() {
            for (b, &j) in members.iter().enumerate().skip(a + 1) {
                let (i, j) = (i as usize, j as usize);
                let difference = distance_difference(self.source.distance(i, j), self.target.distance(i, j));
                differences[a * size + b] = difference;
                differences[b * size + a] = difference;
            }
        }
        Ok(differences)
    }
}

/// The `most` least, in order.
fn best<T: Ord>(ranked: &mut [T], most: usize) -> &[T] {
    let most = most.min(ranked.len());
    if most > 0 && most < ranked.len() {
        ranked.select_nth_unstable(most);
    }
    ranked[..most].sort_unstable();
    &ranked[..most]
}
