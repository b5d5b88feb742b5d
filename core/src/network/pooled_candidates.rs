//! The inputs of the network from the costs.
//!
//! Two passes of semi-global matching along eight paths, A and B, give disparities and sums of path costs. There are four
//! matching costs: those of A fused by their least and by their mean over all views, then those of B. The *excess* of a candidate
//! is what its sum has above the least sum of the pixel, in eighths rounded down, at most 127; that of a candidate which no view
//! sees is 127.

use core::ops::Range;

use super::MAX_ACTIVATION;
use crate::{Disparity, Search, SearchConfig};

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

/// A cost is at most this where costs are pooled: that of a candidate which no view sees.
pub const MAX_POOLED_COST: u8 = 63;

/// The cost and the sum of path costs of a candidate that no view sees.
const NO_COST: u8 = u8::MAX;
const NO_SUM: u16 = u16::MAX;

/// A search with an even number of disparities, if there is another one: a volume has two in a slice, and the network was never
/// trained with half a slice.
pub const fn paired(search: &Search) -> Search {
    let config = search.config();
    match (SearchConfig { num_disparities: config.num_disparities.next_multiple_of(2), ..config }).checked() {
        Ok(paired) => paired,
        Err(_) => *search,
    }
}

/// The blocks along the side of an image, a multiple of [`BLOCKS`]. Pixels beyond the image are those of its last row and column.
pub const fn padded_blocks(side: usize) -> usize {
    side.div_ceil(BLOCK * BLOCKS) * BLOCKS
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
