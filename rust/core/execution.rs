//! How a computation runs: it can be interrupted, reports its progress, and keeps to a memory bound.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crate::error::{Error, Result};

/// Memory that pairwise matrices may take when the caller names no bound: 1 GiB.
pub const DEFAULT_MAX_MEMORY: usize = 1 << 30;

/// Shared between the thread that computes and the one that waits.
#[derive(Debug)]
pub struct Execution {
    interrupted: AtomicBool,
    stopped: AtomicBool,
    done: AtomicUsize,
    total: AtomicUsize,
    /// Bytes that a dense pairwise matrix may take; larger ones are recomputed row by row.
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

    /// Asks the computation to stop; it returns [`Error::Interrupted`] soon after.
    pub fn interrupt(&self) {
        self.interrupted.store(true, Ordering::Relaxed);
    }

    /// To be called by every long loop, at least every few milliseconds.
    ///
    /// # Errors
    /// [`Error::Interrupted`] once [`Self::interrupt`] was called.
    pub fn check(&self) -> Result<()> {
        if self.interrupted.load(Ordering::Relaxed) {
            return Err(Error::Interrupted);
        }
        Ok(())
    }

    /// Asks a search that may end early to do so, with the best that it has found: its time is over.
    pub fn stop(&self) {
        self.stopped.store(true, Ordering::Relaxed);
    }

    /// Whether [`Self::stop`] was called. A search that may end early looks often; what it found by then depends on the
    /// time, and it has to say that it was cut short.
    pub fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }

    /// Says that `done` of `total` equal steps are behind us, and checks for an interruption.
    ///
    /// # Errors
    /// [`Error::Interrupted`] once [`Self::interrupt`] was called.
    pub fn report(&self, done: usize, total: usize) -> Result<()> {
        self.total.store(total.max(1), Ordering::Relaxed);
        self.done.store(done, Ordering::Relaxed);
        self.check()
    }

    /// Says that one more of the steps last announced by [`Self::report`] is behind us, and checks for an
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
