//! The inner loops of the matcher, along the disparities: one definition over the vectors of any instruction
//! set.
//!
//! An instruction set is a type that implements [`Isa`] and [`Blocks`] with the few operations that the loops
//! consist of. [`Portable`] does so in plain Rust, and defines what the operations mean. Each module knows only
//! those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `vector` | lanes, and vectors of column sums, block sums and costs: [`Lane`], [`Column`], [`Block`] |
//! | `rule` | the fusion rules in lanes: [`Rule`] |
//! | `isa` | instruction sets: [`Isa`] |
//! | `samples` | the samples of a line, as the loops read them |
//! | `steps` | steps along a line, from column to column: [`Steps`] |
//! | `blocks` | the inner loops: [`Blocks`] |
//! | `bytes` | costs in 8-bit lanes, and their loops: [`Bytes`], [`PixelLoops`], [`RunLoops`] |
//! | `masks` | masks that hide block sums where a view is not available |
//! | `batch` | batches of pixels with their block sums in registers |
//! | `winners` | winner-takes-all over a batch |
//! | `portable` | plain Rust over arrays: [`Portable`] |
//! | `x86` | `Avx2` and `Avx512` |
//! | `aarch64` | `Neon` |
//! | `arm` | `Dsp` and `Mve`, for microcontrollers |

#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
mod aarch64;
#[cfg(target_arch = "arm")]
mod arm;
mod batch;
mod blocks;
mod bytes;
mod isa;
mod masks;
mod portable;
mod rule;
mod samples;
mod steps;
mod vector;
mod winners;
#[cfg(target_arch = "x86_64")]
mod x86;

#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
pub use aarch64::Neon;
#[cfg(target_arch = "arm")]
pub use arm::{Dsp, Mve};
pub(crate) use batch::Batch;
pub use blocks::Blocks;
pub use bytes::{
    Along, BackwardRun, ByteVector, Bytes, CandidateRun, Candidates, Divisor, ForwardRun, Kernel, PixelLoops, Reached, RunLoops,
    RunPenalties, Slot, Step, as_vectors, as_vectors_mut, hamming_run,
};
pub use isa::{Change, Isa, MAX_BATCH, Work};
pub(crate) use masks::Masks;
pub use portable::Portable;
pub use rule::Rule;
pub(crate) use samples::Samples;
pub use steps::Steps;
pub use vector::{Block, Column, Lane};
pub(crate) use winners::Winners;
#[cfg(target_arch = "x86_64")]
pub use x86::{Avx2, Avx512};
