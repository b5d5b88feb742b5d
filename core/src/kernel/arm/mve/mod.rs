//! The vector instructions of Arm's MVE (Helium), as Cortex-M55 and M85 have them.
//!
//! Rust has no types for these vectors, so whole loops are written in assembly; single operations are the
//! portable ones.
//!
//! | room | what it is |
//! | --- | --- |
//! | `isa` | the token, and the operations on column sums |
//! | `slide` | column sums move down, and blocks slide |
//! | `fuse` | fused costs, with the least of all |
//! | `blocks` | the inner loops, put together |

mod blocks;
mod fuse;
mod isa;
mod slide;

pub use isa::Mve;
