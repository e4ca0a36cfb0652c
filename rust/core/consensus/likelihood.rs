//! How much likelier correspondences are under a pose than by chance.
//!
//! A wrong match ends near a given place as often as others do; a right one ends where the pose lays it, up to noise.
//! The logarithm of the ratio of both, cut off at 0, adds up to the score of the pose.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]
#![expect(clippy::needless_bitwise_bool, reason = "without branches all lanes are computed at once")]

use nalgebra::Point3;

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::ball_search::BallSearch;
use crate::geometry::rigid::{Rigid, fit_weighted, fixes_rotation};
use crate::points::Points;
use crate::simd::{self, DOUBLES};

/// Share of correspondences that is right where nothing is known: one in a hundred, but ten at least.
const RIGHT_SHARE: f64 = 0.01;
const RIGHT_COUNT: f64 = 10.0;

/// A ratio's logarithm of the likelihood ratio: slope, where it is 0, least and greatest.
const RATIO_SLOPE: f64 = 8.0;
const RATIO_EVEN: f64 = 0.87;
const RATIO_TERM: (f64, f64) = (-0.8, 3.0);

/// Residuals of more deviations don't move a pose.
const REFINED: f64 = 3.0;

/// Source x, y, z, then target x, y, z, then the level of correspondences; what is left of the last group has a level
/// of -infinity.
type Group = [[f64; DOUBLES]; TERMS];
const TERMS: usize = 7;

/// What the score of a pose adds up.
#[derive(Debug, Clone)]
pub struct Likelihood {
    groups: Vec<Group>,
    len: usize,
    /// Standard deviation of a right match, a length.
    deviation: f64,
    /// Residuals of at least this length count nothing.
    reach: f64,
}

/// The score of a pose, and how many correspondences it comes from.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Support {
    /// Sum of the logarithms of the likelihood ratios.
    pub score: f64,
    /// Number of correspondences that add to it.
    pub supporters: usize,
}

/// The level of each correspondence: `ln(share) + ln(n / D_i)`, and what its ratio adds, where `D_i` is how
/// many correspondences start or end within `radius` of it, the nearer the more.
///
/// # Errors
/// [`crate::Error::InvalidInput`] unless the radius is positive; [`crate::Error::Interrupted`].
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
    Ok((0..source.len()).map(level).collect())
}

/// `sum over k of max(0, 1 - d_ik^2 / radius^2)` at each point.
fn density(points: &Points, radius: f64, execution: &Execution) -> Result<Vec<f64>> {
    let limit = radius * radius;
    BallSearch::new(points, radius)?.map_points(execution, |_, ball| {
        ball.squared_distances().iter().map(|square| 1.0 - square / limit).sum()
    })
}

impl Likelihood {
    /// Of matched points and their [`levels`].
    pub fn new(source: &Points, target: &Points, levels: &[f64], deviation: f64, reach: f64) -> Self {
        let terms = |i: usize| {
            let (p, q) = (source.get(i), target.get(i));
            [p.x, p.y, p.z, q.x, q.y, q.z, levels[i]]
        };
        Self { groups: in_groups((0..levels.len()).map(terms)), len: levels.len(), deviation, reach }
    }

    /// Standard deviation of a right match.
    pub fn deviation(&self) -> f64 {
        self.deviation
    }

    /// The same without the correspondences that a pose leaves a residual below the reach.
    #[must_use]
    pub fn without_supporters(&self, pose: &Rigid) -> Self {
        let squares = self.squared_residuals(pose);
        let limit = self.reach * self.reach;
        let kept: Vec<usize> = (0..self.len).filter(|&i| squares[i] >= limit).collect();
        let terms = kept.iter().map(|&i| self.terms(i));
        Self { groups: in_groups(terms), len: kept.len(), ..*self }
    }

    fn terms(&self, i: usize) -> [f64; TERMS] {
        let group = &self.groups[i / DOUBLES];
        std::array::from_fn(|k| group[k][i % DOUBLES])
    }

