//! NNSR: selects the correspondences whose nearest descriptor is clearly nearer than the second nearest.
//!
//! The paper, section 3.1, Eq. (2) (after Lowe, IJCV 2004): the score `1 - d1/d2` measures distinctiveness;
//! the bound 0.8 of the paper's Table 1 is Lowe's bound on the ratio itself. Cost O(n).

use super::GroupingMethod;
use crate::options::{SHARE, method};
use crate::rule::{Kind, Rule};
use crate::{Correspondences, Execution, Grouping, Result, memory};

method! {
    /// Parameters of the nearest-neighbour similarity ratio.
    pub struct NearestNeighborRatio = "nnsr", ["ratio"], optional [], {
        /// Greatest accepted ratio.
        pub max_ratio: f64 = 0.8, SHARE;
    }
}

impl GroupingMethod for NearestNeighborRatio {
    fn run(&self, correspondences: &Correspondences, _: &Execution) -> Result<Grouping> {
        let ratio = correspondences.ratio("nnsr")?;
        Ok(Grouping {
            mask: memory::collect(ratio.iter().map(|&r| r <= self.max_ratio))?, // Eq. (2), solved for the ratio
            scores: Some(memory::collect(ratio.iter().map(|r| 1.0 - r))?),      // left side of Eq. (2)
            threshold: Some(1.0 - self.max_ratio),
            rule: Rule::bounded(Kind::Ratio, self.max_ratio).or_equal(),
            ..Grouping::default()
        })
    }

    fn is_instant(&self, _: &Correspondences) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accepts_ratios_up_to_the_bound() -> Result<()> {
        let input = Correspondences::without_positions(3).with_ratio(vec![0.8, 0.81, 0.0])?;
        let group = NearestNeighborRatio::default().group(&input, &Execution::default())?;
        assert_eq!(group.mask, [true, false, true]);
        Ok(())
    }

    #[test]
    fn refuses_a_bound_above_one() -> Result<()> {
        let input = Correspondences::without_positions(1).with_ratio(vec![0.5])?;
        assert!(NearestNeighborRatio { max_ratio: 1.5 }.group(&input, &Execution::default()).is_err());
        Ok(())
    }
}
