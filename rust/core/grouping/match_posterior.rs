//! Probability that each match is correct, for the group of any method.
//!
//! The probability of a match given the pose is that of the [mixture](crate::consensus::mixture). It is
//! multiplied by the probability of the pose, `1 / (1 + e^(f / 3) + sum over k of e^((f - f_k) / 3))`. Here f
//! is the logarithm of the number of false alarms ([`false_alarms`](crate::consensus::false_alarms)) of the
//! pose: supporters lie within 5 u, or within 3 deviations if that is less, and at least 7 u apart; two radii
//! double the number. The `f_k` are those of up to seven rivals: alternatives of the group that move its
//! points by more than 10 u. The divisor 3 is fitted: matches are less independent than the number assumes.
//!
//! The unit u is the resolution, or a third of the tolerance that suits the spacing of the matches. A group
//! without a model has the pose of its members, refined by the mixture.

use nalgebra::{Matrix3, Matrix4};

use super::likelihood_consensus::likely_tolerance;
use crate::consensus::false_alarms::{independent, ln_false_alarms};
use crate::consensus::landing::landings;
use crate::consensus::mixture::{CHANCE, Mixture, Motion};
use crate::error::Error;
use crate::geometry::rigid::{Rigid, fit_rows};
use crate::{Correspondences, Execution, Grouping, Points, Result, memory};

/// Greatest deviation from a rotation, of the entries of `A^T A / s^2 - I`, as of frames.
const MOST_SHEAR: f64 = 1e-3;

/// Iterations of the mixture.
const ROUNDS: usize = 30;

/// Lengths in units: distance of independent supporters, and least displacement of a rival.
pub(super) const APART: f64 = 7.0;
const DIFFERENT: f64 = 10.0;

/// Radius of supporters in deviations.
const DEVIATIONS: f64 = 3.0;

/// Most rivals.
const RIVALS: usize = 7;

/// Divisor of the logarithm of the number of false alarms; fitted on scans of one object and of one room.
const SOFTNESS: f64 = 3.0;

/// Least logarithm of the number of false alarms if a reflection fits as well; greatest magnitude of any.
const REFLECTED: f64 = 5.0;
const GREATEST: f64 = 3000.0;

/// Matches with the unit of their lengths.
pub(super) struct Matches<'a> {
    pub(super) source: &'a Points,
    pub(super) target: &'a Points,
    pub(super) unit: f64,
    pub(super) execution: &'a Execution,
}

/// The probability that each match is correct, in `0..=1`; 0 for all of them without a pose.
///
/// The model, the alternatives, the mask and the number of false alarms of the grouping are read.
///
/// # Errors
/// [`Error::MissingField`] without points, [`Error::InvalidInput`] for a mask of another length or a model that
/// is not a similarity; [`Error::Interrupted`], [`Error::OutOfMemory`].
pub fn match_probabilities(
    correspondences: &Correspondences,
    grouping: &Grouping,
    execution: &Execution,
) -> Result<Vec<f64>> {
    let (source, target) = correspondences.positions("match_probabilities")?;
    let n = source.len();
    if grouping.mask.len() != n {
        let got = format!("a group of {} matches", grouping.mask.len());
        return Err(Error::invalid("grouping", got, format!("give the group of these {n} matches")));
    }
    let scale = grouping.model.as_ref().map_or(Ok(1.0), scale_of)?;
    let source = &source.scaled(scale)?;
    let unit = match correspondences.resolution() {
        Some(resolution) => resolution,
        None => likely_tolerance(source, target, execution)? / 3.0,
    };
    let matches = Matches { source, target, unit, execution };
    let members = (0..n).filter(|&i| grouping.mask[i]);
    let pose = match &grouping.model {
        Some(model) => Some(matches.centered(model, scale)),
        None => fit_rows(source, target, members.clone())?,
    };
    let Some(pose) = pose.filter(|_| n >= 3) else { return memory::filled(0.0, n) };
    let mixture = Mixture::new(source, target, unit, execution)?;
    let mut motion = [Motion::new(pose, grouping.size(), n)];
    for _ in 0..ROUNDS {
        execution.check()?;
        mixture.improve(&mut motion, grouping.model.is_none())?;
    }
    let mut probabilities = mixture.posteriors_of(&motion, 0)?;
    let certainty = matches.certainty(&motion[0], grouping, scale, &memory::collect(members)?)?;
    probabilities.iter_mut().for_each(|probability| *probability *= certainty);
    Ok(probabilities)
}

/// The scale of a similarity.
///
/// # Errors
/// [`Error::InvalidInput`] for a matrix that is not finite, a reflection, or a shear.
pub fn scale_of(model: &Matrix4<f64>) -> Result<f64> {
    let turn = model.fixed_view::<3, 3>(0, 0);
    let scale = turn.determinant().cbrt();
    let deviation = (turn.transpose() * turn / (scale * scale) - Matrix3::identity()).amax();
    if model.iter().all(|entry| entry.is_finite()) && scale > 0.0 && deviation < MOST_SHEAR {
        return Ok(scale);
    }
    Err(Error::invalid("grouping", "a model that is no rigid motion", "give a rigid model, or None"))
}

