//! Confidence of each correspondence, and the seeds of the consensus sets.

use rayon::prelude::*;

use crate::compatibility::matrix::{PairMatrix, PairScore};
use crate::geometry::ball_search::BallSearch;
use crate::selection::top_k::largest;
use crate::simd::sums::dot;
use crate::{Execution, Points, Result, memory};

/// Power steps from equal entries: the published number.
pub(super) const POWER_STEPS: usize = 10;

/// Confidences are compared in units of this share of the greatest one: sums have no more digits, so equal
/// ones tie.
const TIE: f64 = 1e-9;

/// The principal eigenvector of the soft compatibility, of unit length.
pub(super) fn confidence(
    source: &Points,
    target: &Points,
    max_distance_difference: f64,
    execution: &Execution,
) -> Result<Vec<f64>> {
    let n = source.len();
    let score = PairScore::SquaredDistanceDifference { tolerance: max_distance_difference };
    let soft = PairMatrix::new(source, target, score, Some(memory::filled(1.0, n)?), execution)?;
    let mut vector = memory::filled(1.0, n)?;
    for step in 0..POWER_STEPS {
        execution.report(step, 2 * POWER_STEPS)?;
        vector = soft.multiply_rounded(&vector, execution)?;
        let length = dot(&vector, &vector).sqrt(); // at least 1, by the diagonal
        vector.iter_mut().for_each(|entry| *entry /= length);
    }
    Ok(vector)
}

/// The `most` seeds: first those without a more confident one nearer than `radius` in the source, then the
/// others, each by confidence; ties to the lowest index.
pub(super) fn seeds(
    source: &Points,
    confidence: &[f64],
    radius: f64,
    most: usize,
    execution: &Execution,
) -> Result<Vec<usize>> {
    let greatest = confidence.iter().copied().fold(0.0, f64::max);
    let rounded = memory::collect(confidence.iter().map(|value| (value / (TIE * greatest)).round()))?;
    let search = BallSearch::new(source, radius)?;
    let sorted = search.reorder(&rounded)?;
    let is_greatest = |position: u32| {
        execution.check()?;
        let own = sorted[position as usize];
        Ok(!search.any_near(position, |other| sorted[other as usize] > own))
    };
    let positions = (0..source.len() as u32).into_par_iter().with_min_len(64);
    let maxima = memory::par_try_collect(positions.map(is_greatest))?;
    let above_all = 2.0 / TIE; // of the rounded ones
    let mut ranks = rounded;
    for (&i, maximum) in search.order().iter().zip(maxima) {
        ranks[i as usize] += if maximum { above_all } else { 0.0 };
    }
    largest(&ranks, most.min(source.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agreeing_correspondences_are_the_most_confident() -> Result<()> {
        let place = |i: usize, k: f64| [1.1, 2.3, 3.7].map(|f| 10.0 * (i as f64 * f * k + k).sin());
        let source: Vec<[f64; 3]> = (0..60).map(|i| place(i, 1.0)).collect();
        let target: Vec<[f64; 3]> =
            (0..60).map(|i| if i < 30 { place(i, 1.0) } else { place(i, 0.7) }).collect();
        let (source, target) = (Points::from_rows("source", &source)?, Points::from_rows("target", &target)?);
        let confidence = confidence(&source, &target, 0.5, &Execution::default())?;
        let least = confidence[..30].iter().copied().fold(1.0, f64::min);
        assert!(confidence[30..].iter().all(|&other| other < 0.5 * least));
        assert!((dot(&confidence, &confidence) - 1.0).abs() < 1e-12);
        Ok(())
    }

    #[test]
    fn local_maxima_come_first() -> Result<()> {
        let places = [0.0, 1.0, 2.0, 10.0, 11.0, 20.0];
        let source = Points::from_rows("source", &places.map(|x| [x, 0.0, 0.0]))?;
        let confidence = [0.9, 0.8, 0.85, 0.1, 0.2, 0.2];
        let found = |most| seeds(&source, &confidence, 1.5, most, &Execution::default());
        assert_eq!(found(9)?, [0, 2, 4, 5, 1, 3]);
        assert_eq!(found(3)?, [0, 2, 4]);
        Ok(())
    }
}
