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
use multiscopic_core::kernel::{Isa, Kernel, Portable};

/// The portable kernel, which the compiler vectorises on any processor. The samples of a vector fill a register of 16 bytes. It
/// goes pixel by pixel, as on a microcontroller: each loop of a fallback is compiled too. [`simulate`](crate::simulate) shares
/// them.
pub(crate) type Baseline = Portable<16>;

/// Returns true if this processor has a feature that a kernel needs.
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

/// A set of vector instructions that this processor has, found at run time.
///
/// Results do not depend on the set, only the time does. An [`Engine`](crate::Engine) takes the [`fastest`](Simd::fastest) for
/// each search unless it is given one of the [`available`](Simd::available), for example [by name](Simd::named). To run a
/// kernel of your own, implement [`Task`] and call [`run`](Simd::run).
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
    fn run<I: Kernel>(self, isa: I) -> Self::Output;
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

    /// The fastest set for a number of disparities: the one with the fewest vectors for them, and of several
    /// the one with the fewest lanes.
    ///
    /// A vector takes about as many instructions with any set, however many of its lanes are used, so the time
    /// follows the number of vectors. Where that is the same, fewer lanes take less memory. No search has more
    /// vectors, or as many but wider ones, than a larger search.
    ///
    /// The baseline lacks instructions that the other sets have. It is for processors without any of them.
    pub fn fastest(num_disparities: usize) -> Simd {
        Simd::fastest_of(&Simd::available(), num_disparities)
    }

    /// The [`fastest`](Simd::fastest) of `available` sets.
    fn fastest_of(available: &[Simd], num_disparities: usize) -> Simd {
        let sets = available.iter().copied().filter(|&simd| simd != Simd::BASELINE);
        sets.min_by_key(|simd| (num_disparities.div_ceil(simd.lanes()), simd.lanes())).unwrap_or(Simd::BASELINE)
    }

    /// The number of disparities in a vector.
    pub fn lanes(self) -> usize {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => Avx512::LANES,
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => Avx2::LANES,
            #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
            Level::Neon => Neon::LANES,
            Level::Baseline => Baseline::LANES,
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_search_has_more_vectors_than_a_larger_one() {
        #[cfg(target_arch = "x86_64")]
        let wide = [Simd(Level::Avx512), Simd(Level::Avx2), Simd::BASELINE];
        #[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
        let wide = [Simd(Level::Neon), Simd::BASELINE];
        #[cfg(not(any(target_arch = "x86_64", all(target_arch = "aarch64", target_feature = "neon"))))]
        let wide = [Simd::BASELINE];
        // Each processor has the sets from one of them on.
        for first in 0..wide.len() {
            let available = &wide[first..];
            let mut smaller = (0, 0);
            for num_disparities in 1..=512 {
                let simd = Simd::fastest_of(available, num_disparities);
                let vectors = (num_disparities.div_ceil(simd.lanes()), simd.lanes());
                assert!(
                    smaller <= vectors,
                    "{num_disparities} disparities in {vectors:?}, one less in {smaller:?} with {available:?}"
                );
                assert_eq!(simd == Simd::BASELINE, available.len() == 1, "{num_disparities} disparities with {available:?}");
                smaller = vectors;
            }
        }
    }
}