impl Matches<'_> {
    /// The pose between the centred points, of a source that is scaled already.
    pub(super) fn centered(&self, model: &Matrix4<f64>, scale: f64) -> Rigid {
        let Rigid { rotation, translation } = Rigid::from_matrix(model);
        Rigid { rotation: rotation / scale, translation }.centered(self.source, self.target)
    }

    /// Logarithm of the number of false alarms of a pose within a radius, among some rows.
    pub(super) fn ln_false_alarms(&self, pose: &Rigid, radius: f64, taken: &[bool]) -> Result<f64> {
        let Self { source, target, unit, execution } = *self;
        let square = |i: usize| (pose.apply(&source.get(i)) - target.get(i)).norm_squared();
        let squares = memory::collect((0..source.len()).map(square))?;
        let is_near = |&i: &usize| squares[i] <= radius * radius && taken.get(i) != Some(&true);
        let supporters = memory::collect((0..squares.len()).filter(is_near))?;
        let n = squares.len() - taken.iter().filter(|&&taken| taken).count();
        let found = independent(source, target, &squares, &supporters, APART * unit)?;
        let landed = landings(&[*pose], source, target, radius, execution)?;
        let near = landed.first().map_or(0.0, |landing| landing.chance);
        let chance = near.max(supporters.len() as f64 / n.max(1) as f64);
        Ok(ln_false_alarms(n.max(1), found.count, chance * found.share).clamp(-GREATEST, GREATEST))
    }

    /// The probability of the pose.
    fn certainty(&self, motion: &Motion, grouping: &Grouping, scale: f64, members: &[usize]) -> Result<f64> {
        let radius = CHANCE * self.unit;
        let exact = DEVIATIONS * motion.variance.sqrt() * self.unit;
        let mut own = self.ln_false_alarms(&motion.pose, radius, &[])?;
        if exact < radius {
            own = own.min(self.ln_false_alarms(&motion.pose, exact, &[])?);
        }
        own += std::f64::consts::LN_2;
        if grouping.false_alarms == Some(f64::INFINITY) {
            own = own.max(REFLECTED);
        }
        let mut odds = 1.0 + (own / SOFTNESS).exp();
        for rival in grouping.alternatives.iter().flatten().skip(1).take(RIVALS) {
            let pose = self.centered(&rival.model, scale);
            if self.displacement(&motion.pose, &pose, members) > DIFFERENT * self.unit {
                odds += ((own - self.ln_false_alarms(&pose, radius, &[])?) / SOFTNESS).exp();
            }
        }
        Ok(1.0 / odds)
    }

    /// Root mean square distance between some points moved by two poses.
    pub(super) fn displacement(&self, a: &Rigid, b: &Rigid, rows: &[usize]) -> f64 {
        let square = |&i: &usize| {
            let p = self.source.get(i);
            (a.apply(&p) - b.apply(&p)).norm_squared()
        };
        (rows.iter().map(square).sum::<f64>() / rows.len().max(1) as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grouping::GroupingMethod;
    use crate::grouping::likelihood_consensus::LikelihoodConsensus;
    use crate::grouping::test_problem::problem;

    fn probabilities(n: usize, right: usize, keeps_model: bool) -> Result<Vec<f64>> {
        let given = problem(n, right)?;
        let execution = Execution::default();
        let mut group = LikelihoodConsensus::default().group(&given, &execution)?;
        group.model = group.model.filter(|_| keeps_model);
        match_probabilities(&given, &group, &execution)
    }

    #[test]
    fn moved_points_are_probable_and_others_are_not() -> Result<()> {
        for keeps_model in [true, false] {
            let found = probabilities(400, 40, keeps_model)?;
            assert!(found[..40].iter().all(|&one| one > 0.9), "{:?}", &found[..40]);
            assert!(found[40..].iter().sum::<f64>() < 3.0);
            let chance = probabilities(400, 0, keeps_model)?;
            assert!(chance.iter().sum::<f64>() < 2.0, "{}", chance.iter().sum::<f64>());
        }
        Ok(())
    }

    #[test]
    fn few_or_coincident_matches_and_wrong_masks() -> Result<()> {
        for n in [0, 1, 2, 3] {
            let found = probabilities(n, n, false)?;
            assert!(found.len() == n && found.iter().all(|&one| one < 0.5));
        }
        let rows = [[1.0; 3]; 50];
        let given = Correspondences::new(&rows, &rows)?;
        let mut group = Grouping::from_mask(vec![true; 50]);
        assert_eq!(match_probabilities(&given, &group, &Execution::default())?, vec![0.0; 50]);
        group.model = Some(Matrix4::zeros());
        assert!(match_probabilities(&given, &group, &Execution::default()).is_err());
        group.mask.pop();
        assert!(match_probabilities(&given, &group, &Execution::default()).is_err());
        Ok(())
    }
}
