//! The image part of the network: disparities of pixels.
//!
//! ```text
//! for each two rows of pixels: fine[row / 2] = first layer(channels of 2x2 pixels)
//! fine -> residual -> halve -> ... -> last -> residual -> double, add -> ... -> fine -> convolution
//! for each row of pixels, REACH rows ahead:      // rings of choices and scores
//!     scores  = last layer(fine);  choice = mean of A, B and the disparities of blocks around, weighted by scores
//!     for the row REACH behind: disparity = mean of its choice and those of its neighbours, weighted by scores
//! ```
//!
//! Only the finest level has the size of the image, halved; the rows of channels, winners and scores are rings.

use core::array;

use super::{
    cell_rows::{CellRows, NetworkOn, layer_row},
    frame_inputs::FrameInputs,
};
use crate::{
    MemoryTooSmall, infallible,
    kernel::{Isa, Kernel},
    memory::{Lender, larger, lent_bytes},
    network::{BLOCK, BlockDisparity, MEASURES, PIXEL_CHANNELS, PixelHead, PixelRow, PixelScores, Skeleton, blocks_around},
};

/// The reach of the head in rows: the choices of neighbours are known so many rows ahead of a pixel's disparity.
const REACH: usize = 3;
/// The rows of choices that are kept.
const CHOICE_ROWS: usize = 2 * REACH + 1;
/// The rows of scores that are kept: a pixel's own, and those ahead.
const SCORE_ROWS: usize = REACH + 1;

/// The sizes of the image part.
#[derive(Clone, Copy, Debug)]
pub struct ImagePart {
    /// Columns and rows of blocks.
    blocks: [usize; 2],
}

impl ImagePart {
    /// Those for columns and rows of blocks.
    pub const fn new(blocks: [usize; 2]) -> ImagePart {
        ImagePart { blocks }
    }

    /// Columns and rows of pixels.
    const fn pixels(&self) -> [usize; 2] {
        [BLOCK * self.blocks[0], BLOCK * self.blocks[1]]
    }

    /// The size of a level, as an image.
    const fn size(&self, level: usize) -> [usize; 3] {
        let [width, height] = self.pixels();
        [1, height >> (level + 1), width >> (level + 1)]
    }

    const fn channels(level: usize) -> usize {
        let [fine, coarse] = Skeleton::IMAGE_CHANNELS;
        if level == 0 { fine } else { coarse }
    }

    /// The bytes of the buffers of the first step: colours, winners of three rows by both passes, measures, and the channels of
    /// two rows.
    const fn first_bytes(&self) -> [usize; 4] {
        let [width, _] = self.pixels();
        [3 * width, 2 * 2 * 3 * width, MEASURES * width, 2 * PIXEL_CHANNELS * width]
    }

    /// The bytes of those of the last step: winners by both passes, outputs, choices and scores.
    const fn last_bytes(&self) -> [usize; 4] {
        let [width, _] = self.pixels();
        let (choices, scores) = (CHOICE_ROWS * size_of::<u16>(), SCORE_ROWS * size_of::<PixelScores>());
        [2 * 2 * width, 2 * PixelHead::OUTPUTS * width, choices * width, scores * width]
    }

    const fn scratch_bytes(&self) -> usize {
        let [fine, coarse] = Skeleton::IMAGE_CHANNELS;
        larger(CellRows::image_scratch(self.size(0)[2], fine), CellRows::image_scratch(self.size(1)[2], coarse))
    }

    /// The bytes of memory that it takes.
    pub const fn bytes<I: Isa>(&self) -> usize {
        let levels = self.level_bytes::<I>(1)
            + self.level_bytes::<I>(2)
            + self.level_bytes::<I>(3)
            + lent_bytes::<I>(self.scratch_bytes());
        let [colors, winners, measures, channels] = self.first_bytes();
        let first = lent_bytes::<I>(colors) + lent_bytes::<I>(winners) + lent_bytes::<I>(measures) + lent_bytes::<I>(channels);
        let [winners, outputs, choices, scores] = self.last_bytes();
        let last = lent_bytes::<I>(winners) + lent_bytes::<I>(outputs) + lent_bytes::<I>(choices) + lent_bytes::<I>(scores);
        self.level_bytes::<I>(0) + larger(levels, larger(first, last))
    }

