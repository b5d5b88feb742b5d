//! Sums of products of floats.
//!
//! The loops are plain Rust, compiled for each set of vector instructions. Sums are fused multiply-adds in a fixed order, so all
//! vectors that have these give the same bits: AVX2, AVX-512 and Neon. Other processors round each product too.

use std::fmt;

/// A computation of sums of products, compiled for each set of instructions.
pub trait FloatTask {
    /// Computes it. Sums of `POSITIONS` x `PART` outputs, an input and its weights fill the registers. With `FUSED`, a sum
    /// takes a product without rounding it.
    fn run<const FUSED: bool, const POSITIONS: usize, const PART: usize>(self);
}

/// Instructions for sums of products of floats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FloatSums(Instructions);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Instructions {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Fma,
    #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
    Neon,
    Plain,
}

impl FloatSums {
    /// All that this processor has, the widest first.
    pub fn available() -> impl Iterator<Item = FloatSums> {
        let all = [
            #[cfg(target_arch = "x86_64")]
            is_x86_feature_detected!("avx512f").then_some(Instructions::Avx512),
            #[cfg(target_arch = "x86_64")]
            (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Instructions::Fma),
            #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
            Some(Instructions::Neon),
            Some(Instructions::Plain),
        ];
        all.into_iter().flatten().map(FloatSums)
    }

    /// Runs `task` with these instructions.
    pub fn run<T: FloatTask>(self, task: T) {
        match self.0 {
            // SAFETY: `available` has detected the instructions, and nothing else makes this value.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => unsafe { run_with_avx512(task) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Instructions::Fma => unsafe { run_with_fma(task) },
            #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
            Instructions::Neon => task.run::<true, 6, 16>(),
            Instructions::Plain => task.run::<false, 6, 8>(),
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f")]
fn run_with_avx512<T: FloatTask>(task: T) {
    // 32 registers hold 28 vectors of sums, 2 of weights and an input.
    task.run::<true, 14, 32>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn run_with_fma<T: FloatTask>(task: T) {
    // 16 registers hold 12 vectors of sums, 2 of weights and an input.
    task.run::<true, 6, 16>();
}

impl fmt::Display for FloatSums {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => "avx512",
            #[cfg(target_arch = "x86_64")]
            Instructions::Fma => "fma",
            #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
            Instructions::Neon => "neon",
            Instructions::Plain => "plain",
        })
    }
}
