//! Runs work compiled for the best instruction set of this machine.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use pulp::Arch;

/// Runs `work` compiled for the best instruction set of this machine. Mark the closure
/// `#[inline(always)]`: one that is not inlined is compiled for the least common denominator.
#[inline(always)]
pub fn dispatch<R>(work: impl FnOnce() -> R) -> R {
    Arch::new().dispatch(work)
}
