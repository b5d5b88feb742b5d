//! The operations on column sums, which are the portable ones.

use crate::kernel::{
    isa::{Change, Isa, sealed::Sealed},
    portable::Portable,
};

/// MVE: eight lanes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mve;

/// The definition of its operations.
pub(super) const TWIN: Portable<8> = Portable;

/// Bytes of a vector of 16-bit lanes.
pub(super) const VECTOR: usize = size_of::<[u16; 8]>();

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
    fn advance(self, sums: [u16; 8], center: Change<u8>, view: Change<&[u8; 8]>) -> [u16; 8] {
        TWIN.advance(sums, center, view)
    }
}
