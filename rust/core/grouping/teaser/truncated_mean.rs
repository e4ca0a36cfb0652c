//! Truncated least squares of one unknown, by adaptive voting (TEASER, section V-B).

use crate::{Result, memory};

/// The value x that minimizes the sum over k of `min((x - x_k)^2 / r_k^2, 1)`, with ranges `r_k > 0`.
///
/// Each measurement is an inlier on an interval `x_k -+ r_k`. Between two interval ends the set of inliers is
/// constant; the minimum is the weighted mean of one of these sets. The lowest of several minima of equal
/// cost is returned.
///
/// # Errors
/// [`crate::Error::OutOfMemory`].
pub fn truncated_mean(values: &[f64], ranges: &[f64]) -> Result<Option<f64>> {
    let mut best: Option<(f64, f64)> = None;
    let mut held = Held::default();
    for Event { index, starts, .. } in events(values, ranges)? {
        let weight = ranges[index as usize].powi(-2);
        if starts {
            held.take_in(values[index as usize], weight);
        } else {
            held.leave_out(values[index as usize], weight);
        }
        let cost = held.spread - f64::from(held.members);
        if held.members > 0 && best.is_none_or(|(least, _)| cost < least - SAME_COST) {
            best = Some((cost, held.mean));
        }
    }
    Ok(best.map(|(_, mean)| mean))
}

/// Tolerance for equal costs: a member costs 1 at most.
const SAME_COST: f64 = 1e-9;

/// Start or end of an interval.
struct Event {
    place: f64,
    starts: bool,
    index: u32,
}

/// Events in ascending order; starts precede ends at the same place.
fn events(values: &[f64], ranges: &[f64]) -> Result<Vec<Event>> {
    let ends = |(index, (value, range)): (u32, (&f64, &f64))| {
        [(value - range, true), (value + range, false)].map(|(place, starts)| Event { place, starts, index })
    };
    let mut events = memory::with_capacity(2 * values.len())?;
    events.extend((0..).zip(values.iter().zip(ranges)).flat_map(ends));
    events.sort_unstable_by(|a, b| {
        a.place.total_cmp(&b.place).then(b.starts.cmp(&a.starts)).then(a.index.cmp(&b.index))
    });
    Ok(events)
}

/// Running weighted mean, and weighted sum of squared deviations, of a changing set (Welford).
#[derive(Default)]
struct Held {
    members: u32,
    weight: f64,
    mean: f64,
    spread: f64,
}

impl Held {
    fn take_in(&mut self, value: f64, weight: f64) {
        let deviation = value - self.mean;
        self.members += 1;
        self.weight += weight;
        self.mean += weight / self.weight * deviation;
        self.spread += weight * deviation * (value - self.mean);
    }

    fn leave_out(&mut self, value: f64, weight: f64) {
        if self.members <= 1 {
            *self = Self::default(); // without the rounding of removed members
            return;
        }
        let deviation = value - self.mean;
        self.members -= 1;
        self.weight -= weight;
        self.mean -= weight / self.weight * deviation;
        self.spread -= weight * deviation * (value - self.mean);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The least cost of the weighted mean of any set of neighbours in value, by brute force.
    fn plain(values: &[f64], ranges: &[f64]) -> f64 {
        let cost = |x: f64| -> f64 {
            values.iter().zip(ranges).map(|(value, range)| ((x - value) / range).powi(2).min(1.0)).sum()
        };
        (-4000..4000).map(|k| cost(f64::from(k) / 1000.0)).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn costs_no_more_than_any_other_value() -> Result<()> {
        for seed in 0..30 {
            let number = |i: usize, f: f64| (f * i as f64 + f64::from(seed)).sin();
            let values: Vec<f64> = (0..40).map(|i| 2.0 * number(i, 12.9)).collect();
            let ranges: Vec<f64> = (0..40).map(|i| 0.3 + 0.2 * number(i, 7.1)).collect();
            let found = truncated_mean(&values, &ranges)?;
            let cost: f64 = values
                .iter()
                .zip(&ranges)
                .map(|(value, range)| ((found.unwrap_or(f64::NAN) - value) / range).powi(2).min(1.0))
                .sum();
            assert!(cost <= plain(&values, &ranges) + 1e-9, "{seed}");
        }
        Ok(())
    }

    #[test]
    fn the_lowest_of_equal_minima_is_returned() -> Result<()> {
        assert_eq!(truncated_mean(&[5.0, -3.0, 9.0], &[1.0; 3])?, Some(-3.0));
        assert_eq!(truncated_mean(&[5.0, -3.0, 5.5], &[1.0; 3])?, Some(5.25));
        assert_eq!(truncated_mean(&[], &[])?, None);
        Ok(())
    }
}
