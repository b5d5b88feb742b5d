//! The end of the network: disparities of pixels by the outputs of its last layer, in one look and from two.

use core::{array, iter};

use super::{
    MAX_ACTIVATION,
    channels::{BLOCK, BlockDisparity},
};
use crate::Disparity;

/// The exponentials of 0 and what is below, in steps of a sixteenth: `4096 exp(-k / 16)`, rounded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exponentials(pub [u16; Exponentials::COUNT]);

impl Exponentials {
    /// Scores further below the greatest count as the last of these.
    pub const COUNT: usize = 160;

    /// The distance of a score, in sixteenths, below the greatest, at most the last of the exponentials.
    pub fn below(greatest: i32, score: i32) -> u8 {
        (greatest - score).min(Exponentials::COUNT as i32 - 1) as u8
    }

    /// The weight of a score by how far [below](Exponentials::below) the greatest it is.
    pub fn weight(&self, below: u8) -> u32 {
        self.0.get(usize::from(below)).copied().unwrap_or_default().into()
    }

    /// The mean of values, rounded, each weighted by how far its score is [below](Exponentials::below) the greatest, if
    /// one is the greatest.
    pub fn mean(&self, values: impl Iterator<Item = (u8, u16)>) -> u16 {
        let (weights, sum) = values.fold((0, 0), |(weights, sum), (below, value)| {
            let weight = self.weight(below);
            (weights + weight, sum + u64::from(weight) * u64::from(value))
        });
        (sum + u64::from(weights / 2)).checked_div(weights.into()).unwrap_or_default() as u16
    }

    /// The mean of values, each weighted by its score.
    pub fn mean_by_scores<const COUNT: usize>(&self, scores: [i16; COUNT], values: [u16; COUNT]) -> u16 {
        let greatest = scores.iter().copied().max().unwrap_or_default().into();
        self.mean(iter::zip(scores, values).map(|(score, value)| (Exponentials::below(greatest, score.into()), value)))
    }

    /// The mean of the disparities around the first one of the greatest score, in steps from the least on, and their share of all
    /// scores' weights, times 127. There is at least one score.
    #[inline(always)]
    pub fn selected(&self, scores: impl Iterator<Item = i32> + Clone) -> BlockDisparity {
        let (mut best, mut greatest) = (0, i32::MIN);
        for (index, score) in scores.clone().enumerate() {
            if score > greatest {
                (best, greatest) = (index, score);
            }
        }
        let (mut all, mut around, mut sum) = (0, 0, 0);
        for (index, score) in scores.enumerate() {
            let weight = self.weight(Exponentials::below(greatest, score));
            all += weight;
            if index.abs_diff(best) <= 2 {
                around += weight;
                sum += weight * (Disparity::STEPS as u32 * index as u32);
            }
        }
        let mean = (sum + around / 2).checked_div(around).unwrap_or_default();
        [mean as u16, (u32::from(MAX_ACTIVATION) * around).checked_div(all).unwrap_or_default() as u16]
    }
}

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

/// A pixel's disparity, in steps, and its confidence, times 255, by what the network finds in two looks: at its inputs, and at
/// the same turned by half a turn.
///
/// Findings of one position alone are not sure, and errors that differ cancel. Disparities that are at most a pixel apart are
/// averaged, with the squares of their confidences plus one as weights, and their confidences too. Otherwise the surer is
/// taken. With probabilities `p` and `q` that each is right, and not both, its own is `p (1 - q) / (1 - p q)`.
#[inline]
pub fn fuse_rotations(disparities: [u16; 2], confidences: [u8; 2]) -> (u16, u8) {
    let ([a, b], [p, q]) = (disparities.map(u64::from), confidences.map(u64::from));
    if a.abs_diff(b) <= Disparity::STEPS as u64 {
        let [v, w] = [p, q].map(|confidence| confidence * confidence + 1);
        let mean = (v * a + w * b + (v + w) / 2).checked_div(v + w).unwrap_or_default();
        return (mean as u16, ((p + q) / 2) as u8);
    }
    let ((surer, most), least) = if q > p { ((b, q), p) } else { ((a, p), q) };
    // Zero if both are certain: nothing is known then.
    let not_both = (255 * 255 - most * least).max(1);
    (surer as u16, (255 * most * (255 - least)).checked_div(not_both).unwrap_or_default() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_far_below_count_as_the_last_of_the_exponentials() {
        let exponentials = Exponentials(core::array::from_fn(|below| 1000 - below as u16));
        for (score, below) in [(20, 0), (19, 1), (-138, 158), (-139, 159), (-140, 159), (i32::MIN / 2, 159)] {
            assert_eq!(Exponentials::below(20, score), below, "{score}");
            assert_eq!(exponentials.weight(below), 1000 - u32::from(below), "{score}");
        }
        assert_eq!(exponentials.mean_by_scores([20, -139, i16::MIN], [0, 1000, 1000]), 627);
    }
}
