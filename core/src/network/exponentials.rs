//! Means weighted by exponentials of scores, in whole numbers.

use core::iter;

use super::MAX_ACTIVATION;
use crate::Disparity;

/// The disparity of a block of pixels that the volume part finds, from the least of the search on in steps, and how sure it is, from
/// 0 to 127.
pub type BlockDisparity = [u16; 2];

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
