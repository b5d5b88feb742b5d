//! The operations on column sums in the DSP extension.

use super::{
    instruction::{count_within, differences, splat, uxtab16, uxtab16_high, words},
    vector::U16x8,
};
use crate::kernel::{
    isa::{Change, Isa, sealed::Sealed},
    vector::Column,
};

/// The DSP extension: eight lanes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Dsp;

/// Bytes of a vector of 16-bit lanes.
pub(super) const VECTOR: usize = size_of::<[u32; 4]>();

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

    // Instead of subtracting a difference, `advance` adds 255 less the difference.
    fn bias(lines: u32) -> u16 {
        255u16.wrapping_mul(lines as u16)
    }
}
