//! The packed instructions of Arm's DSP extension, as Cortex-M4, M7 and M33 have them.
//!
//! Four bytes, or two lanes of 16 bits, fit in a word. A word of bytes becomes two words of lanes by taking
//! every other byte, so that lanes lie in memory as the disparities 0, 2, 1, 3. A vector is two such groups:
//! one instruction loads or stores its four words. Here are the token and the operations on column sums.
//!
//! | module | what it is |
//! | --- | --- |
//! | `instruction` | single instructions as functions of words |
//! | `vector` | vectors in words |
//! | `slide` | column sums move down, and blocks slide |
//! | `fuse` | fused costs, with the least of all |
//! | `wide` | the same in 32 bits |
//! | `blocks` | the inner loops of block matching, put together |
//! | `pixel` | the division of fused sums, the paths through a pixel, and its winner |
//! | `runs` | paths and winners of many pixels of 32 disparities |
//! | `bytes` | the operations on 8-bit costs, put together |

// Their macros serve `wide` and `runs` as well.
#[macro_use]
mod fuse;
#[macro_use]
mod pixel;

mod blocks;
mod bytes;
mod instruction;
mod runs;
mod slide;
mod vector;
mod wide;

use crate::kernel::isa::{Change, Column, Isa, sealed::Sealed};
use instruction::{
    count_within, differences, smlad, splat, sxtb16, sxtb16_high, uxtab16, uxtab16_high, uxtb16, uxtb16_high, words,
};
use vector::U16x8;

/// The DSP extension: eight lanes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Dsp;

/// Bytes of a vector of 16-bit lanes.
const VECTOR: usize = size_of::<[u32; 4]>();

impl Sealed for Dsp {}

impl Isa for Dsp {
    const LANES: usize = 8;
    const BATCH: usize = 1;
    type Samples = [u8; 8];
    type Sums = [u32; 4];
    type Column = U16x8;
    const COUNTS_HALVES: bool = true;

    #[inline(always)]
    fn count_within(self, values: u32, least: u32, span: u32, counts: u32) -> u32 {
        count_within(values, least, span, counts)
    }

    #[inline(always)]
    fn lane(index: usize) -> usize {
        // The lower two bits change places.
        index & !3 | index << 1 & 2 | index >> 1 & 1
    }

    #[inline(always)]
    fn load_column(self, sums: &[u32; 4]) -> U16x8 {
        U16x8(*sums)
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8; 8]) -> U16x8 {
        let [x, y] = words(view).map(|samples| differences(splat(center), samples));
        U16x8([uxtab16(0, x), uxtab16_high(0, x), uxtab16(0, y), uxtab16_high(0, y)])
    }

    #[inline(always)]
    fn advance(self, sums: U16x8, center: Change<u8>, view: Change<&[u8; 8]>) -> U16x8 {
        let entering = self.differences(center.entering, view.entering);
        let [x, y] = words(view.leaving).map(|samples| !differences(splat(center.leaving), samples));
        let kept = U16x8([uxtab16(0, x), uxtab16_high(0, x), uxtab16(0, y), uxtab16_high(0, y)]);
        Column::add(Column::add(sums, entering), kept)
    }

    #[inline(always)]
    fn add_products(self, mut sums: [i32; 4], weights: &[u8], inputs: [&[u8]; 4]) -> [i32; 4] {
        let [a, b, c, d] = inputs.map(|inputs| inputs.as_chunks::<4>().0);
        for ((((&weights, &a), &b), &c), &d) in weights.as_chunks::<4>().0.iter().zip(a).zip(b).zip(c).zip(d) {
            let weights = u32::from_le_bytes(weights);
            let (even, odd) = (sxtb16(weights), sxtb16_high(weights));
            for (sum, inputs) in sums.iter_mut().zip([a, b, c, d]) {
                let inputs = u32::from_le_bytes(inputs);
                *sum = smlad(uxtb16_high(inputs), odd, smlad(uxtb16(inputs), even, *sum));
            }
        }
        sums
    }

    // Instead of subtracting a difference, `advance` adds 255 less the difference.
    fn bias(lines: u32) -> u16 {
        255u16.wrapping_mul(lines as u16)
    }
}
