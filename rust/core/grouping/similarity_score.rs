//! SS: selects the correspondences with sufficiently similar descriptors.
//!
//! The paper, section 3.1, Eq. (1): `s_i = 1 - |f_i - f'_i|` on unit descriptors, selected above a threshold
//! by Otsu's method. Cost O(n).

use super::GroupingMethod;
use crate::options::{at_most, method};
use crate::rule::{Kind, Rule};
use crate::selection::otsu::{Cut, DEFAULT_BINS, MAX_BINS, OtsuMode, Threshold, otsu};
use crate::{Correspondences, Execution, Grouping, Result, memory};

method! {
    /// Parameters of the similarity score.
    pub struct SimilarityScore = "ss", ["similarity"], optional [], {
        /// Least accepted similarity.
        pub threshold: Threshold = Threshold::Otsu;
        /// Candidates of Otsu's threshold: equal bins between the least and the greatest score; every gap
        /// between scores; as in the code of SI's author, for scores from 0 to 1; or as in the evaluation
        /// group's later code.
        pub otsu: OtsuMode = OtsuMode::default();
        /// Bins of the "minmax" and "legacy" modes.
        pub bins: usize = DEFAULT_BINS, at_most(MAX_BINS);
    }
}

impl GroupingMethod for SimilarityScore {
    fn run(&self, correspondences: &Correspondences, _: &Execution) -> Result<Grouping> {
        let scores = correspondences.similarity("ss")?; // 1 - |f - f'|, left side of Eq. (1)
        let rule = Rule::new(Kind::Score);
        let (Cut { mask, threshold }, rule) = match self.threshold {
            Threshold::Otsu => (otsu(scores, self.otsu, self.bins)?, rule),
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
        let method = SimilarityScore { threshold: Threshold::Fixed(0.5), ..SimilarityScore::default() };
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
