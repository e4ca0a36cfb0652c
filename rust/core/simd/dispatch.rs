//! Runs a kernel compiled for the best instruction set of this machine: AVX-512, AVX2 with FMA, or plain
//! arrays.

#![expect(clippy::inline_always, reason = "only inlined code is compiled for the chosen instruction set")]

use pulp::Arch;

#[cfg(target_arch = "x86_64")]
use super::avx2::Avx2;
#[cfg(target_arch = "x86_64")]
use super::avx512::Avx512;
use super::lanes::Lanes;
use super::portable::Portable;

/// An inner loop that is compiled once for every instruction set. A closure implements it: plain loops that
/// the compiler vectorizes. If it does not, or if a fused product matters, a struct implements it with the
/// [`Lanes`] that it is given.
pub trait Kernel {
    /// Its result.
    type Output;
    /// Runs the kernel. It and every closure and function in it must be `#[inline(always)]`: code that is not
    /// inlined is compiled for the baseline.
    fn run<L: Lanes>(self, lanes: L) -> Self::Output;
}

/// Not for `FnOnce`: calling a borrowing closure through it uses a function that is not inlined.
impl<R, F: FnMut() -> R> Kernel for F {
    type Output = R;

    #[inline(always)]
    fn run<L: Lanes>(mut self, _: L) -> R {
        self()
    }
}

/// Runs the kernel with the best instruction set of this machine.
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

/// The results of a kernel in every instruction set of this machine; first that of plain arrays.
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
