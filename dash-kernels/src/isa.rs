//! Runtime choice of the instruction set for the CPU kernels.
//!
//! Kernels are plain loops over lane arrays that LLVM vectorises; compiling each body once per
//! instruction set lets one binary use AVX-512 where the machine has it. Products and sums are
//! fused where `mul_add` says so and nowhere else, so every instruction set gives the same bits.
//!
//! `pulp`'s own AVX-512 arm needs its `x86-v4` feature, which would rebuild Burn's matrix
//! multiplication for every user; the two arms here cost a dozen lines.

/// A loop to be compiled for every instruction set.
///
/// Implement `run` (and everything it calls in its hot loop) as `#[inline(always)]`: a function
/// that is not inlined keeps the baseline instruction set.
pub(crate) trait Kernel {
    /// What the loop returns.
    type Output;
    /// The loop.
    fn run(self) -> Self::Output;
}

/// Runs `kernel` with the best instruction set of this machine.
pub(crate) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
        {
            // SAFETY: the features that `run_avx512` enables were just detected.
            return unsafe { run_avx512(kernel) };
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: the features that `run_avx2` enables were just detected.
            return unsafe { run_avx2(kernel) };
        }
    }
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

/// The value, or zero where it is infinite or not a number.
#[inline(always)]
pub(crate) fn finite_or_zero(value: f32) -> f32 {
    if value.abs() < f32::INFINITY {
        value
    } else {
        0.0
    }
}
