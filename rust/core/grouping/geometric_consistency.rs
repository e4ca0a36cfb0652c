//! GC: the largest cluster of correspondences that agree in distance with a seed.
//!
//! The paper, section 3.2, Eq. (13) (after Chen, Bhanu, PRL 2007): for each seed, the correspondences whose
//! distances to it differ by less than 3 pr between the two shapes. Cost O(n^2) time, O(n) memory. The clique
//! variant uses n^2 / 8 bytes if allowed, and otherwise recomputes pairs.

use super::GroupingMethod;
use crate::compatibility::agreement::DistanceAgreement;
use crate::compatibility::distance::distance_difference;
use crate::compatibility::graph::{AgreementGraph, EdgeLengths};
use crate::consensus::SampleConsensus;
use crate::grouping_result::mask_of;
use crate::options::{ROUNDS, Value, at_least, method, words};
use crate::rule::{Agreement, Kind, Rule};
use crate::selection::top_k::largest;
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};

words! {
    /// Definition of a cluster.
    pub enum Variant {
        /// A seed and all correspondences consistent with it, as in the paper.
        Star = Value::Word("star"),
        /// A greedily grown set of mutually consistent correspondences, filtered by RANSAC, as in PCL.
        Clique = Value::Word("clique"),
    }
}

words! {
    /// Choice among several largest star clusters.
    pub enum Ties {
        /// The one with the lowest index.
        Lowest = Value::Word("lowest"),
        /// The union of all.
        Union = Value::Word("union"),
    }
}

method! {
    /// Parameters of geometric consistency.
    pub struct GeometricConsistency = "gc", ["source", "target"], optional ["similarity", "resolution"], {
        /// Two correspondences are consistent if `|ds - dt|` is below this length; default `3 * resolution`.
        pub tolerance: Option<f64> = None;
        /// A seed and all correspondences consistent with it; or, as in PCL, a set of mutually consistent
        /// ones grown greedily in the order of `similarity`, filtered by RANSAC.
        pub variant: Variant = Variant::default();
        /// Of several largest stars, select the one of the lowest index, or the union of all.
        pub ties: Ties = Ties::default();
        /// Clique variant: a cluster has more members than this.
        pub min_cluster_size: usize = 3, at_least(0);
        /// Clique variant: samples of the RANSAC filter.
        pub iterations: usize = 10_000, ROUNDS;
        /// Clique variant: seed of the filter's random numbers.
        pub seed: u64 = 0;
    }
}

impl GroupingMethod for GeometricConsistency {
    fn run(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping> {
        let (source, target) = correspondences.positions("gc")?;
        let tolerance = correspondences.length("tolerance", self.tolerance, 3.0)?;
        match self.variant {
            Variant::Star => self.largest_star(source, target, tolerance, execution),
            Variant::Clique => {
                let order = visiting_order(correspondences)?;
                self.largest_clique(source, target, tolerance, &order, execution)
            }
        }
    }
}

impl GeometricConsistency {
    fn largest_star(
        &self,
        source: &Points,
        target: &Points,
        tolerance: f64,
        execution: &Execution,
    ) -> Result<Grouping> {
        let agreement = &DistanceAgreement::new(source, target, tolerance)?;
        let sizes = cluster_sizes(agreement, execution)?; // |G_i|, Eq. (13)
        let greatest = sizes.iter().copied().max().unwrap_or_default();
        let mut seeds = memory::collect((0..sizes.len()).filter(|&i| sizes[i] == greatest))?;
        if self.ties == Ties::Lowest {
            seeds.truncate(1);
        }
        let mut mask = memory::filled(false, sizes.len())?;
        for &seed in &seeds {
            let star = (0..sizes.len()).map(|j| agreement.agree(seed, j)); // G_i, i* = argmax |G_i|
            mask.iter_mut().zip(star).for_each(|(member, also)| *member |= also);
        }
        let scores = memory::collect(sizes.iter().map(|&size| f64::from(size)))?;
        let rule = Rule {
            decided_by: Some(nearest_seeds(&seeds, source, target)?),
            ..Rule::bounded(Kind::Star, tolerance).agreeing(Agreement::difference(tolerance))
        };
        let grouping = Grouping { mask, scores: Some(scores), ..Grouping::default() }.by(rule);
        Ok(match seeds.first() {
            Some(&first) => grouping.with("seed_index", first as f64),
            None => grouping,
        })
    }

