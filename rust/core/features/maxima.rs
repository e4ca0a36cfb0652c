//! Non-maximum suppression: keypoints are where a score is greatest within a radius.

use rayon::prelude::*;

use crate::error::{Result, at_least_one, positive};
use crate::execution::Execution;
use crate::geometry::ball_search::{Ball, BallSearch};
use crate::points::Points;

/// Halvings of the radius' bracket when a number of keypoints is asked for.
const BISECTIONS: usize = 24;
/// Queries that one task takes.
const QUERIES_PER_TASK: usize = 128;

/// Which points survive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suppression {
    /// A point is compared with all others nearer than this, in the unit of the data.
    pub radius: f64,
    /// Points with fewer neighbours in that radius, themselves included, are dropped.
    pub min_neighbors: usize,
    /// Of equal scores only the lowest index survives; otherwise all of them do, as in PCL.
    pub break_ties: bool,
}

/// Ascending indices of the candidates that no point within the radius exceeds.
///
/// Candidates are the points whose score is not NaN and satisfies `is_candidate`.
///
/// # Errors
/// [`crate::Error::InvalidInput`] for a radius that is not positive; [`crate::Error::Interrupted`].
pub fn local_maxima(
    points: &Points,
    scores: &[f64],
    is_candidate: impl Fn(f64) -> bool + Sync,
    rule: &Suppression,
    execution: &Execution,
) -> Result<Vec<usize>> {
    let search = BallSearch::new(points, rule.radius)?;
    let sorted = search.reorder(scores);
    let beats = |rival: u32, position: u32| {
        let (score, own) = (sorted[rival as usize], sorted[position as usize]);
        score > own || (rule.break_ties && score >= own && search.index(rival) < search.index(position))
    };
    let is_maximum = |ball: &mut Ball, position: u32| {
        let own = sorted[position as usize];
        if own.is_nan() || !is_candidate(own) || search.any_near(position, |rival| beats(rival, position)) {
            return false;
        }
        if rule.min_neighbors > 1 {
            search.within(&points.get(search.index(position) as usize), ball);
        }
        rule.min_neighbors <= 1 || ball.len() >= rule.min_neighbors
    };
    let positions: Vec<u32> = (0..points.len() as u32).collect();
    let survivors = positions
        .par_chunks(QUERIES_PER_TASK)
        .map_init(Ball::default, |ball, chunk| {
            execution.check()?;
            let kept = chunk.iter().filter(|&&position| is_maximum(ball, position));
            Ok(kept.map(|&position| search.index(position) as usize).collect())
        })
        .collect::<Result<Vec<Vec<usize>>>>()?;
    let mut indices = survivors.concat();
    indices.sort_unstable();
    Ok(indices)
}

/// About `count` maxima: bisects the radius, starting from the rule's, and keeps the closest count (of
/// equally close ones the smaller radius).
///
/// # Errors
/// As [`local_maxima`]; [`crate::Error::InvalidInput`] for a count of 0.
pub fn maxima_of_about(
    count: usize,
    points: &Points,
    scores: &[f64],
    is_candidate: impl Fn(f64) -> bool + Sync,
    rule: &Suppression,
    execution: &Execution,
) -> Result<Vec<usize>> {
    at_least_one("count", count)?;
    let mut rule = *rule;
    let mut best: Vec<usize> = Vec::new();
    let (mut low, mut high) = (0.0, f64::INFINITY);
    for _ in 0..BISECTIONS {
        let found = local_maxima(points, scores, &is_candidate, &rule, execution)?;
        let (gap, is_dense) = (found.len().abs_diff(count), found.len() > count);
        if best.is_empty() || gap < best.len().abs_diff(count) {
            best = found;
        }
        if gap == 0 {
            break;
        }
        if is_dense {
            low = rule.radius;
        } else {
            high = rule.radius;
        }
        rule.radius = next_radius(low, high);
        if positive("nms_radius", rule.radius).is_err() || rule.radius > 2.0 * points.diagonal() {
            break;
        }
    }
    Ok(best)
}

/// Between the brackets in the geometric mean; without an upper one, twice the lower.
fn next_radius(low: f64, high: f64) -> f64 {
    if high.is_infinite() {
        return 2.0 * low;
    }
    if low == 0.0 { 0.5 * high } else { (low * high).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(count: i32) -> Result<Points> {
        let rows: Vec<[f64; 3]> = (0..count).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        Points::from_rows("points", &rows)
    }

    fn rule(radius: f64) -> Suppression {
        Suppression { radius, min_neighbors: 1, break_ties: false }
    }

    #[test]
    fn keeps_maxima_and_ties() -> Result<()> {
        let scores = [1.0, 3.0, 3.0, f64::NAN, 2.0, 0.0];
        let run = |rule| local_maxima(&row(6)?, &scores, |s| s > 0.5, &rule, &Execution::default());
        assert_eq!(run(rule(1.5))?, [1, 2, 4]);
        assert_eq!(run(Suppression { break_ties: true, ..rule(1.5) })?, [1, 4]);
        assert_eq!(run(Suppression { min_neighbors: 4, ..rule(2.5) })?, [1, 2]);
        assert_eq!(run(rule(9.0))?, [1, 2]);
        Ok(())
    }

    #[test]
    fn bisects_to_a_number() -> Result<()> {
        let points = row(400)?;
        let scores: Vec<f64> = (0..400).map(|i| f64::from(i * i * 31 % 409)).collect();
        for count in [5, 20, 60] {
            let found =
                maxima_of_about(count, &points, &scores, |_| true, &rule(3.0), &Execution::default())?;
            assert!(found.len().abs_diff(count) <= 1 + count / 10, "{count}: {}", found.len());
        }
        Ok(())
    }

    #[test]
    fn bad_options_are_errors() -> Result<()> {
        let points = row(3)?;
        assert!(matches!(
            local_maxima(&points, &[0.0; 3], |_| true, &rule(0.0), &Execution::default()),
            Err(crate::Error::InvalidInput { .. })
        ));
        assert!(maxima_of_about(0, &points, &[0.0; 3], |_| true, &rule(1.0), &Execution::default()).is_err());
        Ok(())
    }
}
