//! The packed instructions of Arm's DSP extension, as Cortex-M4, M7 and M33 have them.
//!
//! Four bytes, or two lanes of 16 bits, fit in a word. A word of bytes becomes two words of lanes by taking
//! every other byte, so that lanes lie in memory as the disparities 0, 2, 1, 3. A vector is two such groups:
//! one instruction loads or stores its four words.
//!
//! | module | what it is |
//! | --- | --- |
//! | `instruction` | single instructions as functions of words |
//! | `vector` | vectors in words |
//! | `isa` | the token, and the operations on column sums |
//! | `slide` | column sums move down, and blocks slide |
//! | `fuse` | fused costs, with the least of all |
//! | `blocks` | the inner loops of block matching, put together |
//! | `pixel` | the division of fused sums, the paths through a pixel, and its winner |
//! | `runs` | paths and winners of many pixels of 32 disparities |
//! | `bytes` | the operations on 8-bit costs, put together |

// Its macros serve `runs` as well.
#[macro_use]
mod pixel;

mod blocks;
mod bytes;
mod fuse;
mod instruction;
mod isa;
mod runs;
mod slide;
mod vector;

pub use isa::Dsp;
