//! Wall time of the stages of a search.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Stages of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Voxels, normals, frames, descriptors, surfaces.
    Levels,
    /// Nearest descriptors.
    Matching,
    /// Groups of matches, and parts.
    Grouping,
    /// Verification of poses on the surfaces.
    Verification,
    /// Alignment on the fine surfaces.
    Refinement,
    /// Evidence, open motions, scale, overlap.
    Evidence,
}

/// Names of the stages, in order.
pub const STAGES: [&str; 6] = ["levels", "matching", "grouping", "verification", "refinement", "evidence"];

/// Adds up the time of each stage.
#[derive(Debug)]
pub struct Clock(Mutex<(Instant, [f64; STAGES.len()])>);

impl Default for Clock {
    fn default() -> Self {
        Self(Mutex::new((Instant::now(), [0.0; STAGES.len()])))
    }
}

impl Clock {
    /// Adds the time since the last call to a stage.
    pub fn end(&self, stage: Stage) {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        known.1[stage as usize] += (now - known.0).as_secs_f64();
        known.0 = now;
    }

    /// Returns the seconds of each stage.
    pub fn seconds(&self) -> [f64; STAGES.len()] {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).1
    }
}
