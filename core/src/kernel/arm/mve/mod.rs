//! The vector instructions of Arm's MVE (Helium), as Cortex-M55 and M85 have them.
//!
//! Rust has no types for these vectors, so whole loops are written in assembly; single operations are the
//! portable ones.
//!
//! | module | what it is |
//! | --- | --- |
//! | `isa` | the token, the operations on column sums, and sums of products |
//! | `slide` | column sums move down, and blocks slide |
//! | `slide_to_min` | blocks slide and are fused to the minimum at once |
//! | `fuse` | fused costs, with the least of all |
//! | `extend` | paths through a pixel |
//! | `winner` | fused sums are divided, and the least sums of path costs found |
//! | `unrolled` | paths through pixels of 32 disparities |
//! | `forward` | the paths from the left and from above, through many pixels |
//! | `backward` | the path from the right, through many pixels |
//! | `hamming` | Hamming distances |
//! | `bytes` | costs in 8-bit lanes |
//! | `blocks` | the inner loops, put together |

#[macro_use]
mod slide;
#[macro_use]
mod slide_to_min;
#[macro_use]
mod unrolled;

mod backward;
mod blocks;
mod bytes;
mod extend;
mod forward;
mod fuse;
mod hamming;
mod isa;
mod winner;

pub use isa::Mve;
