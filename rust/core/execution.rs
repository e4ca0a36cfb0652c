//! Control of a computation: interruption, progress and memory bound.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::error::{Error, Result};

/// Memory of pairwise matrices unless the caller sets a bound: 1 GiB.
pub const DEFAULT_MAX_MEMORY: usize = 1 << 30;

/// Shared between the computing thread and the waiting one.
#[derive(Debug)]
pub struct Execution {
    interrupted: AtomicBool,
    stopped: AtomicBool,
    done: AtomicUsize,
    total: AtomicUsize,
    /// Most bytes of a dense pairwise matrix; larger ones are recomputed row by row.
    pub max_memory: usize,
}

impl Default for Execution {
    fn default() -> Self {
        Self::new(DEFAULT_MAX_MEMORY)
    }
}

impl Execution {
    /// A run whose pairwise matrices take at most `max_memory` bytes.
    pub fn new(max_memory: usize) -> Self {
        Self {
            interrupted: AtomicBool::new(false),
            stopped: AtomicBool::new(false),
            done: AtomicUsize::new(0),
            total: AtomicUsize::new(1),
            max_memory,
        }
    }

    /// Requests an interruption; the computation returns [`Error::Interrupted`] soon after.
    pub fn interrupt(&self) {
        self.interrupted.store(true, Ordering::Relaxed);
    }

    /// Checks for an interruption. Every long loop calls this at least every few milliseconds.
    ///
    /// # Errors
    /// [`Error::Interrupted`] once [`Self::interrupt`] was called.
    pub fn check(&self) -> Result<()> {
        if self.interrupted.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        Ok(())
    }

    /// Requests an early end of a search that supports it; the search returns its best result so far.
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// Whether [`Self::stop`] was called. A search that supports it checks often. Its result then depends on
    /// the time, and it must report that it stopped early.
    pub fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    /// Reports that `done` of `total` equal steps are complete, and checks for an interruption.
    ///
    /// # Errors
    /// [`Error::Interrupted`] once [`Self::interrupt`] was called.
    pub fn report(&self, done: usize, total: usize) -> Result<()> {
        self.total.store(total.max(1), Ordering::Relaxed);
        self.done.store(done, Ordering::Relaxed);
        self.check()
    }

    /// Reports one more completed step of those last announced by [`Self::report`], and checks for an
    /// interruption; for loops whose steps end in any order.
    ///
    /// # Errors
    /// [`Error::Interrupted`] once [`Self::interrupt`] was called.
    pub fn advance(&self) -> Result<()> {
        self.done.fetch_add(1, Ordering::Relaxed);
        self.check()
    }

    /// Share of the work done, in 0..=1.
    pub fn progress(&self) -> f64 {
        let total = self.total.load(Ordering::Relaxed) as f64;
        (self.done.load(Ordering::Relaxed) as f64 / total).min(1.0)
    }
}
