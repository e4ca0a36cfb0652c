//! Sample consensus: draws rigid hypotheses from three correspondences each, and selects the one with the
//! most inliers.

use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::Point3;
use rayon::prelude::*;

use super::counter_rng::sample_three;
use super::inlier_counter::{InlierCounter, is_inlier};
use crate::compatibility::distance::distance_ratio;
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::{Rigid, fit_triangle};
use crate::memory;
use crate::points::{Points, ZERO_LENGTH};

/// Hypotheses per task, and between two checks of the early stop.
const ITERATIONS_PER_TASK: usize = 256;

/// A sample is degenerate, and does not determine the rotation, if an edge of its triangle is below this
/// share of the bounding box's diagonal, or twice its area is below this share of the diagonal's square.
const DEGENERATE: f64 = 1e-9;

/// Parameters of sample consensus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SampleConsensus {
    /// Number of hypotheses.
    pub iterations: usize,
    /// An inlier's residual is less than this length.
    pub tolerance: f64,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Hypotheses with an edge of a lower distance ratio are skipped.
    pub edge_ratio: Option<f64>,
    /// Stop once the probability of having missed a better hypothesis is at most one minus this.
    pub confidence: Option<f64>,
}

/// The best hypothesis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Consensus {
    /// The transform between the centred points.
    pub model: Rigid,
    /// Number of inliers.
    pub inliers: usize,
    /// The iteration that drew it.
    pub iteration: usize,
    /// Number of iterations run.
    pub iterations: usize,
}

impl SampleConsensus {
    /// The hypothesis with the most inliers, ties to the earliest; `None` if none has an inlier.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn run(&self, source: &Points, target: &Points, execution: &Execution) -> Result<Option<Consensus>> {
        if source.len() < 3 {
            return Ok(None);
        }
        let counter = InlierCounter::new(source, target, self.tolerance)?;
        let most_inliers = AtomicUsize::new(0);
        let blocks = self.iterations.div_ceil(ITERATIONS_PER_TASK);
        execution.report(0, blocks)?;
        let run_block = |block: usize| {
            execution.advance()?;
            self.best_of_block(block, source, target, &counter, &most_inliers)
        };
        let Some(confidence) = self.confidence else {
            let best =
                (0..blocks).into_par_iter().map(run_block).try_reduce(|| None, |a, b| Ok(better(a, b)))?;
            return Ok(best.map(|found| Consensus { iterations: self.iterations, ..found }));
        };
        let mut best: Option<Consensus> = None;
        let mut spent = 0;
        for block in 0..blocks {
            best = better(best, run_block(block)?);
            spent = self.iterations.min((block + 1) * ITERATIONS_PER_TASK);

            if best.is_some_and(|found| spent as f64 >= needed(confidence, found.inliers, source.len())) {
                break;
            }
        }
        Ok(best.map(|found| Consensus { iterations: spent, ..found }))
    }

    /// The inliers, among `members`, of the best hypothesis drawn from them.
    ///
    /// # Errors
    /// [`crate::Error::Interrupted`], [`crate::Error::OutOfMemory`].
    pub fn consensus_among(
        &self,
        members: &[usize],
        source: &Points,
        target: &Points,
        execution: &Execution,
    ) -> Result<Vec<usize>> {
        let (source, target) = (source.subset(members)?, target.subset(members)?);
        let Some(best) = self.run(&source, &target, execution)? else {
            return Ok(Vec::new());
        };
        let inliers = self.inlier_mask(&best.model, &source, &target)?;
        memory::collect(members.iter().zip(inliers).filter(|&(_, inlier)| inlier).map(|(&i, _)| i))
    }

    /// Mask of the correspondences with a residual below the tolerance under the model.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn inlier_mask(&self, model: &Rigid, source: &Points, target: &Points) -> Result<Vec<bool>> {
        memory::collect((0..source.len()).map(|i| is_inlier(model, source, target, i, self.tolerance)))
    }

    /// The best of a block, unless all of its hypotheses have fewer inliers than `most_inliers`.
    fn best_of_block(
        &self,
        block: usize,
        source: &Points,
        target: &Points,
        counter: &InlierCounter,
        most_inliers: &AtomicUsize,
    ) -> Result<Option<Consensus>> {
        let iterations = block * ITERATIONS_PER_TASK..self.iterations.min((block + 1) * ITERATIONS_PER_TASK);
        let mut near = Vec::new();
        let mut best = None;
        for iteration in iterations {
            let sample = sample_three(self.seed, iteration as u64, source.len());
            let Some(model) = self.hypothesis(sample, source, target) else { continue };
            // Fewer inliers than another hypothesis cannot win; as many can, if it is the earliest.
            let least = most_inliers.load(Ordering::Relaxed);
            let Some(inliers) = counter.count(&model, least, &mut near)? else { continue };
            most_inliers.fetch_max(inliers, Ordering::Relaxed);
            best = better(best, Some(Consensus { model, inliers, iteration, iterations: 0 }));
        }
        Ok(best)
    }

    fn hypothesis(&self, sample: [usize; 3], source: &Points, target: &Points) -> Option<Rigid> {
        let p = sample.map(|i| source.get(i));
        let q = sample.map(|i| target.get(i));
        if is_degenerate(&p, source.diagonal()) || is_degenerate(&q, target.diagonal()) {
            return None;
        }
        if let Some(least) = self.edge_ratio {
            let ratio =
                |a: usize, b: usize| distance_ratio((p[a] - p[b]).norm(), (q[a] - q[b]).norm(), 0.0, 0.0);
            if ratio(0, 1) < least || ratio(1, 2) < least || ratio(0, 2) < least {
                return None;
            }
        }
        Some(fit_triangle(&p, &q))
    }
}

