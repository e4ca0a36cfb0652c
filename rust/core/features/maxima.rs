//! Non-maximum suppression: keypoints are the maxima of a score within a radius.

use rayon::prelude::*;

use crate::cloud::Cloud;
use crate::error::{Result, at_least_one, positive};
use crate::execution::Execution;
use crate::geometry::ball_search::BallSearch;
use crate::memory;
use crate::points::Points;

/// Bisection steps of the radius if a number of keypoints is requested.
const BISECTIONS: usize = 24;
/// Queries per task.
const QUERIES_PER_TASK: usize = 128;

/// Rule of the suppression.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suppression {
    /// A point is compared with all others nearer than this, in the unit of the data.
    pub radius: f64,
    /// Points with fewer neighbours in that radius, themselves included, are dropped.
    pub min_neighbors: usize,
    /// Keep only the lowest index of equal scores; otherwise keep all, as PCL.
    pub break_ties: bool,
}

/// Ascending indices of the candidates with the greatest score within the radius.
///
/// Candidates are the points whose score is not NaN and satisfies `is_candidate`.
///
/// # Errors
/// [`crate::Error::InvalidInput`] for a radius that is not positive; [`crate::Error::Interrupted`].
pub fn local_maxima(
    cloud: &Cloud,
    scores: &[f64],
    is_candidate: impl Fn(f64) -> bool,
    rule: &Suppression,
    execution: &Execution,
) -> Result<Vec<usize>> {
    let search = cloud.unordered_balls(rule.radius)?;
    let maxima = unbeaten(&search, scores, &candidates(scores, is_candidate)?, rule.break_ties, execution)?;
    supported(cloud.points(), &search, &maxima, rule.min_neighbors, execution)
}

/// About `count` maxima: bisects the radius, starting from the rule's, and keeps the closest count (of
/// equally close ones the smaller radius).
///
/// # Errors
/// As [`local_maxima`]; [`crate::Error::InvalidInput`] for a count of 0.
pub fn maxima_of_about(
    count: usize,
    cloud: &Cloud,
    scores: &[f64],
    is_candidate: impl Fn(f64) -> bool,
    rule: &Suppression,
    execution: &Execution,
) -> Result<Vec<usize>> {
    at_least_one("count", count)?;
    let points = cloud.points();
    let mut radius = rule.radius;
    let mut search = cloud.unordered_balls(radius)?;
    let mut among = candidates(scores, is_candidate)?;
    let mut best: Vec<usize> = Vec::new();
    let (mut low, mut high) = (0.0, f64::INFINITY);
    for _ in 0..BISECTIONS {
        // Not cached by the cloud: no other step uses the radii tried here.
        search =
            if search.serves(radius) { search.narrowed(radius) } else { BallSearch::new(points, radius)? };
        let maxima = unbeaten(&search, scores, &among, rule.break_ties, execution)?;
        let found = supported(points, &search, &maxima, rule.min_neighbors, execution)?;
        let (gap, is_dense) = (found.len().abs_diff(count), found.len() > count);
        if best.is_empty() || gap < best.len().abs_diff(count) {
            best = found;
        }
        if gap == 0 {
            break;
        }
        if is_dense {
            low = radius;
            // A point suppressed within this radius is suppressed within the larger ones, and only these
            // follow.
            among = members(&maxima, points.len())?;
        } else {
            high = radius;
        }
        radius = next_radius(low, high);
        if positive("nms_radius", radius).is_err() || radius > 2.0 * points.diagonal() {
            break;
        }
    }
    Ok(best)
}

/// Mask of the points that have a score and satisfy the test.
fn candidates(scores: &[f64], is_candidate: impl Fn(f64) -> bool) -> Result<Vec<bool>> {
    memory::collect(scores.iter().map(|&score| !score.is_nan() && is_candidate(score)))
}

/// Mask of the listed indices among `len` points.
fn members(indices: &[usize], len: usize) -> Result<Vec<bool>> {
    let mut mask = memory::filled(false, len)?;
    for &index in indices {
        mask[index] = true;
    }
    Ok(mask)
}