    /// The score of a pose: sum of `max(0, level - r^2 / (2 deviation^2))` over residuals r below the reach.
    pub fn support(&self, pose: &Rigid) -> Support {
        let (limit, factor) = (self.reach * self.reach, 0.5 / (self.deviation * self.deviation));
        let transform = by_rows(pose);
        let (sums, counts) = simd::run(
            #[inline(always)]
            || {
                let (mut sums, mut counts) = ([0.0; DOUBLES], [0.0; DOUBLES]);
                for group in &self.groups {
                    let squares = squared_residuals(&transform, group);
                    for lane in 0..DOUBLES {
                        let term = group[6][lane] - factor * squares[lane];
                        let counts_here = (squares[lane] < limit) & (term > 0.0);
                        sums[lane] += if counts_here { term } else { 0.0 };
                        counts[lane] += if counts_here { 1.0 } else { 0.0 };
                    }
                }
                (sums, counts)
            },
        );
        Support { score: sums.iter().sum(), supporters: counts.iter().sum::<f64>() as usize }
    }

    /// The probability of each correspondence to be right, given the pose.
    pub fn posteriors(&self, pose: &Rigid) -> Vec<f64> {
        let factor = 0.5 / (self.deviation * self.deviation);
        let squares = self.squared_residuals(pose).into_iter().enumerate();
        squares.map(|(i, square)| posterior(self.level(i) - factor * square)).collect()
    }

    fn level(&self, i: usize) -> f64 {
        self.groups[i / DOUBLES][6][i % DOUBLES]
    }

    /// The pose after one round of weighted least squares for each of the given deviations, in turn; where
    /// the points that it is fitted to leave a rotation open, the pose before.
    #[must_use]
    pub fn refined(&self, pose: &Rigid, deviations: impl Iterator<Item = f64>) -> Rigid {
        let mut pose = *pose;
        for deviation in deviations {
            let Some(next) = self.refit(&pose, deviation) else { break };
            pose = next;
        }
        pose
    }

