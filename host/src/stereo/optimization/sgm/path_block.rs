//! The paths of a few columns, as a row sends them to the next.

use multiscopic_core::kernel::Slot;

/// The columns of a block.
pub(super) const COLUMNS: usize = 32;

/// The paths of one slope up to each pixel of a block of columns: a [slot](Slot) for each.
#[derive(Debug)]
pub(super) struct PathBlock {
    slots: Vec<u8>,
    bytes: usize,
}

impl PathBlock {
    /// A block whose path costs are still to be computed, with `stride` costs for each pixel.
    pub fn new(stride: usize) -> PathBlock {
        let bytes = Slot::bytes(stride);
        PathBlock { slots: vec![u8::MAX; COLUMNS * bytes], bytes }
    }

    /// The slot of a column, counted from the block's first.
    #[inline(always)]
    pub fn at(&self, column: usize) -> &[u8] {
        &self.slots[column * self.bytes..][..self.bytes]
    }

    /// The slot of a column, counted from the block's first.
    #[inline(always)]
    pub fn at_mut(&mut self, column: usize) -> &mut [u8] {
        &mut self.slots[column * self.bytes..][..self.bytes]
    }
}

/// A slot in which a path of `count` disparities begins.
pub(super) fn start(count: usize, stride: usize) -> Vec<u8> {
    let mut slot = vec![0; Slot::bytes(stride)];
    Slot::begin(&mut slot, count);
    slot
}
