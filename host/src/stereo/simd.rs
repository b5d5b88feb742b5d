//! Sets of vector instructions, detected at run time.
//!
//! The only unsafe code makes the tokens of the core's kernels, once the features that they need are
//! detected.
#![allow(unsafe_code)]

use std::fmt;

#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
use multiscopic_core::kernel::Neon;
#[cfg(target_arch = "x86_64")]
use multiscopic_core::kernel::{Avx2, Avx512};
use multiscopic_core::kernel::{Blocks, Portable};

use super::lanes::Vectors;

/// The portable kernel, with lanes that the compiler vectorises on any processor.
type Baseline = Portable<8>;

/// Whether this processor has a feature that a kernel needs.
#[cfg(target_arch = "x86_64")]
fn is_detected(feature: &str) -> bool {
    macro_rules! detect {
        ($($name:tt)+) => {
            match feature {
                $($name => is_x86_feature_detected!($name),)+
                _ => unreachable!("a kernel needs {feature}, which is not detected here"),
            }
        };
    }
    detect!("avx2" "avx512f" "avx512bw" "avx512dq" "avx512vl" "bmi1" "bmi2" "lzcnt" "popcnt")
}

/// A set of vector instructions that this processor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Simd(Level);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
    Neon,
    Baseline,
}

/// A computation that is generic over the core's sets of vector instructions.
pub trait Task {
    /// Its result.
    type Output;

    /// Computes it with `isa`.
    fn run<I: Blocks<u16> + Blocks<u32> + Vectors>(self, isa: I) -> Self::Output;
}

impl Simd {
    /// The instructions that every processor of this architecture has.
    pub const BASELINE: Simd = Simd(Level::Baseline);

    /// All sets that this processor has, the widest first.
    pub fn available() -> Vec<Simd> {
        let mut levels = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            if Avx512::FEATURES.iter().copied().all(is_detected) {
                levels.push(Simd(Level::Avx512));
            }
            if Avx2::FEATURES.iter().copied().all(is_detected) {
                levels.push(Simd(Level::Avx2));
            }
        }
        #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
        levels.push(Simd(Level::Neon));
        levels.push(Simd::BASELINE);
        levels
    }

    /// The fastest set for a number of disparities: the widest of which more than half of the lanes are used.
    pub fn fastest(num_disparities: usize) -> Simd {
        let available = Simd::available();
        available.iter().copied().find(|simd| num_disparities > simd.lanes() / 2).unwrap_or(available[available.len() - 1])
    }

    /// The number of disparities that are computed at a time.
    fn lanes(self) -> usize {
        self.run(CountLanes)
    }

    /// The set called `name`, if this processor has it.
    pub fn named(name: &str) -> Option<Simd> {
        Simd::available().into_iter().find(|simd| simd.to_string() == name)
    }

    /// Runs `task` with this set.
    pub fn run<T: Task>(self, task: T) -> T::Output {
        match self.0 {
            // SAFETY: `available` has detected every feature that the token names, and nothing else makes
            // this level.
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => task.run(unsafe { Avx512::new() }),
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => task.run(unsafe { Avx2::new() }),
            #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
            Level::Neon => task.run(Neon),
            Level::Baseline => task.run(Baseline::default()),
        }
    }
}

impl fmt::Display for Simd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => "avx512",
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => "avx2",
            #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
            Level::Neon => "neon",
            Level::Baseline => "baseline",
        })
    }
}

/// Counts the disparities that are computed at a time.
struct CountLanes;

impl Task for CountLanes {
    type Output = usize;

    fn run<I: Blocks<u16> + Blocks<u32> + Vectors>(self, _isa: I) -> usize {
        I::LANES
    }
}