/// Number of iterations after which the probability of having missed a better model is below
/// `1 - confidence`.
fn needed(confidence: f64, inliers: usize, n: usize) -> f64 {
    let share = inliers as f64 / n as f64;
    if share >= 1.0 {
        return 0.0;
    }
    // ln(1 - x) that is still below 0 if 1 - x rounds to 1.
    (-confidence).ln_1p() / (-share.powi(3)).ln_1p()
}

fn better(a: Option<Consensus>, b: Option<Consensus>) -> Option<Consensus> {
    let (Some(first), Some(second)) = (a, b) else {
        return a.or(b).filter(|found| found.inliers > 0);
    };
    let second_wins = second.inliers > first.inliers
        || (second.inliers == first.inliers && second.iteration < first.iteration);
    Some(if second_wins { second } else { first }).filter(|found| found.inliers > 0)
}

fn is_degenerate(triangle: &[Point3<f64>; 3], diagonal: f64) -> bool {
    let [a, b, c] = triangle;
    let (ab, ac, bc) = (b - a, c - a, c - b);
    let (shortest, longest) =
        (ab.norm().min(ac.norm()).min(bc.norm()), ab.norm().max(ac.norm()).max(bc.norm()));
    longest <= ZERO_LENGTH * diagonal
        || shortest <= DEGENERATE * longest
        || ab.cross(&ac).norm() <= DEGENERATE * longest * longest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recovers_a_translation_among_outliers() -> Result<()> {
        let source: Vec<[f64; 3]> =
            (0..20).map(|i| [f64::from(i), f64::from(i * i % 7), f64::from(i * 3 % 5)]).collect();
        let target: Vec<[f64; 3]> = source
            .iter()
            .enumerate()
            .map(|(i, p)| if i < 12 { [p[0] + 5.0, p[1], p[2]] } else { [p[2] * 9.0, p[0], -p[1]] })
            .collect();
        let (source, target) = (Points::from_rows("source", &source)?, Points::from_rows("target", &target)?);
        let engine =
            SampleConsensus { iterations: 500, tolerance: 0.1, seed: 0, edge_ratio: None, confidence: None };
        let found = engine.run(&source, &target, &Execution::default())?;
        assert_eq!(found.map(|best| best.inliers), Some(12));
        let early = SampleConsensus { confidence: Some(0.99), ..engine };
        let found = early.run(&source, &target, &Execution::default())?;
        assert!(found.is_some_and(|best| best.inliers == 12 && best.iterations == 256));
        Ok(())
    }
}
