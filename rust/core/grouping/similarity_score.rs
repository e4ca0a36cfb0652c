//! SS: keep the correspondences whose descriptors are similar enough.
//!
//! The paper, section 3.1, Eq. (1): `s_i = 1 - |f_i - f'_i|` on unit descriptors, selected above a threshold
//! that Otsu's method sets. Cost O(n).

use super::GroupingMethod;
use crate::rule::{Kind, Rule};
use crate::selection::otsu::{Cut, Threshold};
use crate::{Correspondences, Execution, Grouping, Result, memory};

/// Parameters of the similarity score.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SimilarityScore {
    /// Cut on the similarity; a fixed value is itself accepted.
    pub threshold: Threshold,
}

impl GroupingMethod for SimilarityScore {
    fn group(&self, correspondences: &Correspondences, _: &Execution) -> Result<Grouping> {
        self.threshold.validate()?;
        let scores = correspondences.similarity("ss")?; // 1 - |f - f'|, left side of Eq. (1)
        let rule = Rule::new(Kind::Score);
        let (Cut { mask, threshold }, rule) = match self.threshold {
            Threshold::Otsu(_) => (self.threshold.above(scores)?, rule),
            Threshold::Fixed(value) => (at_least(scores, value)?, rule.or_equal()),
        }; // Eq. (1)
        let scores = Some(memory::copied(scores)?);
        Ok(Grouping { mask, scores, threshold, ..Grouping::default() }.by(rule))
    }

    fn is_instant(&self, _: &Correspondences) -> bool {
        true
    }
}

fn at_least(scores: &[f64], threshold: f64) -> Result<Cut> {
    let mask = memory::collect(scores.iter().map(|&s| s >= threshold && s.is_finite()))?;
    Ok(Cut { mask, threshold: Some(threshold) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fixed_threshold_accepts_equality() -> Result<()> {
        let input = Correspondences::without_positions(4).with_similarity(vec![
            0.5,
            0.4999,
            0.9,
            f64::NEG_INFINITY,
        ])?;
        let method = SimilarityScore { threshold: Threshold::Fixed(0.5) };
        assert_eq!(method.group(&input, &Execution::default())?.mask, [true, false, true, false]);
        Ok(())
    }

    #[test]
    fn otsu_splits_two_clusters() -> Result<()> {
        let input = Correspondences::without_positions(4).with_similarity(vec![0.1, 0.8, 0.2, 0.9])?;
        let group = SimilarityScore::default().group(&input, &Execution::default())?;
        assert_eq!(group.mask, [false, true, false, true]);
        assert!(group.threshold.is_some_and(|t| (t - 0.5).abs() < 1e-12));
        Ok(())
    }
}
