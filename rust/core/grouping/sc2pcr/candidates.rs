//! SC2-PCR++'s selection among poses, by alternative target points of the source points.
//!
//! Chen, Sun, Yang, Guo, Tao, *SC^2-PCR++: Rethinking the Generation and Selection for Efficient and Robust
//! Point Cloud Registration*, TPAMI 2023. Each of the poses with the most inliers is refined by one
//! iteration. If it moves a source point near one of its candidates, the first candidate that is not far is
//! its match. The score of the pose is the greatest number of these pairs that agree in distance with one of
//! them.

use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::Point3;
use rayon::prelude::*;

use crate::compatibility::agreement::DistanceAgreement;
use crate::compatibility::graph::EdgeLengths;
use crate::compatibility::long_agreement::LongAgreement;
use crate::consensus::choice::count_inliers;
use crate::consensus::reweighting::reweighted;
use crate::geometry::rigid::Rigid;
use crate::selection::top_k::largest;
use crate::{Execution, Points, Result, memory};

/// Number of poses scored, those with the most inliers.
const MOST_POSES: usize = 50;

/// Matches are nearer than this many tolerances.
const NOT_FAR: f64 = 1.5;

/// Source points, and the same number of candidate target points for each, the likeliest first.
pub(super) struct Candidates<'a> {
    pub(super) source: &'a Points,
    pub(super) target: &'a Points,
    pub(super) points: &'a Points,
    pub(super) tolerance: f64,
    /// Bound on `|ds - dt|` of two pairs.
    pub(super) max_distance_difference: f64,
}

impl Candidates<'_> {
    /// The best pose, refined by one iteration; the first of equal ones, `None` if none moves a point near a
    /// candidate.
    pub(super) fn best_pose(&self, poses: &[Rigid], execution: &Execution) -> Result<Option<Rigid>> {
        let counts = count_inliers(poses, self.source, self.target, self.tolerance, execution)?;
        let ranked = largest(&memory::collect(counts.iter().map(|&count| count as f64))?, MOST_POSES)?;
        let refined = ranked
            .into_iter()
            .filter(|&k| counts[k] > 0)
            .map(|k| reweighted(&poses[k], self.source, self.target, self.tolerance, 1));
        let refined = memory::try_collect(refined)?;
        let greatest = AtomicUsize::new(0);
        let scores = refined.par_iter().map(|pose| self.score(pose, &greatest, execution));
        let scores = memory::par_try_collect(scores)?;
        let most = scores.iter().copied().max().unwrap_or_default();
        let best = scores.iter().position(|&score| most > 0 && score == most);
        Ok(best.map(|best| refined[best]))
    }

    /// The greatest number of pairs, itself included, that agree in distance with one of them; 0 if
    /// `greatest`, the score of another pose, exceeds the number of pairs.
    fn score(&self, pose: &Rigid, greatest: &AtomicUsize, execution: &Execution) -> Result<usize> {
        let (mut rows, mut partners) = (Vec::new(), Vec::new());
        for i in 0..self.source.len() {
            if let Some(partner) = self.partner(i, pose) {
                memory::push(&mut rows, i)?;
                memory::push(&mut partners, partner)?;
            }
        }
        if rows.len() < greatest.load(Ordering::Relaxed) {
            return Ok(0);
        }
        let (p, q) = (self.source.subset(&rows)?, self.points.subset(&partners)?);
        let agreement = DistanceAgreement::new(&p, &q, self.max_distance_difference)?;
        let agreement = LongAgreement::new(agreement, EdgeLengths::Any);
        let mut row = memory::filled(0, rows.len().div_ceil(u64::BITS as usize))?;
        let mut unsure = memory::copied(&row)?;
        let mut most = 0;
        for i in 0..rows.len() {
            execution.check()?;
            agreement.fill_row(i, &mut row, &mut unsure);
            most = most.max(row.iter().map(|word| word.count_ones() as usize).sum());
        }
        greatest.fetch_max(most, Ordering::Relaxed);
        Ok(most)
    }

    /// The first candidate of a source point that is not far from the moved point, if any candidate is near.
    fn partner(&self, i: usize, pose: &Rigid) -> Option<usize> {
        // The candidates are centred separately.
        let shift = self.target.center() - self.points.center();
        let place: Point3<f64> = pose.apply(&self.source.get(i)) + shift;
        let each = self.points.len() / self.source.len();
        let own = i * each..(i + 1) * each;
        let within = |factor: f64| {
            let square = (factor * self.tolerance).powi(2);
            own.clone().find(|&k| (self.points.get(k) - place).norm_squared() < square)
        };
        within(1.0).and_then(|_| within(NOT_FAR))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::rigid::fit_rigid;

    #[test]
    fn matches_are_the_first_candidates_that_are_not_far() -> Result<()> {
        let rows = |y: [f64; 4]| y.map(|y| [y, y * y, 0.0]).to_vec();
        let source = Points::from_rows("source", &rows([0.0, 3.0, 5.0, 9.0]))?;
        let points: Vec<[f64; 3]> = rows([0.0, 3.0, 5.0, 9.0])
            .into_iter()
            .flat_map(|[x, y, z]| [[x, y, z + 1.2], [x, y, z + 0.5], [x + 99.0, y, z]])
            .collect();
        let points = Points::from_rows("candidates", &points)?;
        let mut candidates = Candidates {
            source: &source,
            target: &source,
            points: &points,
            tolerance: 1.0,
            max_distance_difference: 0.1,
        };
        let all: Vec<_> = (0..4).map(|i| source.get(i)).collect();
        let stay = fit_rigid(&all, &all);
        assert_eq!((0..4).map(|i| candidates.partner(i, &stay)).collect::<Vec<_>>(), [0, 3, 6, 9].map(Some));
        assert_eq!(candidates.score(&stay, &AtomicUsize::new(0), &Execution::default())?, 4);
        assert_eq!(candidates.score(&stay, &AtomicUsize::new(5), &Execution::default())?, 0);
        candidates.tolerance = 0.4;
        assert_eq!(candidates.partner(1, &stay), None);
        Ok(())
    }
}