/// Ascending indices of the points in `among` that no point within the search's radius exceeds.
fn unbeaten(
    search: &BallSearch,
    scores: &[f64],
    among: &[bool],
    break_ties: bool,
    execution: &Execution,
) -> Result<Vec<usize>> {
    let sorted = search.reorder(scores)?;
    let beats = |rival: u32, position: u32| {
        let (score, own) = (sorted[rival as usize], sorted[position as usize]);
        score > own || (break_ties && score >= own && search.index(rival) < search.index(position))
    };
    let all = 0..search.len() as u32;
    let positions = memory::collect(all.filter(|&position| among[search.index(position) as usize]))?;
    let mut is_kept = memory::filled(false, positions.len())?;
    let tasks = is_kept.par_chunks_mut(QUERIES_PER_TASK).zip(positions.par_chunks(QUERIES_PER_TASK));
    tasks.try_for_each(|(is_kept, positions)| {
        execution.check()?;
        for (is_kept, &position) in is_kept.iter_mut().zip(positions) {
            *is_kept = !search.any_near(position, |rival| beats(rival, position));
        }
        Ok(())
    })?;
    let kept = positions.iter().zip(is_kept).filter(|&(_, is_kept)| is_kept);
    let mut indices = memory::collect(kept.map(|(&position, _)| search.index(position) as usize))?;
    indices.sort_unstable();
    Ok(indices)
}

/// The points of `indices` with at least `least` neighbours within the search's radius.
fn supported(
    points: &Points,
    search: &BallSearch,
    indices: &[usize],
    min_neighbors: usize,
    execution: &Execution,
) -> Result<Vec<usize>> {
    if min_neighbors <= 1 {
        return memory::copied(indices);
    }
    let centers = memory::collect(indices.iter().map(|&index| points.get(index)))?;
    let counts = search.map_at(&centers, 0, execution, |_, ball| Ok(ball.len()))?;
    memory::collect(indices.iter().zip(counts).filter(|&(_, count)| count >= min_neighbors).map(|(&i, _)| i))
}

/// Geometric mean of the brackets; twice the lower one if there is no upper one.
fn next_radius(low: f64, high: f64) -> f64 {
    if high.is_infinite() {
        return 2.0 * low;
    }
    if low == 0.0 { 0.5 * high } else { (low * high).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(count: i32) -> Result<Cloud> {
        let rows: Vec<[f64; 3]> = (0..count).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        Cloud::from_rows("points", &rows)
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
    fn bisects_to_a_count() -> Result<()> {
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
    fn bisection_equals_a_search_for_each_radius() -> Result<()> {
        let rows: Vec<[f64; 3]> =
            (0..2000).map(|i| [1.1, 2.3, 3.7].map(|f| (f64::from(i) * f).sin())).collect();
        let scores: Vec<f64> = (0..2000).map(|i| f64::from(i * i % 401)).collect();
        let execution = Execution::default();
        let cloud = Cloud::from_rows("points", &rows)?;
        for min_neighbors in [1, 4] {
            let rule = Suppression { min_neighbors, ..rule(0.1) };
            let found = maxima_of_about(60, &cloud, &scores, |_| true, &rule, &execution)?;
            // The same bisection, with all points and a new search for every radius.
            let (mut radius, mut low, mut high) = (rule.radius, 0.0, f64::INFINITY);
            let mut best: Vec<usize> = Vec::new();
            for _ in 0..BISECTIONS {
                let alone = Cloud::from_rows("points", &rows)?;
                let rule = Suppression { radius, ..rule };
                let all = local_maxima(&alone, &scores, |_| true, &rule, &execution)?;
                if best.is_empty() || all.len().abs_diff(60) < best.len().abs_diff(60) {
                    best.clone_from(&all);
                }
                if all.len() == 60 {
                    break;
                }
                (low, high) = if all.len() > 60 { (radius, high) } else { (low, radius) };
                radius = next_radius(low, high);
            }
            assert_eq!(found, best);
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