    fn largest_clique(
        &self,
        source: &Points,
        target: &Points,
        tolerance: f64,
        order: &[usize],
        execution: &Execution,
    ) -> Result<Grouping> {
        let filter = SampleConsensus {
            iterations: self.iterations,
            tolerance,
            seed: self.seed,
            edge_ratio: None,
            confidence: None,
        };
        let pairs = ConsistentPairs::new(source, target, tolerance, execution)?;
        let mut taken = memory::filled(false, source.len())?;
        let mut largest: Vec<usize> = Vec::new();
        let mut clusters = 0;
        for (rank, &seed) in order.iter().enumerate() {
            execution.report(rank, order.len())?;
            if taken[seed] {
                continue;
            }
            let mut clique = pairs.grow_clique(seed, order, &taken)?;
            if clique.len() <= self.min_cluster_size {
                continue;
            }
            clusters += 1;
            clique.iter().for_each(|&i| taken[i] = true);
            // A set no larger than the best one cannot win after filtering.
            if clique.len() > largest.len() {
                clique.sort_unstable();
                let filtered = filter.consensus_among(&clique, source, target, execution)?;
                if filtered.len() > largest.len() {
                    largest = filtered;
                }
            }
        }
        let rule = Rule::bounded(Kind::GrownSet, self.min_cluster_size as f64)
            .agreeing(Agreement::difference(tolerance).or_equal());
        let mask = mask_of(source.len(), largest)?;
        Ok(Grouping::from_mask(mask).with("clusters", f64::from(clusters)).by(rule))
    }
}

/// The seed with the smallest distance difference to each, the lowest of equal ones; a seed's own is itself.
fn nearest_seeds(seeds: &[usize], source: &Points, target: &Points) -> Result<Vec<Option<usize>>> {
    let mut nearest = memory::filled((None, f64::INFINITY), source.len())?;
    for &seed in seeds {
        for (j, of) in nearest.iter_mut().enumerate() {
            let change = distance_difference(source.distance(seed, j), target.distance(seed, j));
            if change < of.1 || j == seed {
                *of = (Some(seed), if j == seed { 0.0 } else { change });
            }
        }
    }
    memory::collect(nearest.into_iter().map(|(seed, _)| seed))
}

/// Size of each star cluster, its seed included.
fn cluster_sizes(agreement: &DistanceAgreement, execution: &Execution) -> Result<Vec<u32>> {
    let mut sizes = agreement.counts(execution)?;
    sizes.iter_mut().for_each(|others| *others += 1);
    Ok(sizes)
}

/// Best descriptors first; in the input's order without similarities.
fn visiting_order(correspondences: &Correspondences) -> Result<Vec<usize>> {
    match correspondences.optional_similarity() {
        Some(similarity) => largest(similarity, similarity.len()),
        None => memory::collect(0..correspondences.len()),
    }
}

/// Consistency of pairs: `d(c_i, c_j)` is at most the tolerance.
enum ConsistentPairs<'a> {
    /// All pairs, one bit each.
    Kept(AgreementGraph),
    /// Computed on demand, if the bits need too much memory.
    Computed { source: &'a Points, target: &'a Points, tolerance: f64 },
}

impl<'a> ConsistentPairs<'a> {
    fn new(source: &'a Points, target: &'a Points, tolerance: f64, execution: &Execution) -> Result<Self> {
        if source.len() > AgreementGraph::most_vertices(execution.max_memory) {
            return Ok(Self::Computed { source, target, tolerance });
        }
        // At most the tolerance: less than the next greater number.
        let bound = tolerance.next_up();
        let graph = AgreementGraph::with_edges(source, target, bound, EdgeLengths::Any, execution)?;
        Ok(Self::Kept(graph))
    }

    /// Adds, in visiting order, correspondences that are not taken and are consistent with every member so
    /// far.
    fn grow_clique(&self, seed: usize, order: &[usize], taken: &[bool]) -> Result<Vec<usize>> {
        let mut clique = vec![seed];
        let free = order.iter().copied().filter(|&j| j != seed && !taken[j]);
        match self {
            Self::Kept(graph) => {
                let mut candidates = memory::copied(graph.row(seed))?;
                for j in free {
                    if candidates[j / 64] >> (j % 64) & 1 == 1 {
                        memory::push(&mut clique, j)?;
                        candidates.iter_mut().zip(graph.row(j)).for_each(|(word, row)| *word &= row);
                    }
                }
            }
            Self::Computed { source, target, tolerance } => {
                for j in free {
                    let fits = |&k: &usize| {
                        distance_difference(source.distance(j, k), target.distance(j, k)) <= *tolerance
                    };
                    if clique.iter().all(fits) {
                        memory::push(&mut clique, j)?;
                    }
                }
            }
        }
        Ok(clique)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Five points moved rigidly; point 5 agrees with point 0 alone; point 6 with none.
    fn problem() -> Result<Correspondences> {
        let source = [
            [0., 0., 0.],
            [4., 0., 0.],
            [0., 3., 0.],
            [0., 0., 5.],
            [3., 3., 3.],
            [2., 1., 0.5],
            [1., 1., 1.],
        ];
        let mut target = source.map(|p| [p[0] + 10.0, p[1], p[2]]);
        target[5] = [9.0, -2.0, -0.5];
        target[6] = [90.0, 9.0, 2.0];
        Correspondences::new(&source, &target)?.with_resolution(0.1)
    }

    #[test]
    fn star_of_the_best_seed() -> Result<()> {
        let group = GeometricConsistency::default().group(&problem()?, &Execution::default())?;
        assert_eq!(group.scores, Some(vec![6.0, 5.0, 5.0, 5.0, 5.0, 2.0, 1.0]));
        assert_eq!(group.mask, [true, true, true, true, true, true, false]);
        Ok(())
    }

    #[test]
    fn clique_excludes_points_that_agree_with_the_seed_alone() -> Result<()> {
        let method = GeometricConsistency { variant: Variant::Clique, ..GeometricConsistency::default() };
        let group = method.group(&problem()?, &Execution::default())?;
        assert_eq!(group.mask, [true, true, true, true, true, false, false]);
        Ok(())
    }

    #[test]
    fn ties_can_be_united() -> Result<()> {
        let source = [[0., 0., 0.], [1., 0., 0.], [50., 0., 0.], [50., 1., 0.]];
        let target = [[0., 0., 0.], [1., 0., 0.], [90., 0., 0.], [90., 1., 0.]];
        let input = Correspondences::new(&source, &target)?;
        for (ties, size) in [(Ties::Lowest, 2), (Ties::Union, 4)] {
            let method =
                GeometricConsistency { ties, tolerance: Some(0.1), ..GeometricConsistency::default() };
            assert_eq!(method.group(&input, &Execution::default())?.size(), size);
        }
        Ok(())
    }
}
