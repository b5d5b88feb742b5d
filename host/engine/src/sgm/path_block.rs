//! The paths of a few columns, as a row sends them to the next.

use multiscopic_core::kernel::Slot;

/// The columns of a block.
pub(super) const COLUMNS: usize = 32;

/// The paths up to the pixels of a block of columns: for each column a record of as many [slots](Slot) as there are
/// slopes. The records of the columns on either side come with them.
#[derive(Debug)]
pub(super) struct PathBlock {
    records: Vec<u8>,
    /// Bytes of a record.
    record: usize,
}

impl PathBlock {
    /// A block of paths that begin, of a number of slopes, with `stride` costs for each pixel, of which `count`
    /// are those of disparities.
    pub fn new(slopes: usize, stride: usize, count: usize) -> PathBlock {
        let record = slopes * Slot::bytes(stride);
        let mut records = vec![0; (COLUMNS + 2) * record];
        records.chunks_exact_mut(Slot::bytes(stride)).for_each(|slot| Slot::begin(slot, count));
        PathBlock { records, record }
    }

    /// The first record, the one of the column before the block.
    pub fn first(&self) -> &[u8] {
        &self.records[..self.record]
    }

    /// The records from the one of the column before the block on.
    pub fn records(&self) -> &[u8] {
        &self.records
    }

    /// The records of the block's own columns.
    pub fn own_records_mut(&mut self) -> &mut [u8] {
        &mut self.records[self.record..(1 + COLUMNS) * self.record]
    }

    /// Copies the records next to the border between this block and the one to its right.
    pub fn join(&mut self, right: &mut PathBlock) {
        let (record, border) = (self.record, COLUMNS * self.record);
        right.records[..record].copy_from_slice(&self.records[border..][..record]);
        self.records[border + record..].copy_from_slice(&right.records[record..][..record]);
    }

    /// Overwrites the record of a `column`, counted from the one before the block.
    pub fn copy_to(&mut self, column: usize, record: &[u8]) {
        self.records[column * self.record..][..self.record].copy_from_slice(record);
    }
}
