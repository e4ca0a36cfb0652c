//! Otsu's threshold on continuous scores: maximizes the separation of two classes.
//!
//! N. Otsu, *A threshold selection method from gray-level histograms*, 1979; the paper, section 3, where SS,
//! SI, CV and GTM "adaptively" choose their threshold with it.

use crate::error::Result;
use crate::memory;
use crate::options::{Kind, OptionType, Value, words};

/// Number of bins of the paper's own routine.
pub const DEFAULT_BINS: usize = 100;

/// Upper bound of the number of bins; more do not separate more scores.
pub const MAX_BINS: u64 = 1_000_000;

/// Scores are equal if their spread is below this share of their magnitude.
const EQUAL_SCORES: f64 = 1e-9;

/// Least relative improvement of a split over an earlier one.
const STRICTLY_BETTER: f64 = 1e-12;

words! {
    /// Candidate thresholds.
    pub enum OtsuMode {
        /// Equal bins between the least and the greatest score; class means from the scores themselves.
        MinMax = Value::Word("minmax"),
        /// Every gap between two distinct scores is a candidate.
        Exact = Value::Word("exact"),
        /// `floor(sqrt(n) + 0.5)` bins over 0..=1 and means of bin indices, as in the code of SI's author.
        Covis = Value::Word("covis"),
        /// Bins whose origin is 0 instead of the least score, as in the evaluation group's later code.
        Legacy = Value::Word("legacy"),
    }
}

/// A threshold of scores.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Threshold {
    /// By Otsu's method.
    #[default]
    Otsu,
    /// At a given value.
    Fixed(f64),
}

impl OptionType for Threshold {
    const KIND: Kind = Kind::Cut;

    fn read(value: Value) -> Option<Self> {
        match value {
            Value::Word("otsu") => Some(Self::Otsu),
            Value::Number(threshold) => Some(Self::Fixed(threshold)),
            _ => None,
        }
    }

    fn value(self) -> Value {
        match self {
            Self::Otsu => Value::Word("otsu"),
            Self::Fixed(threshold) => Value::Number(threshold),
        }
    }
}

/// A selection by score.
#[derive(Debug, Clone, PartialEq)]
pub struct Cut {
    /// Scores above the threshold.
    pub mask: Vec<bool>,
    /// The threshold; `None` if all scores are equal, so that no threshold exists.
    pub threshold: Option<f64>,
}

impl Threshold {
    /// Selects the scores above the threshold; Otsu's uses a mode and the default number of bins. Scores of
    /// minus infinity are never selected.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`](crate::Error::OutOfMemory).
    pub fn above(&self, scores: &[f64], mode: OtsuMode) -> Result<Cut> {
        match *self {
            Self::Fixed(threshold) => cut(scores, threshold),
            Self::Otsu => otsu(scores, mode, DEFAULT_BINS),
        }
    }
}

/// Selects the scores above Otsu's threshold.
///
/// # Errors
/// [`Error::OutOfMemory`](crate::Error::OutOfMemory).
pub fn otsu(scores: &[f64], mode: OtsuMode, bins: usize) -> Result<Cut> {
    let finite = memory::collect(scores.iter().copied().filter(|s| s.is_finite()))?;
    let low = finite.iter().copied().fold(f64::INFINITY, f64::min);
    let high = finite.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if finite.is_empty() || high - low <= EQUAL_SCORES * low.abs().max(high.abs()) {
        // Equal positive scores are equally good; equal scores of zero mean no support.
        let mask = memory::collect(scores.iter().map(|score| score.is_finite() && low > 0.0))?;
        return Ok(Cut { mask, threshold: None });
    }
    let threshold = match mode {
        OtsuMode::MinMax => min_max(&finite, low, high, bins)?,
        OtsuMode::Exact => exact(finite)?,
        OtsuMode::Covis => covis(&finite)?,
        OtsuMode::Legacy => legacy(&finite, low, high, bins)?,
    };
    cut(scores, threshold)
}

