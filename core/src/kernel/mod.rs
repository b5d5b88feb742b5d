//! The inner loops of the matcher, along the disparities: one definition over the vectors of any instruction
//! set.
//!
//! An instruction set is a type that implements [`Isa`] and [`Blocks`] with the few operations that the loops
//! consist of. [`Portable`] does so in plain Rust, and defines what the operations mean. Each module knows only
//! those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `isa` | instruction sets, their lanes, and vectors of column sums and costs: [`Isa`], [`Lane`], [`Column`], [`Block`] |
//! | `rule` | the fusion rules in lanes: [`Rule`] |
//! | `steps` | the samples of a line, and steps along it from column to column: [`Steps`] |
//! | `blocks` | the inner loops, and masks that hide block sums where a view is not available: [`Blocks`] |
//! | `bytes` | costs in 8-bit lanes, and their loops: [`Bytes`], [`PixelLoops`], [`RunLoops`] |
//! | `batch` | batches of pixels with their block sums in registers, and winner-takes-all over them |
//! | `portable` | plain Rust over arrays: [`Portable`] |
//! | `x86` | `Avx2` and `Avx512` |
//! | `aarch64` | `Neon` |
//! | `arm` | `Dsp` and `Mve`, for microcontrollers |
//!
//! [`Native`] is the one that the target is compiled for.

// First: modules see its macro only if it stands before them.
#[macro_use]
mod isa;

#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
mod aarch64;
#[cfg(multiscopic_dsp)]
mod arm;
mod batch;
mod blocks;
mod bytes;
mod portable;
mod rule;
mod steps;
#[cfg(target_arch = "x86_64")]
mod x86;

#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
pub use aarch64::Neon;
#[cfg(multiscopic_dsp)]
pub use arm::Dsp;
#[cfg(multiscopic_mve)]
pub use arm::Mve;
pub(crate) use batch::{Batch, Winners};
pub use blocks::Blocks;
pub(crate) use blocks::Masks;
pub use bytes::{
    BackwardRun, ByteVector, Bytes, CandidateRun, Candidates, DistanceFusion, Divisor, ForwardRun, Kernel, LinePath, PixelLoops,
    PixelPaths, RunLoops, RunPenalties, Slot, Step, as_vectors, as_vectors_mut, hamming_run, mean_of_inliers, trimmed_mean,
};
pub use isa::{Block, Change, Column, Isa, Lane, MAX_BATCH, Work};
pub use portable::Portable;
pub use rule::Rule;
pub(crate) use steps::Samples;
pub use steps::Steps;
#[cfg(target_arch = "x86_64")]
pub use x86::{Avx2, Avx512};

#[cfg(multiscopic_mve)]
type KernelOfTarget = Mve;
#[cfg(all(multiscopic_dsp, not(multiscopic_mve)))]
type KernelOfTarget = Dsp;
#[cfg(not(multiscopic_dsp))]
type KernelOfTarget = Portable<8>;

/// The kernel that a matcher takes unless it is told otherwise: `Mve` if the program is compiled for a Cortex-M with Helium, `Dsp`
/// for one with the DSP extension, and their portable twin for any other processor.
///
/// All three have eight lanes, so that a match takes the same memory everywhere.
pub type Native = KernelOfTarget;
