//! Share of the source points that a pose moves near the target of any match.

use rayon::prelude::*;

use crate::error::Result;
use crate::execution::Execution;
use crate::geometry::ball_search::BallSearch;
use crate::geometry::rigid::Rigid;
use crate::memory;
use crate::points::Points;

/// Source points sampled, evenly spread over the input.
const SAMPLES: usize = 1_000;

/// Positions of the moved source points relative to the targets.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Landing {
    /// Share of them near any target.
    pub coverage: f64,
    /// Mean number of targets near each: if matches ended at random on the targets' places, this many would
    /// support the pose.
    pub chance: f64,
}

/// Measures, for each pose, how the moved source points lie within `radius` of targets.
///
/// # Errors
/// [`crate::Error::InvalidInput`] unless the radius is positive; [`crate::Error::Interrupted`],
/// [`crate::Error::OutOfMemory`].
pub fn landings(
    poses: &[Rigid],
    source: &Points,
    target: &Points,
    radius: f64,
    execution: &Execution,
) -> Result<Vec<Landing>> {
    let n = source.len();
    let count = n.min(SAMPLES);
    let samples = memory::collect((0..count).map(|k| source.get(k * n / count)))?;
    let search = BallSearch::for_counts(target, radius)?;
    let land = |pose: &Rigid| {
        execution.check()?;
        let (mut covered, mut near) = (0, 0);
        for sample in &samples {
            let found = search.count(&pose.apply(sample));
            covered += usize::from(found > 0);
            near += found;
        }
        let share = |total: usize| total as f64 / count.max(1) as f64;
        Ok(Landing { coverage: share(covered), chance: share(near) })
    };
    memory::par_try_collect(poses.par_iter().map(land))
}