fn cut(scores: &[f64], threshold: f64) -> Result<Cut> {
    let mask = memory::collect(scores.iter().map(|&score| score > threshold))?;
    Ok(Cut { mask, threshold: Some(threshold) })
}

/// Count, sum and extremes of the scores in a bin or a class.
#[derive(Debug, Clone, Copy)]
struct Class {
    count: usize,
    sum: f64,
    min: f64,
    max: f64,
}

impl Class {
    const EMPTY: Self = Self { count: 0, sum: 0.0, min: f64::INFINITY, max: f64::NEG_INFINITY };

    fn add(&mut self, score: f64) {
        *self = self.union(Self { count: 1, sum: score, min: score, max: score });
    }

    fn union(self, other: Self) -> Self {
        Self {
            count: self.count + other.count,
            sum: self.sum + other.sum,
            min: self.min.min(other.min),
            max: self.max.max(other.max),
        }
    }

    fn mean(self) -> f64 {
        self.sum / self.count as f64
    }
}

/// Between-class variance up to a constant: `J = n1 n2 (mean1 - mean2)^2`.
fn separation(lower: Class, upper: Class) -> f64 {
    lower.count as f64 * upper.count as f64 * (lower.mean() - upper.mean()).powi(2)
}

/// The split of ordered classes with the greatest separation, the first of equals.
fn best_split(classes: &[Class]) -> Result<Option<(usize, Class, Class)>> {
    // Suffix sums keep the upper class exact; a subtraction would lose digits.
    let mut upper = memory::filled(Class::EMPTY, classes.len() + 1)?;
    for k in (0..classes.len()).rev() {
        upper[k] = upper[k + 1].union(classes[k]);
    }
    let mut lower = Class::EMPTY;
    let mut best = None;
    let mut best_separation = f64::NEG_INFINITY;
    for (k, &class) in classes.iter().enumerate() {
        lower = lower.union(class);
        if lower.count == 0 || upper[k + 1].count == 0 {
            continue;
        }
        let value = separation(lower, upper[k + 1]);
        if value > best_separation + STRICTLY_BETTER * best_separation.abs() || best.is_none() {
            best_separation = value;
            best = Some((k, lower, upper[k + 1]));
        }
    }
    Ok(best)
}

fn histogram(scores: &[f64], bins: usize, bin_of: impl Fn(f64) -> f64) -> Result<Vec<Class>> {
    let mut classes = memory::filled(Class::EMPTY, bins)?;
    for &score in scores {
        // A negative bin saturates to 0 in the cast.
        classes[(bin_of(score) as usize).min(bins - 1)].add(score);
    }
    Ok(classes)
}

fn min_max(scores: &[f64], low: f64, high: f64, bins: usize) -> Result<f64> {
    let width = (high - low) / bins as f64;
    let classes = histogram(scores, bins, |score| (score - low) / width)?;
    Ok(best_split(&classes)?.map_or(low, |(_, lower, upper)| midpoint(lower.max, upper.min)))
}

fn exact(mut scores: Vec<f64>) -> Result<f64> {
    scores.sort_unstable_by(f64::total_cmp);
    let mut classes: Vec<Class> = Vec::new();
    for &score in &scores {
        match classes.last_mut() {
            Some(class) if class.max >= score => class.add(score),
            _ => memory::push(&mut classes, Class { count: 1, sum: score, min: score, max: score })?,
        }
    }
    Ok(best_split(&classes)?.map_or(scores[0], |(_, lower, upper)| midpoint(lower.max, upper.min)))
}

/// Midpoint that stays strictly below `upper`, so that `>` and `>=` select the same scores.
fn midpoint(lower: f64, upper: f64) -> f64 {
    let middle = lower + (upper - lower) / 2.0;
    if middle < upper { middle } else { lower }
}

