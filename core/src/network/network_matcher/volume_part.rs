//! The volume part of the network: disparities of blocks.
//!
//! ```text
//! for each row of blocks:
//!     guide = second(first(colours of the rows of blocks around))      // a summand of each block's first activations
//!     fine[slice, row] = relu(first layer(two candidates of the row) + guide)
//! fine -> residual -> halve -> middle -> residual -> halve -> coarse -> residuals
//! coarse -> double, add -> middle -> residual -> double, add -> fine -> residual
//! for each block: score[d] = last layer(fine) - mean excess in B;  select by the weighted mean around the greatest
//! ```
//!
//! A cell of the volume is a block of pixels and a slice of two disparities. Levels are halved in all three directions.

use core::array;

use super::{
    cell_rows::{CellRows, NetworkOn, layer_row, set_outputs},
    frame_inputs::{Excesses, FrameInputs},
};
use crate::{
    MemoryTooSmall, infallible,
    kernel::{Isa, Kernel},
    memory::{Lender, larger, lent_bytes},
    network::{BlockDisparity, CANDIDATE_CHANNELS, MAX_ACTIVATION, Skeleton},
};

/// The sizes of the volume part.
#[derive(Clone, Copy, Debug)]
pub struct VolumePart {
    /// The disparities that are searched.
    count: usize,
    /// Columns and rows of blocks.
    blocks: [usize; 2],
}

impl VolumePart {
    /// Those for a number of disparities and columns and rows of blocks.
    pub const fn new(count: usize, blocks: [usize; 2]) -> VolumePart {
        VolumePart { count, blocks }
    }

    /// Slices, rows and columns of a level.
    const fn size(&self, level: usize) -> [usize; 3] {
        let [columns, rows] = self.blocks;
        let slices = infallible::div_ceil(self.count, Skeleton::DISPARITIES) * Skeleton::DISPARITIES / 2;
        [slices >> level, rows >> level, columns >> level]
    }

    /// The bytes of the guide's rows: colours, three rows between its layers, and outputs.
    const fn guide_bytes(&self) -> [usize; 3] {
        let columns = self.blocks[0];
        [
            columns * Skeleton::BLOCK_COLORS,
            3 * (columns + 2) * Skeleton::GUIDE_CHANNELS,
            2 * columns * Skeleton::VOLUME_CHANNELS[0],
        ]
    }

    /// The bytes of a row of candidates, with a disparity that does not exist after the last.
    const fn candidate_bytes(&self) -> usize {
        (self.count + 1) * self.blocks[0] * CANDIDATE_CHANNELS
    }

    /// The bytes of scratch memory, between the layers of a level or in the first or last step.
    const fn scratch_bytes(&self) -> usize {
        let [fine, middle, coarse] = Skeleton::VOLUME_CHANNELS;
        let [fine, middle, coarse] = [
            CellRows::volume_scratch(self.size(0), fine),
            CellRows::volume_scratch(self.size(1), middle),
            CellRows::volume_scratch(self.size(2), coarse),
        ];
        larger(fine, larger(middle, coarse))
    }

    /// The bytes of memory that it takes.
    pub const fn bytes<I: Isa>(&self) -> usize {
        let [fine, middle, coarse] = Skeleton::VOLUME_CHANNELS;
        let [colors, hidden, outputs] = self.guide_bytes();
        let first = lent_bytes::<I>(colors)
            + lent_bytes::<I>(hidden)
            + lent_bytes::<I>(outputs)
            + lent_bytes::<I>(self.candidate_bytes());
        let scratch = lent_bytes::<I>(self.scratch_bytes());
        let levels =
            lent_bytes::<I>(CellRows::bytes(self.size(1), middle)) + lent_bytes::<I>(CellRows::bytes(self.size(2), coarse));
        lent_bytes::<I>(CellRows::bytes(self.size(0), fine)) + larger(first, levels + scratch)
    }

    /// Finds the disparity of each block, and how sure it is, in as many [`bytes`](VolumePart::bytes) of memory, with any
    /// content.
    pub fn run<I: Kernel>(
        &self,
        NetworkOn { isa, layers }: NetworkOn<I>,
        inputs: &mut FrameInputs<I>,
        excesses: &[Excesses],
        mut memory: Lender,
        blocks: &mut [BlockDisparity],
        progress: &mut impl FnMut(),
    ) -> Result<(), MemoryTooSmall> {
        let [fine_channels, middle_channels, coarse_channels] = Skeleton::VOLUME_CHANNELS;
        let fine_bytes = memory.bytes(CellRows::bytes(self.size(0), fine_channels))?;
        let mut fine = CellRows::zeros(self.size(0), fine_channels, fine_bytes);
        self.take_candidates(NetworkOn { isa, layers }, inputs, excesses, memory.rest(), &mut fine, progress)?;

        let mut level = |level: usize, channels: usize| {
            let bytes = memory.bytes(CellRows::bytes(self.size(level), channels))?;
            Ok(CellRows::zeros(self.size(level), channels, bytes))
        };
        let (mut middle, mut coarse) = (level(1, middle_channels)?, level(2, coarse_channels)?);
        let scratch = memory.bytes(self.scratch_bytes())?;
        let layers_of = &layers.volume;
        let [down_fine, down_middle] = &layers_of.down;
        let [halve_fine, halve_middle] = &layers_of.halve;
        let [double_coarse, double_middle] = &layers_of.double;
        let [up_middle, up_fine] = &layers_of.up;
        fine.residual_in_volume(isa, down_fine, scratch);
        progress();
        middle.add_halved(isa, halve_fine, &fine);
        middle.residual_in_volume(isa, down_middle, scratch);
        progress();
        coarse.add_halved(isa, halve_middle, &middle);
        for block in &layers_of.bottom {
            coarse.residual_in_volume(isa, block, scratch);
            progress();
        }
        middle.add_doubled(isa, double_coarse, &coarse);
        middle.residual_in_volume(isa, up_middle, scratch);
        progress();
        fine.add_doubled(isa, double_middle, &middle);
        fine.residual_in_volume(isa, up_fine, scratch);
        progress();
        self.select(NetworkOn { isa, layers }, inputs, excesses, &fine, scratch, blocks);
        Ok(())
    }

