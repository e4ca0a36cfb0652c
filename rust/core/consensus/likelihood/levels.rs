//! Prior probability and weight of each correspondence, independent of any pose.

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::ball_search::BallSearch;
use crate::memory;
use crate::points::Points;

/// Prior share of correct correspondences: one in a hundred, but at least ten.
const RIGHT_SHARE: f64 = 0.01;
const RIGHT_COUNT: f64 = 10.0;

/// Log-likelihood ratio as a function of a match's ratio: slope, zero, minimum and maximum.
const RATIO_SLOPE: f64 = 8.0;
const RATIO_EVEN: f64 = 0.87;
const RATIO_TERM: (f64, f64) = (-0.8, 3.0);

/// The level of each correspondence: `ln(share) + ln(n / D_i)` and the term of its ratio. `D_i` is the number
/// of correspondences that start or end within `radius` of it, weighted by proximity.
///
/// # Errors
/// [`crate::Error::InvalidInput`] unless the radius is positive; [`crate::Error::Interrupted`],
/// [`crate::Error::OutOfMemory`].
pub fn levels(
    source: &Points,
    target: &Points,
    ratio: Option<&[f64]>,
    radius: f64,
    execution: &Execution,
) -> Result<Vec<f64>> {
    let n = source.len() as f64;
    let share = RIGHT_SHARE.max(RIGHT_COUNT / n);
    let (starts, ends) = (density(source, radius, execution)?, density(target, radius, execution)?);
    let level = |i: usize| {
        let term = ratio
            .map_or(0.0, |ratio| (RATIO_SLOPE * (RATIO_EVEN - ratio[i])).clamp(RATIO_TERM.0, RATIO_TERM.1));
        (share * n / starts[i].max(ends[i])).ln() + term
    };
    memory::collect((0..source.len()).map(level))
}

/// `sum over k of max(0, 1 - d_ik^2 / radius^2)` at each point.
pub(crate) fn density(points: &Points, radius: f64, execution: &Execution) -> Result<Vec<f64>> {
    let limit = radius * radius;
    BallSearch::new(points, radius)?.map_points(execution, |_, ball| {
        ball.squared_distances().iter().map(|square| 1.0 - square / limit).sum()
    })
}

/// Number of correspondences, itself included, within `radius` of each at both ends that keep their distance
/// to it within `tolerance`: they are correct or wrong together.
///
/// # Errors
/// As for [`levels`].
pub fn cluster_sizes(
    source: &Points,
    target: &Points,
    radius: f64,
    tolerance: f64,
    execution: &Execution,
) -> Result<Vec<f64>> {
    let search = BallSearch::new(source, radius)?;
    let limit = radius * radius;
    let partners = search.reorder(&memory::collect((0..target.len()).map(|j| target.get(j)))?)?;
    search.map_points(execution, |position, ball| {
        let center = partners[position as usize];
        let near = ball.positions().iter().zip(ball.squared_distances()).filter(|&(&place, square)| {
            let other = (partners[place as usize] - center).norm_squared();
            other < limit && (other.sqrt() - square.sqrt()).abs() < tolerance
        });
        near.count().max(1) as f64
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_of_distant_and_of_coincident_points() -> Result<()> {
        let far: Vec<[f64; 3]> = (0..2000).map(|i| [10.0 * f64::from(i), 0.0, 0.0]).collect();
        let far = Points::from_rows("source", &far)?;
        let close = Points::from_rows("target", &vec![[1.0; 3]; 2000])?;
        let execution = Execution::default();
        let alone = levels(&far, &far, None, 5.0, &execution)?;
        assert!(alone.iter().all(|level| (level - 20.0_f64.ln()).abs() < 1e-12));
        let crowded = levels(&far, &close, None, 5.0, &execution)?;
        assert!(crowded.iter().all(|level| (level - 0.01_f64.ln()).abs() < 1e-12));
        let ratio = [0.0, 0.87, 0.9, 1.0].repeat(500);
        let told = levels(&far, &far, Some(&ratio), 5.0, &execution)?;
        for (level, term) in told.iter().zip([3.0, 0.0, -0.24, -0.8]) {
            assert!((level - alone[0] - term).abs() < 1e-12);
        }
        Ok(())
    }
}