    fn refit(&self, pose: &Rigid, deviation: f64) -> Option<Rigid> {
        let (limit, factor) = ((REFINED * deviation).powi(2), 0.5 / (deviation * deviation));
        let (mut p, mut q, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for (i, square) in self.squared_residuals(pose).into_iter().enumerate() {
            if square < limit {
                let [x, y, z, u, v, w, level] = self.terms(i);
                p.push(Point3::new(x, y, z));
                q.push(Point3::new(u, v, w));
                weights.push(posterior(level - factor * square));
            }
        }
        fixes_rotation(&p, &q).then(|| fit_weighted(&p, &q, &weights))
    }

    /// `|R p + t - q|^2` of each correspondence.
    pub fn squared_residuals(&self, pose: &Rigid) -> Vec<f64> {
        let transform = by_rows(pose);
        let mut squares = vec![[0.0; DOUBLES]; self.groups.len()];
        simd::run(
            #[inline(always)]
            || {
                for (group, squares) in self.groups.iter().zip(&mut squares) {
                    *squares = squared_residuals(&transform, group);
                }
            },
        );
        let mut squares = squares.into_flattened();
        squares.truncate(self.len);
        squares
    }
}

/// The probability whose odds have this logarithm.
fn posterior(log_odds: f64) -> f64 {
    1.0 / (1.0 + (-log_odds).exp())
}

fn in_groups(terms: impl ExactSizeIterator<Item = [f64; TERMS]>) -> Vec<Group> {
    let mut empty = [[0.0; DOUBLES]; TERMS];
    empty[6] = [f64::NEG_INFINITY; DOUBLES];
    let mut groups = vec![empty; terms.len().div_ceil(DOUBLES)];
    for (i, terms) in terms.enumerate() {
        let group = &mut groups[i / DOUBLES];
        (0..TERMS).for_each(|k| group[k][i % DOUBLES] = terms[k]);
    }
    groups
}

/// R by rows, then t.
fn by_rows(pose: &Rigid) -> [f64; 12] {
    let mut transform = [0.0; 12];
    transform[..9].copy_from_slice(pose.rotation.transpose().as_slice());
    transform[9..].copy_from_slice(pose.translation.as_slice());
    transform
}

#[inline(always)]
fn squared_residuals(transform: &[f64; 12], group: &Group) -> [f64; DOUBLES] {
    let [r0, r1, r2, r3, r4, r5, r6, r7, r8, t0, t1, t2] = *transform;
    let mut squares = [0.0; DOUBLES];
    for lane in 0..DOUBLES {
        let [x, y, z] = [group[0][lane], group[1][lane], group[2][lane]];
        let dx = r0 * x + r1 * y + r2 * z + t0 - group[3][lane];
        let dy = r3 * x + r4 * y + r5 * z + t1 - group[4][lane];
        let dz = r6 * x + r7 * y + r8 * z + t2 - group[5][lane];
        squares[lane] = dx * dx + dy * dy + dz * dz;
    }
    squares
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::rigid::fit_rigid;
    use nalgebra::{Matrix3, Vector3};

    const STILL: fn() -> Rigid = || Rigid { rotation: Matrix3::identity(), translation: Vector3::zeros() };

    fn points(n: usize) -> Result<Points> {
        let place = |i: usize| [1.1, 2.3, 3.7].map(|f| 50.0 * (i as f64 * f).sin());
        Points::from_rows("points", &(0..n).map(place).collect::<Vec<_>>())
    }

    /// Target points farther and farther from where they should be.
    fn shifted(points: &Points) -> Result<Points> {
        let rows = points.rows().into_iter().enumerate();
        let rows: Vec<[f64; 3]> = rows.map(|(i, [x, y, z])| [x, y + 0.1 * i as f64, z]).collect();
        Points::from_rows("target", &rows)
    }

    #[test]
    fn levels_of_points_far_from_each_other_and_of_points_in_one_place() -> Result<()> {
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

    #[test]
    fn support_is_the_plain_sum() -> Result<()> {
        for n in [0, 1, 7, 8, 9, 100] {
            let source = points(n)?;
            let target = shifted(&source)?;
            let levels: Vec<f64> = (0..n).map(|i| 3.0 * (i as f64).sin()).collect();
            let likelihood = Likelihood::new(&source, &target, &levels, 1.5, 3.0);
            let squares = likelihood.squared_residuals(&STILL());
            let plain = |i: usize| (source.get(i) - target.get(i)).norm_squared();
            assert!((0..n).all(|i| (squares[i] - plain(i)).abs() < 1e-9));
            let terms = (0..n).map(|i| if squares[i] < 9.0 { levels[i] - squares[i] / 4.5 } else { 0.0 });
            let terms: Vec<f64> = terms.filter(|&term| term > 0.0).collect();
            let support = likelihood.support(&STILL());
            assert_eq!(support.supporters, terms.len());
            assert!((support.score - terms.iter().sum::<f64>()).abs() < 1e-9);
            let rest = likelihood.without_supporters(&STILL());
            assert_eq!(rest.len, squares.iter().filter(|&&square| square >= 9.0).count());
            assert_eq!(rest.support(&STILL()), Support::default());
        }
        Ok(())
    }

    #[test]
    fn refinement_fits_the_near_ones_and_leaves_a_pose_that_nothing_fixes() -> Result<()> {
        let source = points(40)?;
        let rows = source.rows().into_iter().enumerate();
        let moved: Vec<[f64; 3]> =
            rows.map(|(i, [x, y, z])| if i < 30 { [x, y, z] } else { [x + 900.0, y, -z] }).collect();
        let target = Points::from_rows("target", &moved)?;
        let likelihood = Likelihood::new(&source, &target, &[5.0; 40], 1.0, 3.0);
        let (p, q): (Vec<_>, Vec<_>) = (0..30).map(|i| (source.get(i), target.get(i))).unzip();
        let mut start = fit_rigid(&p, &q);
        start.translation.x += 0.5;
        let refined = likelihood.refined(&start, [1.0; 5].into_iter());
        assert!(likelihood.squared_residuals(&refined)[..30].iter().all(|&square| square < 1e-12));
        let far = Rigid { translation: Vector3::new(0.0, 0.0, 1e6), ..STILL() };
        assert_eq!(likelihood.refined(&far, [1.0; 5].into_iter()), far);
        assert!(likelihood.posteriors(&refined)[0] > 0.99 && likelihood.posteriors(&refined)[35] < 1e-6);
        Ok(())
    }
}