    /// Computes the first layer from the candidates, and what the guide adds to them.
    fn take_candidates<I: Kernel>(
        &self,
        NetworkOn { isa, layers }: NetworkOn<I>,
        inputs: &mut FrameInputs<I>,
        excesses: &[Excesses],
        mut memory: Lender,
        fine: &mut CellRows,
        progress: &mut impl FnMut(),
    ) -> Result<(), MemoryTooSmall> {
        let [columns, rows] = self.blocks;
        let [first, second] = &layers.guide;
        let [colors, hidden, outputs] = self.guide_bytes();
        let (colors, hidden) = (memory.bytes(colors)?, memory.bytes(hidden)?);
        let guide: &mut [i16] = infallible::cast_mut(memory.bytes(outputs)?);
        let candidates = memory.bytes(self.candidate_bytes())?;
        let channels = Skeleton::GUIDE_CHANNELS;
        let row_bytes = (columns + 2) * channels;
        hidden.fill(0);
        let mut hide = |inputs: &FrameInputs<I>, hidden: &mut [u8], row: usize| {
            inputs.block_colors(row, colors);
            let start = row % 3 * row_bytes;
            let hidden = hidden.get_mut(start + channels..start + row_bytes - channels).unwrap_or_default();
            set_outputs(isa, first, [colors], Skeleton::BLOCK_COLORS, hidden);
        };
        hide(inputs, hidden, 0);
        let of_guide = Skeleton::VOLUME_CHANNELS[0];
        for row in 0..rows {
            if row + 1 < rows {
                hide(inputs, hidden, row + 1);
            }
            let of = |row: Option<usize>| {
                row.filter(|&row| row < rows)
                    .and_then(|row| hidden.get(row % 3 * row_bytes..(row % 3 + 1) * row_bytes))
                    .unwrap_or_default()
            };
            let runs = [row.checked_sub(1), Some(row), Some(row + 1)].map(of);
            layer_row(isa, second, runs, channels, columns, |position, output, value| {
                if let Some(guide) = guide.get_mut(position * of_guide + output) {
                    *guide = value;
                }
            });

            progress();
            candidates.fill(MAX_ACTIVATION);
            let line = columns * CANDIDATE_CHANNELS;
            let exist = candidates.get_mut(..self.count * line).unwrap_or_default();
            inputs.candidates(row, excesses, exist.as_chunks_mut().0);
            for slice in 0..self.size(0)[0] {
                let runs = array::from_fn::<_, 2, _>(|i| (2 * slice + i).min(self.count))
                    .map(|index| candidates.get(index * line..(index + 1) * line).unwrap_or_default());
                let cells = fine.cells_mut(slice, row);
                layer_row(isa, &layers.volume.first, runs, CANDIDATE_CHANNELS, columns, |position, output, value| {
                    let at = position * of_guide + output;
                    if let (Some(cell), Some(guide)) = (cells.get_mut(at), guide.get(at)) {
                        *cell = value.saturating_add(*guide).clamp(0, MAX_ACTIVATION.into()) as u8;
                    }
                });
            }
        }
        Ok(())
    }

    /// Selects a disparity for each block: its candidate of the greatest score, which is the output of the last layer less the
    /// mean excess in B.
    fn select<I: Kernel>(
        &self,
        NetworkOn { isa, layers }: NetworkOn<I>,
        inputs: &FrameInputs<I>,
        excesses: &[Excesses],
        fine: &CellRows,
        scratch: &mut [u8],
        blocks: &mut [BlockDisparity],
    ) {
        let [columns, _] = self.blocks;
        let [slices, ..] = self.size(0);
        let scores: &mut [i16] = bytemuck::try_cast_slice_mut(scratch).unwrap_or_default();
        for (row, blocks) in blocks.chunks_exact_mut(columns.max(1)).enumerate() {
            for slice in 0..slices {
                let runs = [fine.cells(slice, row)];
                layer_row(isa, &layers.volume.last, runs, Skeleton::VOLUME_CHANNELS[0], columns, |position, output, value| {
                    if let Some(score) = scores.get_mut(position * 2 * slices + 2 * slice + output) {
                        *score = value;
                    }
                });
            }
            for (column, block) in blocks.iter_mut().enumerate() {
                let scores = scores.iter().skip(column * 2 * slices).take(self.count).enumerate();
                let score = scores
                    .map(|(index, &score)| i32::from(score) - i32::from(inputs.mean_excess(excesses, [row, index, column])));
                *block = layers.exponentials.selected(score);
            }
        }
    }
}
