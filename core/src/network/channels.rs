//! The inputs of the network: costs pooled over blocks for the volume part, and channels of pixels for the image part.
//!
//! Two passes of semi-global matching along eight paths, A and B, give disparities and sums of path costs. There are four
//! matching costs: those of A fused over all views by [their least and by the mean of inliers](COST_FUSIONS), then those of B.
//! The *excess* of a candidate is what its sum has above the least sum of the pixel, in eighths rounded down, at most 127; that
//! of a candidate which no view sees is 127.

use core::ops::Range;

use super::MAX_ACTIVATION;
use crate::{Disparity, Fusion, SearchConfig, SearchSpace, infallible, kernel::DistanceFusion};

/// The disparity of a block of pixels that the volume part finds, from the least of the search on in steps, and how sure it is,
/// from 0 to 127.
pub type BlockDisparity = [u16; 2];

/// The side of the blocks of pixels over which costs are pooled.
pub const BLOCK: usize = 4;
/// The sides of pooled images are multiples of so many blocks, so that they can be halved twice.
pub const BLOCKS: usize = 4;
/// The measures of a pixel:
///
/// - the margins of A and B: see [`excesses`],
/// - the [measures](cost_measure) of the four costs of the candidate nearest to the disparity of A, then of that of B,
/// - the excess of the former in B.
pub const MEASURES: usize = 11;
/// The channels of a pooled candidate:
///
/// - the sums of the four costs, in eighths rounded down; a cost is at most 63, which is that of a candidate which
///   no view sees,
/// - the mean, rounded down, and the least of the excesses in B, then in A.
pub const CANDIDATE_CHANNELS: usize = 8;

/// The fusions of the costs of a pass.
pub const COST_FUSIONS: [DistanceFusion; 2] = [DistanceFusion::Rule(Fusion::Min), DistanceFusion::Inliers];

/// A cost is at most this where costs are pooled: that of a candidate which no view sees.
pub const MAX_POOLED_COST: u8 = 63;

/// The cost and the sum of path costs of a candidate that no view sees.
const NO_COST: u8 = u8::MAX;
const NO_SUM: u16 = u16::MAX;

/// A search with an even number of disparities, if there is another one: a volume has two in a slice, and the network was never
/// trained with half a slice.
pub const fn paired(search: &SearchSpace) -> SearchSpace {
    let config = search.config();
    match (SearchConfig { num_disparities: config.num_disparities.next_multiple_of(2), ..config }).checked() {
        Ok(paired) => paired,
        Err(_) => *search,
    }
}

/// The blocks along the side of an image, a multiple of [`BLOCKS`]. Pixels beyond the image are those of its last row and column.
pub const fn padded_blocks(side: usize) -> usize {
    infallible::div_ceil(side, BLOCK * BLOCKS) * BLOCKS
}

/// The rows of pixels of a row of blocks, in an image of `height` rows.
pub fn block_rows(row: usize, height: usize) -> impl Iterator<Item = usize> + Clone {
    let last = height.saturating_sub(1);
    (BLOCK * row..BLOCK * (row + 1)).map(move |v| v.min(last))
}

/// The candidate nearest to a disparity, counted from the least of the search on in steps.
#[inline(always)]
pub fn nearest_candidate(disparity: u16) -> usize {
    let steps = Disparity::STEPS as usize;
    (usize::from(disparity) + steps / 2) / steps
}

/// The channel of a pooled candidate that has the sum of a cost of its block, each at most [`MAX_POOLED_COST`].
#[inline(always)]
pub fn cost_channel(sum: u16) -> u8 {
    (sum / 8) as u8
}

/// The channels that have the sum of the excesses of its block, and the least.
#[inline(always)]
pub fn excess_channels(sum: u16, least: u8) -> [u8; 2] {
    [(sum / (BLOCK * BLOCK) as u16) as u8, least]
}

/// The excesses of a pixel's candidates, by their sums of path costs; and its margin: the excess of the best candidate that is
/// more than one disparity from the winner, 127 if there is none, and 0 where no view sees a candidate.
#[inline(always)]
pub fn excesses(sums: &[u16], values: &mut [u8]) -> u8 {
    let least = sums.iter().copied().fold(NO_SUM, u16::min);
    // Sums are far below that of a candidate which does not exist, so its excess is the most possible. If none
    // exists, all are.
    let base = if least == NO_SUM { 0 } else { least };
    for (value, &sum) in values.iter_mut().zip(sums) {
        *value = ((sum - base) / 8).min(MAX_ACTIVATION.into()) as u8;
    }
    if least == NO_SUM {
        return 0;
    }
    let best = sums.iter().position(|&sum| sum == least).unwrap_or_default();
    let before = values.get(..best.saturating_sub(1)).unwrap_or_default();
    let after = values.get(best + 2..).unwrap_or_default();
    before.iter().chain(after).copied().fold(MAX_ACTIVATION, u8::min)
}

/// Three times a cost, at most 126; 127 where no view sees the candidate.
#[inline(always)]
pub fn cost_measure(cost: u8) -> u8 {
    if cost == NO_COST { MAX_ACTIVATION } else { cost.saturating_mul(3).min(MAX_ACTIVATION - 1) }
}

/// Adds the values of a line of pixels to the sums of the blocks that they are in, and lowers the least ones. There are `stride`
/// values for each pixel, and as many sums and least values for each block.
#[inline(always)]
pub fn pool(values: &[u8], stride: usize, sums: &mut [u16], least: &mut [u8]) {
    let last = (values.len() / stride.max(1)).saturating_sub(1);
    let blocks = sums.chunks_exact_mut(stride.max(1)).zip(least.chunks_exact_mut(stride.max(1)));
    for (column, (sums, least)) in blocks.enumerate() {
        for u in pixels(column).map(|u| u.min(last)) {
            let values = values.get(u * stride..(u + 1) * stride).unwrap_or_default();
            for ((sum, least), &value) in sums.iter_mut().zip(&mut *least).zip(values) {
                *sum += u16::from(value);
                *least = (*least).min(value);
            }
        }
    }
}

/// The pixels of a block along a line.
fn pixels(block: usize) -> Range<usize> {
    BLOCK * block..BLOCK * (block + 1)
}

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
