//! Mixture of correct and wrong matches under one or several motions.
//!
//! With lengths in a unit u, about the mean spacing of the clouds: a correct match of motion k ends within
//! its noise of its place, `N(r_ik; s_k)`, a Gaussian in space with the variance `s_k^2` along each axis. A
//! wrong match ends where matches end anyway: at the density `lambda_i = D_i / (n V)` around its target, with
//! `D_i = sum over j of max(0, 1 - d_ij^2 / 25)` and the volume `V = 8 pi 5^3 / 15` of that kernel. Shares
//! `pi_k` of the motions' matches, and variances, are estimated by expectation and maximization (Dempster,
//! Laird, Rubin, JRSS 1977). The prior of a variance counts as ten matches of deviation 1.6.

use nalgebra::Point3;

use super::likelihood::levels::density;
use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::rigid::{Rigid, fit_weighted, fixes_rotation};
use crate::memory;
use crate::points::Points;

/// Radius of the kernel of the chance density, and its volume, in units.
pub const CHANCE: f64 = 5.0;
const VOLUME: f64 = 8.0 * std::f64::consts::PI * CHANCE * CHANCE * CHANCE / 15.0;

/// Prior deviation of a correct match, in units, and the number of matches that it counts as.
const DEVIATION: f64 = 1.6;
const STRENGTH: f64 = 10.0;

/// Larger residuals, in units, are as improbable.
const FAR: f64 = 1e6;

/// Least weight of a match in the fit of a pose.
const LEAST_WEIGHT: f64 = 1e-3;

/// A motion with the share and the noise of its matches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Between the centred points.
    pub pose: Rigid,
    /// Share of all matches, in 0..1.
    pub share: f64,
    /// Variance along each axis, in units squared.
    pub variance: f64,
}

impl Motion {
    /// A motion with the prior variance, of that many of `n` matches.
    pub fn new(pose: Rigid, matches: usize, n: usize) -> Self {
        Self { pose, share: matches.max(3) as f64 / (n.max(3) + 1) as f64, variance: DEVIATION * DEVIATION }
    }

    /// Logarithm of the share times the density at a squared residual.
    fn ln_density(&self, square: f64) -> f64 {
        let turn = std::f64::consts::TAU * self.variance;
        self.share.ln() - 1.5 * turn.ln() - 0.5 * square / self.variance
    }
}

/// The matches, with what is known without a motion.
#[derive(Debug)]
pub struct Mixture<'a> {
    source: &'a Points,
    target: &'a Points,
    unit: f64,
    /// Logarithm of the density of wrong matches around each target.
    chance: Vec<f64>,
}

impl<'a> Mixture<'a> {
    /// Measures the density of the targets.
    ///
    /// # Errors
    /// [`crate::Error::InvalidInput`] unless the unit is positive; [`crate::Error::Interrupted`],
    /// [`crate::Error::OutOfMemory`].
    pub fn new(source: &'a Points, target: &'a Points, unit: f64, execution: &Execution) -> Result<Self> {
        let mut chance = density(target, CHANCE * unit, execution)?;
        let n = chance.len() as f64;
        chance.iter_mut().for_each(|count| *count = (count.max(1.0) / (n * VOLUME)).ln());
        Ok(Self { source, target, unit, chance })
    }

    /// Squared residual of a match, in units squared.
    pub fn square(&self, pose: &Rigid, i: usize) -> f64 {
        let residual = (pose.apply(&self.source.get(i)) - self.target.get(i)).norm() / self.unit;
        residual.min(FAR).powi(2)
    }

    /// The probability that a match belongs to each motion; the rest is that of a wrong match.
    pub fn posteriors(&self, motions: &[Motion], i: usize, probabilities: &mut [f64]) {
        let wrong = 1.0 - motions.iter().map(|motion| motion.share).sum::<f64>();
        let chance = wrong.max(f64::MIN_POSITIVE).ln() + self.chance[i];
        let mut greatest = chance;
        for (motion, probability) in motions.iter().zip(&mut *probabilities) {
            *probability = motion.ln_density(self.square(&motion.pose, i));
            greatest = greatest.max(*probability);
        }
        probabilities.iter_mut().for_each(|probability| *probability = (*probability - greatest).exp());
        let total = (chance - greatest).exp() + probabilities.iter().sum::<f64>();
        probabilities.iter_mut().for_each(|probability| *probability /= total);
    }