fn covis(scores: &[f64]) -> Result<f64> {
    let bins = ((scores.len() as f64).sqrt() + 0.5) as usize;
    if bins < 2 {
        return Ok(0.0);
    }
    let clamped = |score: f64| (score * bins as f64).clamp(0.0, bins as f64 - 1.0).floor();
    let mut classes = memory::filled(Class::EMPTY, bins)?;
    for &score in scores {
        let bin = clamped(score);
        classes[bin as usize].add(bin);
    }
    Ok(best_split(&classes)?.map_or(0.0, |(k, _, _)| k as f64 / (bins - 1) as f64))
}

fn legacy(scores: &[f64], low: f64, high: f64, bins: usize) -> Result<f64> {
    let step = (high - low) / bins as f64;
    let classes = histogram(scores, bins, |score| score / step)?;
    Ok(best_split(&classes)?.map_or((high - low) / 2.0, |(k, _, _)| k as f64 * step))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut_by(scores: &[f64], mode: OtsuMode) -> Result<Cut> {
        otsu(scores, mode, DEFAULT_BINS)
    }

    #[test]
    fn two_clusters_split_half_way() -> Result<()> {
        let scores = [0.1, 0.2, 0.15, 0.9, 0.8];
        for mode in [OtsuMode::MinMax, OtsuMode::Exact] {
            let Cut { mask, threshold } = cut_by(&scores, mode)?;
            let threshold = threshold.unwrap_or_default();
            assert_eq!(mask, [false, false, false, true, true]);
            assert!((threshold - 0.5).abs() < 1e-15, "{threshold}");
        }
        Ok(())
    }

    #[test]
    fn equal_scores_are_all_or_nothing() -> Result<()> {
        assert_eq!(cut_by(&[2.0; 3], OtsuMode::MinMax)?.mask, [true; 3]);
        assert_eq!(cut_by(&[0.0; 3], OtsuMode::MinMax)?.mask, [false; 3]);
        assert_eq!(cut_by(&[-1.0; 3], OtsuMode::MinMax)?.mask, [false; 3]);
        assert_eq!(cut_by(&[1e-5, 1e-5 * (1.0 + 1e-12)], OtsuMode::MinMax)?.mask, [true; 2]);
        assert!(cut_by(&[], OtsuMode::MinMax)?.mask.is_empty());
        Ok(())
    }

    #[test]
    fn missing_scores_are_ignored() -> Result<()> {
        let cut = cut_by(&[f64::NEG_INFINITY, 0.1, 0.9], OtsuMode::MinMax)?;
        assert_eq!(cut.mask, [false, false, true]);
        assert!((cut.threshold.unwrap_or_default() - 0.5).abs() < 1e-15);
        Ok(())
    }

    #[test]
    fn adjacent_floats_are_split() -> Result<()> {
        let low = 1e-300;
        let cut = cut_by(&[low, 3.0 * low], OtsuMode::MinMax)?;
        assert_eq!(cut.mask, [false, true]);
        Ok(())
    }

    #[test]
    fn covis_cuts_on_bin_indices() -> Result<()> {
        // n = 9 gives 3 bins; the best split is after bin 0: t = 0 / 2.
        let cut = cut_by(&[0.0, 0.1, 0.2, 0.3, 0.1, 0.9, 1.0, 0.8, 0.9], OtsuMode::Covis)?;
        assert!(cut.threshold.is_some_and(|t| t.abs() < 1e-15));
        assert_eq!(cut.mask.iter().filter(|&&m| m).count(), 8);
        Ok(())
    }

    #[test]
    fn legacy_ignores_the_offset() -> Result<()> {
        // Bins of width 0.001 from 0: every score above 0.1 falls in the last bin, no split exists.
        let cut = cut_by(&[0.5, 0.55, 0.6], OtsuMode::Legacy)?;
        assert!((cut.threshold.unwrap_or_default() - 0.05).abs() < 1e-12);
        assert_eq!(cut.mask, [true; 3]);
        Ok(())
    }
}
