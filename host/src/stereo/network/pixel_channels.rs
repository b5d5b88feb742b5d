//! What the image part of the network sees of each pixel.

use super::{block_disparities::BlockDisparities, inputs::Inputs};

/// The channels of a pixel.
pub const PIXEL_CHANNELS: usize = 24;

/// The channels of all pixels of the padded image, row by row as they are needed.
#[derive(Clone, Copy, Debug)]
pub struct PixelChannels<'a> {
    /// What the network sees of the images.
    pub inputs: &'a Inputs,
    /// What the volume part of the network found.
    pub blocks: &'a BlockDisparities,
}

impl PixelChannels<'_> {
    /// Computes the channels of a row of the padded image. Pixels beyond the images are those of the last row and
    /// column.
    ///
    /// | channels | what they are |
    /// | --- | --- |
    /// | 0, 1, 2 | colours, halved |
    /// | 3, 4, 5 | the disparities of both passes and of the block, as a share of the search, which is about 127 |
    /// | 6, 7, 8, 9 | slopes of the disparities of both passes along the row and the column |
    /// | 10, 11 | what the disparities of the second pass and of the block are above that of the first |
    /// | 12 | how sure that of the block is |
    /// | 13 to 23 | the measures of the inputs |
    ///
    /// Differences are in sixteenths of a pixel, from -64 to 63, plus 64.
    pub fn row(&self, y: usize, out: &mut [u8]) {
        let Inputs { colors, winners, measures, num_disparities, .. } = self.inputs;
        let (width, height) = (colors.width(), colors.height());
        let inside = |y: usize| y.min(height - 1);
        let rows = winners.each_ref().map(|winners| [y.saturating_sub(1), y, y + 1].map(|y| winners.row(inside(y))));
        let (colors, measures) = (colors.row(inside(y)), measures.row(inside(y)));
        let blocks = self.blocks.row(y);
        let share = |disparity: u16| (2 * u32::from(disparity) / *num_disparities as u32) as u8;
        let difference = |above: u16, below: u16| (64 + ((i32::from(above) - i32::from(below)) >> 2)).clamp(0, 127) as u8;
        for (x, out) in out.as_chunks_mut::<PIXEL_CHANNELS>().0.iter_mut().enumerate() {
            let [left, x_inside, right] = [x.saturating_sub(1), x, x + 1].map(|x| x.min(width - 1));
            let [a, b] = rows.map(|rows| rows[1][x_inside]);
            let (block, sureness) = blocks[x / 4];
            let color = colors[x_inside].map(|value| value >> 1);
            out[..3].copy_from_slice(&color);
            (out[3], out[4], out[5]) = (share(a), share(b), share(block));
            for (out, [before, at, after]) in out[6..10].as_chunks_mut::<2>().0.iter_mut().zip(rows) {
                *out = [difference(at[right], at[left]), difference(after[x_inside], before[x_inside])];
            }
            (out[10], out[11], out[12]) = (difference(b, a), difference(block, a), sureness);
            out[13..].copy_from_slice(&measures[x_inside]);
        }
    }
}
