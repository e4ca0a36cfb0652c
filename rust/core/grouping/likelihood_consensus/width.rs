//! The radius of a group, from the residuals under its pose.
//!
//! Residuals within a window of 1.7 radii are a mixture: those of correct matches, which end on a surface,
//! follow a Rayleigh distribution with `sigma = radius / 2`, the others are uniform over a disc. `sigma` is
//! estimated by expectation maximization, and the window moves with it. The prior of the radius is two of the
//! tolerances that suit the spacing of the matches, and weighs as 30 correct matches.
//!
//! The estimate is at least the radius that suits the noise, or that of a given resolution if less: if correct
//! matches are further from their places than matches from each other, the window holds too few of them.
//!
//! The radius of a given resolution stays if the estimate is between 0.4 and 2.5 of it. If the estimate is
//! greater, the radius is the geometric mean of both, at least the one that suits the noise. If it is less,
//! the radius is the geometric mean of both, or the estimate alone below a quarter.

use crate::{Result, memory};

/// Deviations per radius, and radii per window.
const DEVIATIONS: f64 = 2.0;
const WINDOW: f64 = 1.7;

/// Prior of the radius in likely tolerances, and the number of correct matches that it weighs as.
const TOLERANCES: f64 = 2.0;
const PRIOR: f64 = 30.0;

/// Windows, iterations in each, and the greatest factor between windows in turn.
const WINDOWS: usize = 12;
const ROUNDS: usize = 12;
const STEP: f64 = 1.3;

/// Matches in the smallest window.
const LEAST: usize = 6;

/// Greatest factor between the estimate and its prior.
const SPAN: f64 = 3.0;

/// Bounds of the estimate, in given radii, between which the given radius stays.
const STAYS: (f64, f64) = (0.4, 2.5);

/// The estimate, in given radii, below which a given radius does not count.
const COUNTS: f64 = 0.25;

/// The group's radius by the squared residuals, from the tolerance that suits the spacing of matches, the
/// radius of a given resolution and the one that suits the noise.
pub fn radius(squares: &[f64], likely_tolerance: f64, given: Option<f64>, by_noise: f64) -> Result<f64> {
    let least = by_noise.min(given.unwrap_or(f64::INFINITY));
    let estimate = estimate(squares, TOLERANCES * likely_tolerance)?.max(least);
    let Some(given) = given else { return Ok(estimate) };
    let factor = estimate / given;
    let mean = (given * estimate).sqrt();
    Ok(if (STAYS.0 < factor && factor < STAYS.1) || !(mean > 0.0 && mean.is_finite()) {
        given
    } else if factor > 1.0 {
        mean.max(by_noise)
    } else if factor > COUNTS {
        mean
    } else {
        estimate
    })
}

/// The radius estimated from residuals.
fn estimate(squares: &[f64], likely: f64) -> Result<f64> {
    let prior = likely / DEVIATIONS;
    let mut sorted = memory::copied(squares)?;
    sorted.sort_unstable_by(f64::total_cmp);
    let window = DEVIATIONS * WINDOW;
    let least = sorted.get(LEAST.min(sorted.len()).saturating_sub(1)).map_or(0.0, |square| square.sqrt());
    let mut sigma = prior.max(least / window);
    for _ in 0..WINDOWS {
        let limit = window * sigma;
        let near = &sorted[..sorted.partition_point(|&square| square < limit * limit)];
        let (own, count) = fitted(near, limit, sigma);
        if count <= 0.0 {
            break;
        }
        let next = ((count * own.ln() + PRIOR * prior.ln()) / (count + PRIOR)).exp();
        sigma = next.clamp(sigma / STEP, sigma * STEP);
    }
    Ok(DEVIATIONS * sigma.clamp(prior / SPAN, prior * SPAN))
}

/// The deviation of correct matches within a window, and their number; 0 if none determines it.
fn fitted(squares: &[f64], window: f64, start: f64) -> (f64, f64) {
    let (mut sigma, mut share, mut count) = (start, 0.5, 0.0);
    for _ in 0..ROUNDS {
        let ratio = 0.5 * (window / sigma).powi(2);
        let mut sum = 0.0;
        count = 0.0;
        for square in squares {
            let right = share * ratio * (-0.5 * square / (sigma * sigma)).exp();
            let weight = right / (right + 1.0 - share);
            count += weight;
            sum += weight * square;
        }
        if !(sum > 0.0 && sum.is_finite()) {
            return (start, 0.0);
        }
        share = (count + 1.0) / (squares.len() as f64 + 2.0);
        sigma = (0.5 * sum / count).sqrt();
    }
    (sigma, count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Residuals of a disc with `right` matches by a Rayleigh distribution, and others evenly over a disc.
    fn squares(right: usize, sigma: f64, wrong: usize, disc: f64) -> Vec<f64> {
        let place = |k: usize, n: usize| (k as f64 + 0.5) / n as f64;
        let near = (0..right).map(|k| -2.0 * sigma * sigma * (1.0 - place(k, right)).ln());
        near.chain((0..wrong).map(|k| disc * disc * place(k, wrong))).collect()
    }

    #[test]
    fn many_residuals_give_the_radius_and_few_leave_the_prior() -> Result<()> {
        for sigma in [0.5, 1.0, 2.0] {
            let found = radius(&squares(3_000, sigma, 300, 20.0), 1.0, None, 0.0)?;
            assert!((found / (2.0 * sigma) - 1.0).abs() < 0.2, "{sigma} {found}");
            assert!((radius(&squares(3_000, sigma, 300, 20.0), 1.0, None, 9.0)? - 9.0).abs() < 1e-12);
        }
        for residuals in [Vec::new(), vec![0.0; 5]] {
            assert!((radius(&residuals, 1.0, None, 0.0)? - 2.0).abs() < 1e-12);
        }
        Ok(())
    }

    #[test]
    fn a_given_radius_stays_or_counts_or_is_ignored() -> Result<()> {
        let residuals = squares(3_000, 1.0, 300, 20.0);
        let estimate = radius(&residuals, 1.0, None, 0.0)?;
        let cases = [
            (2.4, 0.0, 2.4),
            (0.6, 9.0, 0.6),
            (9.0, 3.0, 27.0_f64.sqrt()),
            (3.0, 0.0, 3.0_f64.sqrt()),
            (0.3, 0.0, 0.3_f64.sqrt()),
            (0.3, 0.8, 0.8),
            (9.0, 0.0, 1.0),
        ];
        for (factor, by_noise, expected) in cases {
            let found = radius(&residuals, 1.0, Some(factor * estimate), by_noise * estimate)?;
            assert!((found / (expected * estimate) - 1.0).abs() < 1e-9, "{factor} {found}");
        }
        Ok(())
    }
}
