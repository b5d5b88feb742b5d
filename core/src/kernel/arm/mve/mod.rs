//! The vector instructions of Arm's MVE (Helium), as Cortex-M55 and M85 have them.
//!
//! Rust has no types for these vectors, so whole loops are written in assembly; single operations are the
//! portable ones. Here are the token, the operations on column sums, and sums of products.
//!
//! | module | what it is |
//! | --- | --- |
//! | `slide` | column sums move down, and blocks slide, or slide and are fused to the minimum at once |
//! | `fuse` | fused costs, with the least of all |
//! | `pixel` | the loops over the 8-bit costs of a pixel: paths, winners, the division of fused sums, and Hamming distances |
//! | `runs` | paths through many pixels of 32 disparities |
//! | `bytes` | costs in 8-bit lanes |
//! | `blocks` | the inner loops, put together |

#[macro_use]
mod slide;

mod blocks;
mod bytes;
mod fuse;
mod pixel;
mod runs;

use crate::kernel::{
    isa::{Change, Isa, sealed::Sealed},
    portable::Portable,
};

/// MVE: eight lanes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mve;

/// The definition of its operations.
const TWIN: Portable<8> = Portable;

/// Bytes of a vector of 16-bit lanes.
const VECTOR: usize = size_of::<[u16; 8]>();

impl Sealed for Mve {}

impl Isa for Mve {
    const LANES: usize = 8;
    const BATCH: usize = 1;
    type Samples = [u8; 8];
    type Sums = [u16; 8];
    type Column = [u16; 8];

    #[inline(always)]
    fn load_column(self, sums: &[u16; 8]) -> [u16; 8] {
        *sums
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8; 8]) -> [u16; 8] {
        TWIN.differences(center, view)
    }

    #[inline(always)]
    fn add_products(self, sums: [i32; 4], weights: &[u8], inputs: [&[u8]; 4]) -> [i32; 4] {
        add_products(sums, weights, inputs)
    }

    #[inline(always)]
    fn advance(self, sums: [u16; 8], center: Change<u8>, view: Change<&[u8; 8]>) -> [u16; 8] {
        TWIN.advance(sums, center, view)
    }
}

/// Adds the products of signed weights and inputs, each at most 127, to a sum for each of four positions, which has as many
/// inputs as there are weights.
#[inline(always)]
#[allow(unsafe_code)]
fn add_products(sums: [i32; 4], weights: &[u8], inputs: [&[u8]; 4]) -> [i32; 4] {
    let count = inputs.iter().fold(weights.len(), |count, inputs| count.min(inputs.len()));
    if count == 0 {
        return sums;
    }
    let ([a, b, c, d], [mut sum_a, mut sum_b, mut sum_c, mut sum_d]) = (inputs, sums);
    // SAFETY: reads `count` weights and inputs at each position. Every register that changes is an output.
    unsafe {
        asm_up_to!(48 bytes,
            // The last of the vectors may be a part of one.
            "dlstp.8 lr, {n}",
            "2:",
            "vldrb.u8 q0, [{weights}], #16",
            "vldrb.u8 q1, [{a}], #16",
            "vmladava.s8 r0, q0, q1",
            "vldrb.u8 q1, [{b}], #16",
            "vmladava.s8 r2, q0, q1",
            "vldrb.u8 q1, [{c}], #16",
            "vmladava.s8 r4, q0, q1",
            "vldrb.u8 q1, [{d}], #16",
            "vmladava.s8 r8, q0, q1",
            "letp lr, 2b";
            n = in(reg) count,
            weights = inout(reg) weights.as_ptr() => _,
            a = inout(reg) a.as_ptr() => _,
            b = inout(reg) b.as_ptr() => _,
            c = inout(reg) c.as_ptr() => _,
            d = inout(reg) d.as_ptr() => _,
            // Sums across a vector go to even registers.
            inout("r0") sum_a,
            inout("r2") sum_b,
            inout("r4") sum_c,
            inout("r8") sum_d,
            out("lr") _, out("q0") _, out("q1") _,
            options(nostack, readonly, preserves_flags),
        );
    }
    [sum_a, sum_b, sum_c, sum_d]
}
