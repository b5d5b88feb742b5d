//! The end of the network: disparities of pixels by the outputs of its last layer.

use core::{array, iter};

use super::{
    exponentials::{BlockDisparity, Exponentials},
    pooled_candidates::BLOCK,
};

/// The neighbours whose disparities are mixed: the pixel itself, then those around at distances of 1 and 3.
const NEIGHBORS: usize = 17;

/// The tables that turn the outputs of the last layer into disparities and confidences.
///
/// The outputs of a pixel are scores, in sixteenths, by whose exponentials disparities are weighted in a mean:
///
/// | outputs | what they weight |
/// | --- | --- |
/// | 20 to 28 | the disparities of 3x3 blocks around: their mean is a third candidate |
/// | 17, 18, 19 | the disparities of both passes of semi-global matching, and that candidate: their mean is the pixel's choice |
/// | 0 to 16 | the choices of the pixel and of the neighbours |
///
/// Output 29 is a correction in steps of a disparity, and output 30 the logit of the confidence.
#[derive(Clone, Copy, Debug)]
pub struct PixelHead<'a> {
    /// The weights of scores.
    pub exponentials: &'a Exponentials,
    /// The confidences of logits from -128 on.
    pub confidences: &'a [u8; 256],
}

/// The output at a pixel besides its own choice: the correction in two bytes, the lower one first, the distances of the scores
/// of the neighbours' choices below the greatest, and the confidence.
pub type PixelScores = [u8; 2 + NEIGHBORS + 1];

impl PixelHead<'_> {
    /// The outputs of a pixel.
    pub const OUTPUTS: usize = 31;

    /// The choice of a pixel, and what else is known of it, by its outputs, the disparities of both passes, and those of the 3x3
    /// blocks around.
    #[inline]
    pub fn pixel(&self, outputs: &[i16; PixelHead::OUTPUTS], [a, b]: [u16; 2], around: [u16; 9]) -> (u16, PixelScores) {
        let [scores @ .., of_a, of_b, of_block, b0, b1, b2, b3, b4, b5, b6, b7, b8, correction, logit] = *outputs;
        let block = self.exponentials.mean_by_scores([b0, b1, b2, b3, b4, b5, b6, b7, b8], around);
        let choice = self.exponentials.mean_by_scores([of_a, of_b, of_block], [a, b, block]);
        let greatest = scores.iter().copied().max().unwrap_or_default().into();
        let mut pixel = PixelScores::default();
        let [low, high, below @ .., confidence] = &mut pixel;
        [*low, *high] = correction.to_le_bytes();
        *below = scores.map(|score| Exponentials::below(greatest, score.into()));
        *confidence = self.confidences.get((i32::from(logit) + 128).clamp(0, 255) as usize).copied().unwrap_or_default();
        (choice, pixel)
    }

    /// The disparity of the pixel in column `x`, from the least of the search on in steps, at most `most`, and its confidence.
    /// `rows` are the choices of those at distances of -3, -1, 0, 1 and 3, with the nearest row of the image instead of those
    /// beyond it.
    #[inline]
    pub fn disparity(&self, rows: [&[u16]; 5], x: usize, pixel: &PixelScores, most: u16) -> (u16, u8) {
        let [low, high, below @ .., confidence] = *pixel;
        let mean = self.exponentials.mean(iter::zip(below, choices(rows, x)));
        let correction = i16::from_le_bytes([low, high]);
        ((i32::from(mean) + i32::from(correction)).clamp(0, most.into()) as u16, confidence)
    }
}

/// The disparities of the 3x3 blocks around that of a pixel, those nearest where there is none. The blocks lie row by row.
#[inline]
pub fn blocks_around(blocks: &[BlockDisparity], [columns, rows]: [usize; 2], [x, y]: [usize; 2]) -> [u16; 9] {
    let inside = |index: usize, offset: usize, count: usize| (index / BLOCK + offset).saturating_sub(1).min(count - 1);
    array::from_fn(|i| {
        let block = blocks.get(inside(y, i / 3, rows) * columns + inside(x, i % 3, columns));
        block.map_or(0, |&[disparity, _]| disparity)
    })
}

/// The choices of a pixel and of its neighbours: first those at a distance of 1, then those of 3, row by row.
#[inline]
fn choices(rows: [&[u16]; 5], x: usize) -> [u16; NEIGHBORS] {
    let [above3, above, here, below, below3] = rows;
    let end = here.len().saturating_sub(1);
    let [left3, left, right, right3] = [x.saturating_sub(3), x.saturating_sub(1), (x + 1).min(end), (x + 3).min(end)];
    let of = |row: &[u16], x: usize| row.get(x).copied().unwrap_or_default();
    [
        of(here, x),
        of(above, left),
        of(above, x),
        of(above, right),
        of(here, left),
        of(here, right),
        of(below, left),
        of(below, x),
        of(below, right),
        of(above3, left3),
        of(above3, x),
        of(above3, right3),
        of(here, left3),
        of(here, right3),
        of(below3, left3),
        of(below3, x),
        of(below3, right3),
    ]
}
