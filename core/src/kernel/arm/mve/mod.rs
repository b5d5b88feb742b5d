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
//! | `pixel` | the loops over the 8-bit costs of a pixel: paths, winners, the division of fused sums, and Hamming distances |
//! | `runs` | paths through many pixels of 32 disparities |
//! | `bytes` | costs in 8-bit lanes |
//! | `blocks` | the inner loops, put together |

#[macro_use]
mod slide;
#[macro_use]
mod slide_to_min;

mod blocks;
mod bytes;
mod fuse;
mod isa;
mod pixel;
mod runs;

pub use isa::Mve;
