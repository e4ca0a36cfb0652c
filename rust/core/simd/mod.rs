//! Vector code written once: a [`Kernel`] is compiled for every instruction set, and [`run`] selects the best
//! one of this machine.

pub mod arithmetic;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod dispatch;
mod lanes;
mod portable;
pub mod sums;

#[cfg(test)]
pub use dispatch::run_on_each;
pub use dispatch::{Kernel, run};
pub use lanes::{DOUBLES, Lanes, SINGLES};

/// A value aligned to a cache line, so that no group of numbers in it straddles two.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub struct Aligned<T>(pub T);