    const fn level_bytes<I: Isa>(&self, level: usize) -> usize {
        lent_bytes::<I>(CellRows::bytes(self.size(level), Self::channels(level)))
    }

    /// Finds the disparity and the confidence of each pixel of the padded image, by those of the blocks, in as many
    /// [`bytes`](ImagePart::bytes) of memory, with any content. `put` takes them row by row: the row, the column, the disparity
    /// in steps from the least of the search on, and the confidence.
    pub fn run<I: Kernel>(
        &self,
        NetworkOn { isa, layers }: NetworkOn<I>,
        inputs: &mut FrameInputs<I>,
        blocks: &[BlockDisparity],
        mut memory: Lender,
        progress: &mut impl FnMut(),
        put: impl FnMut(usize, usize, (u16, u8)),
    ) -> Result<(), MemoryTooSmall> {
        let network = NetworkOn { isa, layers };
        let mut fine = self.level(0, &mut memory)?;
        self.take_pixels(network, inputs, blocks, memory.rest(), &mut fine, progress)?;
        self.run_levels(network, memory.rest(), &mut fine, progress)?;
        self.select(network, inputs, blocks, &fine, memory, put)
    }

    /// Activations of zero.
    fn level<'m>(&self, level: usize, memory: &mut Lender<'m>) -> Result<CellRows<'m>, MemoryTooSmall> {
        let (size, channels) = (self.size(level), Self::channels(level));
        Ok(CellRows::zeros(size, channels, memory.bytes(CellRows::bytes(size, channels))?))
    }

    /// Computes all layers but the first and the last.
    fn run_levels<I: Kernel>(
        &self,
        NetworkOn { isa, layers }: NetworkOn<I>,
        mut memory: Lender,
        fine: &mut CellRows,
        progress: &mut impl FnMut(),
    ) -> Result<(), MemoryTooSmall> {
        let (mut second, mut third) = (self.level(1, &mut memory)?, self.level(2, &mut memory)?);
        let mut last = self.level(3, &mut memory)?;
        let scratch = memory.bytes(self.scratch_bytes())?;
        let of = &layers.image;
        let [down_fine, down_second, down_third, down_last] = &of.down;
        let [halve_fine, halve_second, halve_third] = &of.halve;
        let [double_third, double_second, double_fine] = &of.double;
        let [up_third, up_second, up_fine] = &of.up;
        fine.residual_in_image(isa, down_fine, scratch);
        progress();
        second.add_halved(isa, halve_fine, fine);
        second.residual_in_image(isa, down_second, scratch);
        progress();
        third.add_halved(isa, halve_second, &second);
        third.residual_in_image(isa, down_third, scratch);
        progress();
        last.add_halved(isa, halve_third, &third);
        last.residual_in_image(isa, down_last, scratch);
        progress();
        last.residual_in_image(isa, &of.bottom, scratch);
        progress();
        third.add_doubled(isa, double_third, &last);
        third.convolve(isa, up_third, scratch);
        progress();
        second.add_doubled(isa, double_second, &third);
        second.convolve(isa, up_second, scratch);
        progress();
        fine.add_doubled(isa, double_fine, &second);
        fine.convolve(isa, up_fine, scratch);
        progress();
        Ok(())
    }

    /// The blocks of a row of pixels.
    fn block_row<'b>(&self, blocks: &'b [BlockDisparity], y: usize) -> &'b [BlockDisparity] {
        let columns = self.blocks[0];
        blocks.get(y / BLOCK * columns..(y / BLOCK + 1) * columns).unwrap_or_default()
    }

    /// Computes the first layer from the channels of pixels.
    fn take_pixels<I: Kernel>(
        &self,
        NetworkOn { isa, layers }: NetworkOn<I>,
        inputs: &mut FrameInputs<I>,
        blocks: &[BlockDisparity],
        mut memory: Lender,
        fine: &mut CellRows,
        progress: &mut impl FnMut(),
    ) -> Result<(), MemoryTooSmall> {
        let [width, height] = self.pixels();
        let [colors, winners, measures, channels] = self.first_bytes();
        let colors = memory.bytes(colors)?.as_chunks_mut().0;
        let winners = memory.halfwords(winners / 2)?;
        let measures = memory.bytes(measures)?.as_chunks_mut().0;
        let channels = memory.bytes(channels)?;
        let line = PIXEL_CHANNELS * width;
        for y in 0..height {
            progress();
            inputs.colors(y, colors);
            inputs.measures(y, measures);
            for (i, winners) in winners.chunks_exact_mut(width.max(1)).enumerate() {
                inputs.winners(i / 3, (y + i % 3).saturating_sub(1).min(height - 1), winners);
            }
            let mut rows = winners.chunks_exact(width.max(1));
            let winners = [(); 2].map(|()| array::from_fn(|_| rows.next().unwrap_or_default()));
            let blocks = self.block_row(blocks, y);
            let row = PixelRow { colors, winners, measures, blocks, num_disparities: inputs.num_disparities() };
            let start = y % 2 * line;
            row.channels(channels.get_mut(start..start + line).unwrap_or_default());
            if y % 2 == 1 {
                let (upper, lower) = channels.split_at_checked(line).unwrap_or_default();
                fine.add_row(isa, &layers.image.first, [upper, lower], 2 * PIXEL_CHANNELS, [0, y / 2]);
            }
        }
        Ok(())
    }

    /// Computes the disparities by the outputs of the last layer.
    fn select<I: Kernel>(
        &self,
        NetworkOn { isa, layers }: NetworkOn<I>,
        inputs: &FrameInputs<I>,
        blocks: &[BlockDisparity],
        fine: &CellRows,
        mut memory: Lender,
        mut put: impl FnMut(usize, usize, (u16, u8)),
    ) -> Result<(), MemoryTooSmall> {
        let [width, height] = self.pixels();
        let head = PixelHead { exponentials: &layers.exponentials, confidences: &layers.confidences };
        let [winners, outputs, choices, scores] = self.last_bytes();
        let (winners, outputs) = (memory.halfwords(winners / 2)?, infallible::cast_mut(memory.bytes(outputs)?));
        let (choices, scores) = (memory.halfwords(choices / 2)?, memory.bytes(scores)?.as_chunks_mut().0);
        let most = inputs.most_steps();
        // Pixels are chosen `REACH` rows ahead of their neighbours.
        for ahead in 0..height + REACH {
            if ahead < height {
                if let Some(layer) = layers.image.last.get(ahead % 2) {
                    let count = layer.count();
                    let channels = Self::channels(0);
                    layer_row(isa, layer, [fine.cells(0, ahead / 2)], channels, width / 2, |position, output, value| {
                        if let Some(to) = outputs.get_mut(position * count + output) {
                            *to = value;
                        }
                    });
                }
                let (a, b) = winners.split_at_mut_checked(width).unwrap_or_default();
                inputs.winners(0, ahead, a);
                inputs.winners(1, ahead, b.get_mut(..width).unwrap_or_default());
                let choices = choices.chunks_exact_mut(width.max(1)).nth(ahead % CHOICE_ROWS).unwrap_or_default();
                let scores = scores.chunks_exact_mut(width.max(1)).nth(ahead % SCORE_ROWS).unwrap_or_default();
                let (outputs, pixels) = (outputs.as_chunks().0.iter(), choices.iter_mut().zip(scores));
                for (x, ((outputs, (choice, scores)), (&a, &b))) in outputs.zip(pixels).zip(a.iter().zip(&*b)).enumerate() {
                    (*choice, *scores) = head.pixel(outputs, [a, b], blocks_around(blocks, self.blocks, [x, ahead]));
                }
            }
            let Some(y) = ahead.checked_sub(REACH) else { continue };
            let row = |offset: isize| {
                choices
                    .chunks_exact(width.max(1))
                    .nth(y.saturating_add_signed(offset).min(height - 1) % CHOICE_ROWS)
                    .unwrap_or_default()
            };
            let rows = [-3, -1, 0, 1, 3].map(row);
            for (x, pixel) in scores.chunks_exact(width.max(1)).nth(y % SCORE_ROWS).unwrap_or_default().iter().enumerate() {
                put(y, x, head.disparity(rows, x, pixel, most));
            }
        }
        Ok(())
    }
}