    /// The probabilities of one motion, for all matches.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn posteriors_of(&self, motions: &[Motion], k: usize) -> Result<Vec<f64>> {
        let mut all = memory::filled(0.0, motions.len())?;
        let mut of_motion = memory::with_capacity(self.source.len())?;
        for i in 0..self.source.len() {
            self.posteriors(motions, i, &mut all);
            of_motion.push(all[k]);
        }
        Ok(of_motion)
    }

    /// One iteration: shares and variances, and the poses if `fits`.
    ///
    /// # Errors
    /// [`crate::Error::OutOfMemory`].
    pub fn improve(&self, motions: &mut [Motion], fits: bool) -> Result<()> {
        let n = self.source.len();
        let count = motions.len();
        let mut weights = memory::filled(0.0, count * n)?;
        for (i, row) in weights.chunks_exact_mut(count.max(1)).enumerate() {
            self.posteriors(motions, i, row);
        }
        for (k, motion) in motions.iter_mut().enumerate() {
            let weight = |i: usize| weights[i * count + k];
            if fits && let Some(pose) = self.fit(weight)? {
                motion.pose = pose;
            }
            let total = (0..n).map(weight).sum::<f64>();
            let squares = (0..n).map(|i| weight(i) * self.square(&motion.pose, i)).sum::<f64>();
            motion.share = (total + 0.5) / (n as f64 + 0.5 * (count + 1) as f64);
            let prior = 3.0 * STRENGTH * DEVIATION * DEVIATION;
            motion.variance = (squares + prior) / (3.0 * (total + STRENGTH));
        }
        Ok(())
    }

    /// Weighted least squares; `None` if the matches do not determine the rotation.
    fn fit(&self, weight: impl Fn(usize) -> f64) -> Result<Option<Rigid>> {
        let rows = memory::collect((0..self.source.len()).filter(|&i| weight(i) > LEAST_WEIGHT))?;
        let p: Vec<Point3<f64>> = memory::collect(rows.iter().map(|&i| self.source.get(i)))?;
        let q: Vec<Point3<f64>> = memory::collect(rows.iter().map(|&i| self.target.get(i)))?;
        let weights = memory::collect(rows.iter().map(|&i| weight(i)))?;
        Ok(fixes_rotation(&p, &q).then(|| fit_weighted(&p, &q, &weights)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    /// Points of which the first 30 stay, the next 30 move along x, and the rest move anywhere.
    fn problem() -> Result<(Points, Points)> {
        let place = |i: usize, k: f64| [1.1, 2.3, 3.7].map(|f| 100.0 * (i as f64 * f * k + k).sin());
        let source: Vec<[f64; 3]> = (0..120).map(|i| place(i, 1.0)).collect();
        let moved = |(i, p): (usize, &[f64; 3])| match i {
            0..30 => *p,
            30..60 => [p[0] + 20.0, p[1], p[2]],
            _ => place(i, 0.7),
        };
        let target: Vec<_> = source.iter().enumerate().map(moved).collect();
        Ok((Points::from_rows("source", &source)?, Points::from_rows("target", &target)?))
    }

    #[test]
    fn each_match_is_given_to_its_motion() -> Result<()> {
        let (source, target) = problem()?;
        let mixture = Mixture::new(&source, &target, 1.0, &Execution::default())?;
        let offset = source.center() - target.center();
        let motion = |x: f64| {
            let translation = Vector3::new(x, 0.0, 0.0) + offset;
            Motion::new(Rigid { rotation: Matrix3::identity(), translation }, 10, 120)
        };
        let mut motions = [motion(0.4), motion(19.7)];
        for _ in 0..10 {
            mixture.improve(&mut motions, true)?;
        }
        let (first, second) = (mixture.posteriors_of(&motions, 0)?, mixture.posteriors_of(&motions, 1)?);
        assert!(first[..30].iter().chain(&second[30..60]).all(|&one| one > 0.99));
        assert!(first[30..].iter().chain(&second[..30]).chain(&second[60..]).all(|&one| one < 0.5));
        assert!((motions[1].pose.translation - offset - Vector3::x() * 20.0).norm() < 0.1);
        assert!(motions.iter().all(|one| (one.share - 0.25).abs() < 0.02));
        Ok(())
    }
}
