//! The number of false alarms of a pose within smaller radii than the group's: few matches with an exact fit
//! are significant.
//!
//! Supporters must lie as far apart as within the group's radius. The chance level is the greatest of four
//! numbers of targets near a source point under the pose: other matches within the radius; those within the
//! group's radius, times the ratio of areas; all matches spread evenly over the area spanned by the
//! supporters; all matches times the squared share of distances that agree with the distance of another pair,
//! which is large on grids. Each radius tried is one more chance of a false alarm.

use super::confidence::APART;
use super::{DEVIATION, GROUP, Problem};
use crate::consensus::false_alarms::{Independent, independent, precise_false_alarms};
use crate::consensus::landing::landings;
use crate::consensus::likelihood::Likelihood;
use crate::geometry::rigid::Rigid;
use crate::{Points, Result, memory};

/// Radii tried, each half of the previous one, and iterations of refinement within each.
const RADII: u32 = 11;
const ROUNDS: usize = 3;

/// Fewer supporters fit by chance: three determine a pose.
const LEAST_SUPPORTERS: usize = 4;

/// Half the width, in standard deviations, of points spread evenly over a disc.
const EDGE: f64 = 2.0;

/// Points whose distances are compared.
const COMPARED: usize = 64;
const COINCIDENCE: usize = 2;

/// Least number over all radii, times the number of radii.
pub fn false_alarms(problem: &Problem<'_>, likelihood: &Likelihood, pose: &Rigid) -> Result<f64> {
    let Problem { source, target, tolerance, execution, .. } = *problem;
    let n = likelihood.len() as f64;
    let [starts, ends] = [distances(source)?, distances(target)?];
    let (mut pose, mut crowd, mut least) = (*pose, None, f64::INFINITY);
    for halvings in 0..RADII {
        execution.check()?;
        let share_of_radius = 0.5_f64.powi(halvings as i32);
        let radius = problem.group_radius() * share_of_radius;
        pose = likelihood.refined(&pose, std::iter::repeat_n(radius * DEVIATION / GROUP, ROUNDS))?;
        let squares = likelihood.squared_residuals(&pose)?;
        let supporters = memory::collect((0..squares.len()).filter(|&i| squares[i] <= radius * radius))?;
        let Independent { count, share } =
            independent(source, target, &squares, &supporters, APART * tolerance)?;
        if count < LEAST_SUPPORTERS {
            break;
        }
        let landed = landings(&[pose], source, target, radius, execution)?;
        let near = landed.first().map_or(0.0, |landing| landing.chance) - supporters.len() as f64 / n;
        let crowd = *crowd.get_or_insert(near) * share_of_radius.powi(2);
        let [first, second, _] =
            problem.variances(&supporters).map(|variance| (radius / (EDGE * variance.sqrt())).min(1.0));
        let chance =
            near.max(crowd).max(n * first * second).max(n * agreeing(&starts, &ends, radius)?.powi(2));
        least = least.min(precise_false_alarms(squares.len(), count, chance * share));
    }
    Ok(least * f64::from(RADII))
}

/// The pairwise distances between points evenly spread over the input.
fn distances(points: &Points) -> Result<Vec<f64>> {
    let (n, count) = (points.len(), points.len().min(COMPARED));
    let row = |k: usize| points.get(k * n / count);
    let pairs = (0..count).flat_map(|a| (0..a).map(move |b| (a, b)));
    memory::collect(pairs.map(|(a, b)| (row(a) - row(b)).norm()))
}

/// Share of the distances of different pairs on both sides that agree within a length; a single coincidence,
/// counted in both orders, is subtracted.
fn agreeing(starts: &[f64], ends: &[f64], length: f64) -> Result<f64> {
    let own = starts.iter().zip(ends).filter(|&(start, end)| (start - end).abs() <= length).count();
    let mut sorted = memory::copied(ends)?;
    sorted.sort_unstable_by(f64::total_cmp);
    let below = |limit: f64| sorted.partition_point(|&end| end < limit);
    let within = |&start: &f64| below((start + length).next_up()) - below(start - length);
    let all = starts.iter().map(within).sum::<usize>();
    let others = starts.len() * starts.len().saturating_sub(1);
    Ok(all.saturating_sub(own + COINCIDENCE) as f64 / others.max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_of_other_pairs_agree_on_a_square_alone() -> Result<()> {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let other = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 1.0, 0.0], [0.0, 7.0, 0.0]];
        for (rows, share) in [(square, 12.0 / 30.0), (other, 0.0)] {
            let lengths = distances(&Points::from_rows("points", &rows)?)?;
            assert!((agreeing(&lengths, &lengths, 0.1)? - share).abs() < 1e-12);
        }
        Ok(())
    }
}
