//! Runs a kernel compiled for the best instruction set of this machine: AVX-512, AVX2 with FMA, or plain arrays.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use pulp::Arch;

#[cfg(target_arch = "x86_64")]
use super::avx2::Avx2;
#[cfg(target_arch = "x86_64")]
use super::avx512::Avx512;
use super::lanes::Lanes;
use super::portable::Portable;

/// An inner loop that is compiled once for every instruction set. A closure is one: plain loops, which the
/// compiler turns into vector code. Where it does not, or where a fused product matters, a struct is one
/// that works with the [`Lanes`] it is given.
pub trait Kernel {
    /// What it results in.
    type Output;
    /// Does the work. Has to be `#[inline(always)]`, and so has every closure and function in it: what is
    /// not inlined is compiled for the baseline.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// Not of `FnOnce`: calling a closure that only borrows as one goes through a function that is not inlined.
impl<R, F: FnMut() -> R> Kernel for F {
    type Output = R;

    #[inline(always)]
    fn run<L: Lanes>(mut self, _: L) -> R {
        self()
    }
}

/// Runs the kernel with the best instructions of this machine.
#[inline(always)]
pub fn run<K: Kernel>(kernel: K) -> K::Output {
    match Arch::new() {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(simd) => simd.vectorize(
            #[inline(always)]
            || kernel.run(Avx512(simd)),
        ),
        #[cfg(target_arch = "x86_64")]
        Arch::V3(simd) => simd.vectorize(
            #[inline(always)]
            || kernel.run(Avx2(simd)),
        ),
        _ => kernel.run(Portable),
    }
}

/// The results of a kernel in every instruction set that this machine has; first that of plain arrays.
#[cfg(test)]
pub fn run_on_each<K: Kernel + Copy>(kernel: K) -> Vec<K::Output> {
    let mut results = vec![kernel.run(Portable)];
    #[cfg(target_arch = "x86_64")]
    {
        let avx2 = pulp::x86::V3::try_new().map(|simd| simd.vectorize(|| kernel.run(Avx2(simd))));
        let avx512 = pulp::x86::V4::try_new().map(|simd| simd.vectorize(|| kernel.run(Avx512(simd))));
        results.extend(avx2.into_iter().chain(avx512));
    }
    results
}
