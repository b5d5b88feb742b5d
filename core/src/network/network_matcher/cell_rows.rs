//! Activations in memory that was lent, and the layers that change them in place.
//!
//! ```text
//! residual in a volume:                          // h = within(x) over 3x3 cells of a slice; x += across(h)
//!     for each row y:
//!         hidden[slice] = within(saved row above, row y, row y + 1)   for all slices
//!         saved[slice]  = row y, before it changes
//!         row y        += across(hidden[slice - 1], hidden[slice], hidden[slice + 1])
//! residual in an image:                          // x += second(first(x)), both over 3x3 cells
//!     hidden is a ring of three rows, computed one row ahead of the one that changes
//! convolution:                                   // x = layer(x)
//!     new = layer(saved row above, row y, row y + 1);  saved = row y;  row y = new
//! ```
//!
//! Rows are visited from the top, and a row's inputs below it are still as they were; only the row above needs a copy.

use core::{array, iter};

use crate::{
    infallible,
    kernel::Isa,
    network::{LayerRecord, MAX_ACTIVATION, NetworkLayers},
};

/// The network, and the instructions that compute it.
#[derive(Clone, Copy, Debug)]
pub struct NetworkOn<'a, I> {
    /// The instructions.
    pub isa: I,
    /// The layers.
    pub layers: &'a NetworkLayers<LayerRecord<'a>>,
}

/// The positions whose sums are computed together.
const POSITIONS: usize = 4;

/// Computes the outputs of a layer at the first `count` positions of a row, and gives each to `put`: the position, the output,
/// and its value.
///
/// The inputs lie side by side in as many runs as the layer has, and those of a position `stride` bytes behind those of the
/// position before. A run without inputs counts as zeros.
#[inline(always)]
pub fn layer_row<I: Isa, const RUNS: usize>(
    isa: I,
    layer: &LayerRecord,
    runs: [&[u8]; RUNS],
    stride: usize,
    count: usize,
    mut put: impl FnMut(usize, usize, i16),
) {
    let length = layer.run_length();
    for (output, (weights, of_output)) in layer.outputs().enumerate() {
        for first in (0..count).step_by(POSITIONS) {
            // Past the last one, it is computed again.
            let positions: [usize; POSITIONS] = array::from_fn(|i| (first + i).min(count - 1));
            let mut sums = [of_output.bias; POSITIONS];
            for (run, weights) in iter::zip(runs, weights.chunks_exact(length.max(1))) {
                if !run.is_empty() {
                    let inputs = positions.map(|position| run.get(position * stride..).unwrap_or_default());
                    sums = isa.add_products(sums, weights, inputs);
                }
            }
            for (position, sum) in (first..count).zip(sums) {
                put(position, output, of_output.of(sum));
            }
        }
    }
}

/// Activations of cells in slices, which have rows. An image is one slice; a volume of costs has one for every few disparities.
///
/// The channels of a cell lie side by side, then the cells of a row, with a cell of zeros at either end. So a convolution of 3x3
/// cells reads its inputs in three runs.
#[derive(Debug)]
pub struct CellRows<'m> {
    size: [usize; 3],
    channels: usize,
    bytes: &'m mut [u8],
}

/// An output as an activation, added to one that is there.
#[inline(always)]
fn activation(value: i16, to: u8) -> u8 {
    value.saturating_add(to.into()).clamp(0, MAX_ACTIVATION.into()) as u8
}

impl<'m> CellRows<'m> {
    /// The bytes of slices, rows in a slice, and cells in a row.
    pub const fn bytes([slices, height, width]: [usize; 3], channels: usize) -> usize {
        slices * height * (width + 2) * channels
    }

    /// The bytes of scratch memory for [`residual_in_volume`](CellRows::residual_in_volume).
    pub const fn volume_scratch([slices, _, width]: [usize; 3], channels: usize) -> usize {
        slices * (width + 2 + width) * channels
    }

    /// The bytes of scratch memory for [`residual_in_image`](CellRows::residual_in_image) and [`convolve`](CellRows::convolve).
    pub const fn image_scratch(width: usize, channels: usize) -> usize {
        3 * (width + 2) * channels
    }

