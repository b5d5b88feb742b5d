//! Activations of a network: bytes from 0 to 127 for each channel of each cell.

use rayon::prelude::*;

/// Activations of cells in slices, which have rows. An image is one slice; a volume of costs has one for every few
/// disparities.
///
/// The channels of a cell lie side by side, padded with zeros to a multiple of 4, then the cells of a row, with a cell
/// of zeros at either end. So a convolution of 3x3 cells reads its inputs in three runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Activations {
    slices: usize,
    height: usize,
    width: usize,
    channels: usize,
    bytes: Vec<u8>,
    /// A row of zeros, which stands in for rows above the first and below the last, and for those of slices before the first
    /// and after the last.
    blank: Vec<u8>,
}

impl Activations {
    /// Activations of zero.
    pub fn zeros([slices, height, width]: [usize; 3], channels: usize) -> Activations {
        let row = (width + 2) * channels.next_multiple_of(4);
        Activations { slices, height, width, channels, bytes: vec![0; slices * height * row], blank: vec![0; row] }
    }

    /// Slices, rows in a slice, and cells in a row.
    pub fn size(&self) -> [usize; 3] {
        [self.slices, self.height, self.width]
    }

    /// The channels of a cell, without padding.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The bytes of a cell: its channels with padding.
    pub fn cell(&self) -> usize {
        self.channels.next_multiple_of(4)
    }

    /// The cells of a row, with one of zeros at either end. Outside, all are zero.
    pub fn padded_row(&self, slice: isize, y: isize) -> &[u8] {
        let inside = |index: isize, count: usize| usize::try_from(index).ok().filter(|&index| index < count);
        match (inside(slice, self.slices), inside(y, self.height)) {
            (Some(slice), Some(y)) => &self.bytes[(slice * self.height + y) * self.blank.len()..][..self.blank.len()],
            _ => &self.blank,
        }
    }

    /// The cells of a row. Outside, all are zero.
    pub fn row(&self, slice: isize, y: isize) -> &[u8] {
        let cell = self.cell();
        &self.padded_row(slice, y)[cell..][..self.width * cell]
    }

    /// The cells of each row, mutably, by slice and row, on the threads of the current pool.
    pub fn rows_mut(&mut self) -> impl IndexedParallelIterator<Item = ([usize; 2], &mut [u8])> {
        let (cell, height, width) = (self.cell(), self.height, self.width);
        let rows = self.bytes.par_chunks_exact_mut(self.blank.len()).enumerate();
        rows.map(move |(i, row)| ([i / height, i % height], &mut row[cell..][..width * cell]))
    }
}
