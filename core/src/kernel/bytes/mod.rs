//! Costs in 8-bit lanes, as semi-global matching has them.
//!
//! An instruction set implements the operations of [`Bytes`]. The loops of [`PixelLoops`] and [`RunLoops`]
//! consist of them, and may be overridden. Each module knows only those above it:
//!
//! | module | what it is |
//! | --- | --- |
//! | `lanes` | vectors of 8-bit costs, and the operations on them: [`ByteVector`], [`Bytes`] |
//! | `divisor` | from fused sums to matching costs: [`Divisor`] |
//! | `paths` | the recursion along the paths of semi-global matching: [`Slot`], [`Step`] |
//! | `along` | a path along a line in registers: [`Along`] |
//! | `hamming` | matching costs by the census transform: [`Candidates`], [`hamming_run`] |
//! | `pixel_loops` | the loops over the disparities of a pixel: [`PixelLoops`] |
//! | `runs` | paths through many pixels: [`ForwardRun`], [`BackwardRun`], [`RunLoops`] |

mod along;
mod divisor;
mod hamming;
mod lanes;
mod paths;
mod pixel_loops;
mod runs;

pub use along::Along;
pub use divisor::Divisor;
#[cfg(target_arch = "arm")]
pub(super) use hamming::hamming_loop;
pub use hamming::{CandidateRun, Candidates, hamming_run};
pub use lanes::{ByteVector, Bytes, as_vectors, as_vectors_mut};
pub use paths::{Slot, Step};
pub use pixel_loops::PixelLoops;
pub use runs::{BackwardRun, ForwardRun, Reached, RunLoops, RunPenalties};
#[cfg(target_arch = "arm")]
pub(super) use runs::{backward_loop, forward_loop};

/// An instruction set with every operation of the matchers.
pub trait Kernel: RunLoops {}

impl<I: RunLoops> Kernel for I {}
