//! The inputs of the network's image part at each pixel.

use super::{
    exponentials::BlockDisparity,
    pooled_candidates::{BLOCK, MEASURES},
};

/// The channels of a pixel.
pub const PIXEL_CHANNELS: usize = 24;

/// A row of pixels of the padded image. Slices end with the image: pixels beyond it are those of the last column.
#[derive(Clone, Copy, Debug)]
pub struct PixelRow<'a> {
    /// The colours of the centre, or three times its grey value.
    pub colors: &'a [[u8; 3]],
    /// The disparities of A and B in the row above, this one, and the one below, from the least of the search on, in steps.
    pub winners: [[&'a [u16]; 3]; 2],
    /// See [`MEASURES`].
    pub measures: &'a [[u8; MEASURES]],
    /// Those of the blocks that the volume part finds.
    pub blocks: &'a [BlockDisparity],
    /// The disparities that are searched.
    pub num_disparities: usize,
}

impl PixelRow<'_> {
    /// Computes the channels of all pixels, for which there is room in `out`.
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
    #[inline]
    pub fn channels(&self, out: &mut [u8]) {
        let last = self.colors.len().saturating_sub(1);
        let of = |row: &[u16], x: usize| row.get(x).copied().unwrap_or_default();
        let share =
            |disparity: u16| (2 * u32::from(disparity)).checked_div(self.num_disparities as u32).unwrap_or_default() as u8;
        let difference = |above: u16, below: u16| (64 + ((i32::from(above) - i32::from(below)) >> 2)).clamp(0, 127) as u8;
        for (x, out) in out.as_chunks_mut::<PIXEL_CHANNELS>().0.iter_mut().enumerate() {
            let [left, inside, right] = [x.saturating_sub(1), x, x + 1].map(|x| x.min(last));
            let [a, b] = self.winners.map(|[_, row, _]| of(row, inside));
            let [block, sureness] = self.blocks.get(x / BLOCK).copied().unwrap_or_default();
            let [red, green, blue] = self.colors.get(inside).copied().unwrap_or_default().map(|value| value >> 1);
            let [along_a, along_b] = self.winners.map(|[_, row, _]| difference(of(row, right), of(row, left)));
            let [down_a, down_b] = self.winners.map(|[above, _, below]| difference(of(below, inside), of(above, inside)));
            let [margin_a, margin_b, costs @ ..] = self.measures.get(inside).copied().unwrap_or_default();
            let [a0, a1, a2, a3, b0, b1, b2, b3, excess] = costs;
            *out = [
                red,
                green,
                blue,
                share(a),
                share(b),
                share(block),
                along_a,
                down_a,
                along_b,
                down_b,
                difference(b, a),
                difference(block, a),
                sureness as u8,
                margin_a,
                margin_b,
                a0,
                a1,
                a2,
                a3,
                b0,
                b1,
                b2,
                b3,
                excess,
            ];
        }
    }
}
