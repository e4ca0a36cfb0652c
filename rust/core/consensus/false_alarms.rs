//! Number of false alarms: the expected number of poses with as much support by chance alone.
//!
//! Three matches determine a pose, and any three of n can do so. The other matches support it by chance and
//! independently, about `chance` of them. If no match is correct, the expected number of poses with k
//! supporters is therefore `n^3 / 6 P(Poisson(chance) >= k - 3)` (Moisan, Moulon, Monasse: Automatic
//! homographic registration of a pair of images, with a contrario elimination of outliers, IPOL 2012, for a
//! pose of three matches).

use crate::error::Result;
use crate::memory;
use crate::points::Points;

/// Further supporters make no difference.
const ENOUGH: usize = 200;

/// Squared residuals are compared in units of this share of `apart` squared: if all fit exactly, rounding
/// would decide.
const TIE: f64 = 1e-12;

/// Relative tolerance for equal numbers of false alarms: equal counts give equal numbers up to rounding,
/// which must not decide between them.
pub const EQUAL: f64 = 1e-9;

/// Matches that determine a pose.
const MINIMAL: usize = 3;

/// Supporters of a pose that are independent of each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Independent {
    /// Their number.
    pub count: usize,
    /// Their share of the supporters examined.
    pub share: f64,
}

/// Visits supporters by ascending residual, and keeps only the first of those within `apart` of each other on
/// either side: wrong matches of neighbouring points are often wrong together.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn independent(
    source: &Points,
    target: &Points,
    squares: &[f64],
    supporters: &[usize],
    apart: f64,
) -> Result<Independent> {
    let mut order = memory::copied(supporters)?;
    let rounded = |i: usize| (squares[i] / (TIE * apart * apart)).round();
    order.sort_unstable_by(|&a, &b| rounded(a).total_cmp(&rounded(b)).then(a.cmp(&b)));
    let mut kept: Vec<usize> = Vec::new();
    let mut seen = 0_u32;
    for i in order {
        seen += 1;
        let far = |points: &Points, j: usize| (points.get(i) - points.get(j)).norm_squared() > apart * apart;
        if kept.iter().all(|&j| far(source, j) && far(target, j)) {
            memory::push(&mut kept, i)?;
            if kept.len() == ENOUGH {
                break;
            }
        }
    }
    Ok(Independent { count: kept.len(), share: kept.len() as f64 / f64::from(seen.max(1)) })
}

/// Number of false alarms of a pose with `supporters` of `n` matches, of which `chance` are expected.
pub fn false_alarms(n: usize, supporters: usize, chance: f64) -> f64 {
    let (logarithm, sum) = poisson_tail(supporters.saturating_sub(MINIMAL), chance);
    (n as f64).powi(3) / 6.0 * (logarithm.exp() * sum)
}

/// As [`false_alarms`], within a radius that is small against the distances between the matches. Two matches
/// determine a pose up to the rotation about their line. The third match then lies on a ring, about as
/// probably as others lie near their places. Any two of n can thus determine a pose: the expected number of
/// poses with k supporters is `n^2 P(Poisson(chance) >= k - 2)`.
pub fn precise_false_alarms(n: usize, supporters: usize, chance: f64) -> f64 {
    let (logarithm, sum) = poisson_tail(supporters.saturating_sub(MINIMAL - 1), chance);
    (n as f64).powi(2) * (logarithm.exp() * sum)
}

/// The logarithm of [`false_alarms`], which distinguishes poses whose number is too small for a float.
pub fn ln_false_alarms(n: usize, supporters: usize, chance: f64) -> f64 {
    let (logarithm, sum) = poisson_tail(supporters.saturating_sub(MINIMAL), chance);
    3.0 * (n as f64).ln() - 6.0_f64.ln() + logarithm + sum.ln()
}

/// Whether a number of false alarms is less than another, by more than rounding.
pub fn is_fewer(one: f64, other: f64) -> bool {
    one < (1.0 - EQUAL) * other
}

/// `P(Poisson(mean) >= least)`, or 1 if the mean is no less: a factor's logarithm, and the other factor.
fn poisson_tail(least: usize, mean: f64) -> (f64, f64) {
    if least as f64 <= mean {
        return (0.0, 1.0);
    }
    if mean <= 0.0 {
        return (0.0, 0.0);
    }
    let logarithm: f64 = -mean + (1..=least).map(|k| (mean / k as f64).ln()).sum::<f64>();
    let (mut term, mut sum, mut k) = (1.0, 0.0, least as f64);
    while term > f64::EPSILON * sum {
        sum += term;
        k += 1.0;
        term *= mean / k;
    }
    (logarithm, sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tail_is_the_plain_sum() {
        let tail = |least, mean| {
            let (logarithm, sum) = poisson_tail(least, mean);
            logarithm.exp() * sum
        };
        for (least, mean) in [(1, 0.3_f64), (4, 1.5), (9, 8.2), (30, 2.0)] {
            let mut term = f64::exp(-mean);
            let mut below = 0.0;
            for k in 0..least {
                below += term;
                term *= mean / (k + 1) as f64;
            }
            let found = tail(least, mean);
            assert!((found - (1.0 - below)).abs() < 1e-14, "{least} {mean} {found}");
        }
        assert!(tail(30, 2.0) > 0.0 && tail(30, 2.0) < 1e-20);
        assert_eq!((tail(0, 0.0), tail(1, 0.0), tail(3, 4.0)), (1.0, 0.0, 1.0));
        assert!((ln_false_alarms(50, 9, 1.5) - false_alarms(50, 9, 1.5).ln()).abs() < 1e-12);
        assert!(ln_false_alarms(5000, 900, 1.5) < -1000.0);
        assert!((precise_false_alarms(4, 4, 1e-4) / (16.0 * 0.5e-8) - 1.0).abs() < 1e-3);
        assert!((precise_false_alarms(4, 2, 1e-4) - 16.0).abs() < 1e-12);
    }

    #[test]
    fn neighbours_count_once() -> Result<()> {
        let rows: Vec<[f64; 3]> =
            (0..9).map(|i| [f64::from(i / 3) * 10.0 + f64::from(i % 3), 0.0, 0.0]).collect();
        let points = Points::from_rows("points", &rows)?;
        let squares: Vec<f64> = (0..9).map(|i| f64::from(8 - i)).collect();
        let found = independent(&points, &points, &squares, &[0, 1, 2, 3, 4, 5, 6, 7, 8], 5.0)?;
        assert_eq!((found.count, found.share), (3, 1.0 / 3.0));
        assert_eq!(independent(&points, &points, &squares, &[], 5.0)?.count, 0);
        Ok(())
    }
}
