//! The nine grouping methods of the paper, one file each.

use crate::{Correspondences, Execution, Grouping, Result};

/// A way to tell right correspondences from wrong ones.
pub trait GroupingMethod {
    /// Selects the correspondences that this method holds to be right.
    ///
    /// # Errors
    /// Options out of range, a field the method needs that is missing, or an interruption.
    fn group(&self, correspondences: &Correspondences, execution: &Execution) -> Result<Grouping>;
}