    /// Activations of zero. There are as many bytes as [`bytes`](CellRows::bytes), with any content.
    pub fn zeros(size: [usize; 3], channels: usize, bytes: &'m mut [u8]) -> CellRows<'m> {
        bytes.fill(0);
        CellRows { size, channels, bytes }
    }

    fn row_bytes(&self) -> usize {
        (self.size[2] + 2) * self.channels
    }

    /// The place of a row. Outside, no byte lies.
    fn place(&self, slice: usize, y: usize) -> core::ops::Range<usize> {
        let [slices, height, _] = self.size;
        if slice < slices && y < height {
            let start = (slice * height + y) * self.row_bytes();
            start..start + self.row_bytes()
        } else {
            0..0
        }
    }

    /// The cells of a row, with one of zeros at either end.
    fn padded(&self, slice: usize, y: usize) -> &[u8] {
        self.bytes.get(self.place(slice, y)).unwrap_or_default()
    }

    /// The cells of a row; none outside.
    pub fn cells(&self, slice: usize, y: usize) -> &[u8] {
        let padded = self.padded(slice, y);
        padded.get(self.channels..padded.len().saturating_sub(self.channels)).unwrap_or_default()
    }

    /// The cells of a row, mutably.
    pub fn cells_mut(&mut self, slice: usize, y: usize) -> &mut [u8] {
        let (place, channels) = (self.place(slice, y), self.channels);
        let padded = self.bytes.get_mut(place).unwrap_or_default();
        let end = padded.len().saturating_sub(channels);
        padded.get_mut(channels..end).unwrap_or_default()
    }

    /// Adds the outputs of a layer to the cells of a row.
    #[inline(always)]
    pub fn add_row<I: Isa, const RUNS: usize>(
        &mut self,
        isa: I,
        layer: &LayerRecord,
        runs: [&[u8]; RUNS],
        stride: usize,
        [slice, y]: [usize; 2],
    ) {
        add_outputs(isa, layer, runs, stride, self.cells_mut(slice, y));
    }

    /// Adds a product of the channels of 2x2x2 cells of a volume of twice the size, or of 2x2 cells of such an image.
    pub fn add_halved<I: Isa>(&mut self, isa: I, layer: &LayerRecord, input: &CellRows) {
        let [slices, height, _] = self.size;
        let is_volume = input.size[0] > 1;
        for (slice, y) in (0..slices).flat_map(|slice| (0..height).map(move |y| (slice, y))) {
            let stride = 2 * input.channels;
            if is_volume {
                let runs = [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[below, down]| input.cells(2 * slice + below, 2 * y + down));
                self.add_row(isa, layer, runs, stride, [slice, y]);
            } else {
                let runs = [0, 1].map(|down| input.cells(slice, 2 * y + down));
                self.add_row(isa, layer, runs, stride, [slice, y]);
            }
        }
    }

    /// Adds products of the channels of each cell of an image or a volume of half the size. An image has a layer for each row of
    /// two, a volume for the rows of the first slice, then of the second.
    pub fn add_doubled<I: Isa>(&mut self, isa: I, layers: &[LayerRecord], input: &CellRows) {
        let [slices, height, _] = self.size;
        for (slice, y) in (0..slices).flat_map(|slice| (0..height).map(move |y| (slice, y))) {
            let coarse = if slices > 1 { slice / 2 } else { slice };
            if let Some(layer) = layers.get(2 * (slice % 2) + y % 2) {
                self.add_row(isa, layer, [input.cells(coarse, y / 2)], input.channels, [slice, y]);
            }
        }
    }

    /// Adds a convolution of 3x3 cells within slices, followed by a layer across them.
    pub fn residual_in_volume<I: Isa>(&mut self, isa: I, [within, across]: &[LayerRecord; 2], scratch: &mut [u8]) {
        let ([slices, height, width], channels, row) = (self.size, self.channels, self.row_bytes());
        let line = width * channels;
        // The row above as it was, and what is between the layers, of all slices.
        let Some((above, hidden)) = scratch.split_at_mut_checked(slices * row) else { return };
        for y in 0..height {
            for (slice, (hidden, above)) in
                hidden.chunks_exact_mut(line.max(1)).zip(infallible::parts(above, row)).enumerate().take(slices)
            {
                let above = if y > 0 { above } else { &[] };
                set_outputs(isa, within, [above, self.padded(slice, y), self.padded(slice, y + 1)], channels, hidden);
            }
            for (slice, above) in above.chunks_exact_mut(row.max(1)).enumerate() {
                copy(above, self.padded(slice, y));
            }
            let hidden = |slice: Option<usize>| {
                slice
                    .filter(|&slice| slice < slices)
                    .and_then(|slice| hidden.get(slice * line..(slice + 1) * line))
                    .unwrap_or_default()
            };
            for slice in 0..slices {
                let runs = [slice.checked_sub(1), Some(slice), Some(slice + 1)].map(hidden);
                self.add_row(isa, across, runs, channels, [slice, y]);
            }
        }
    }

    /// Adds two convolutions of 3x3 cells, one after the other, in an image.
    pub fn residual_in_image<I: Isa>(&mut self, isa: I, [first, second]: &[LayerRecord; 2], scratch: &mut [u8]) {
        let ([_, height, _], channels, row) = (self.size, self.channels, self.row_bytes());
        // Three rows of what is between them.
        let Some(hidden) = scratch.get_mut(..3 * row) else { return };
        hidden.fill(0);
        let compute = |cells: &Self, hidden: &mut [u8], y: usize| {
            let start = y % 3 * row;
            let hidden = hidden.get_mut(start + channels..start + row - channels).unwrap_or_default();
            let above = y.checked_sub(1).map_or(&[][..], |above| cells.padded(0, above));
            set_outputs(isa, first, [above, cells.padded(0, y), cells.padded(0, y + 1)], channels, hidden);
        };
        compute(self, hidden, 0);
        for y in 0..height {
            if y + 1 < height {
                compute(self, hidden, y + 1);
            }
            let of = |y: Option<usize>| {
                y.filter(|&y| y < height).and_then(|y| hidden.get(y % 3 * row..(y % 3 + 1) * row)).unwrap_or_default()
            };
            self.add_row(isa, second, [y.checked_sub(1), Some(y), Some(y + 1)].map(of), channels, [0, y]);
        }
    }

    /// A convolution of 3x3 cells in an image.
    pub fn convolve<I: Isa>(&mut self, isa: I, layer: &LayerRecord, scratch: &mut [u8]) {
        let ([_, height, _], channels, row) = (self.size, self.channels, self.row_bytes());
        // The row above as it was, and the new row.
        let Some((above, rest)) = scratch.split_at_mut_checked(row) else { return };
        let Some(new) = rest.get_mut(..row - 2 * channels) else { return };
        for y in 0..height {
            let before: &[u8] = if y > 0 { above } else { &[] };
            set_outputs(isa, layer, [before, self.padded(0, y), self.padded(0, y + 1)], channels, new);
            copy(above, self.padded(0, y));
            copy(self.cells_mut(0, y), new);
        }
    }
}

/// Copies bytes, as many as there are in both.
fn copy(to: &mut [u8], from: &[u8]) {
    to.iter_mut().zip(from).for_each(|(to, &from)| *to = from);
}

/// Sets cells to the outputs of a layer.
#[inline(always)]
pub fn set_outputs<I: Isa, const RUNS: usize>(isa: I, layer: &LayerRecord, runs: [&[u8]; RUNS], stride: usize, cells: &mut [u8]) {
    cells.fill(0);
    add_outputs(isa, layer, runs, stride, cells);
}

/// Adds the outputs of a layer to cells. It has them position by position: those of several cells, if it doubles an image.
#[inline(always)]
fn add_outputs<I: Isa, const RUNS: usize>(isa: I, layer: &LayerRecord, runs: [&[u8]; RUNS], stride: usize, cells: &mut [u8]) {
    let outputs = layer.count();
    let count = cells.len().checked_div(outputs).unwrap_or_default();
    layer_row(isa, layer, runs, stride, count, |position, output, value| {
        if let Some(cell) = cells.get_mut(position * outputs + output) {
            *cell = activation(value, *cell);
        }
    });
}
