//! The nine grouping methods of the paper, one file each; the files know nothing of each other.

pub mod consistency_voting;
pub mod game_theory;
pub mod geometric_consistency;
pub mod hough_voting;
pub mod nearest_neighbor_ratio;
pub mod ransac;
pub mod search_of_inliers;
pub mod similarity_score;
pub mod spectral;

use crate::{Correspondences, Execution, Grouping, Result};

/// A way to tell right correspondences from wrong ones.
pub trait GroupingMethod {
    /// Selects the correspondences that this method holds to be right.
    ///
    /// # Errors
    /// Options out of range, a field the method needs that is missing, or an interruption.
    fn group(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping>;

    /// Whether the group is found within a millisecond, so that handing it to another thread costs more than it saves.
    fn is_instant(&self, _correspondences: &Correspondences) -> bool {
        false
    }
}
