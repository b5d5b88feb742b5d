//! Means weighted by exponentials of scores, in whole numbers.

/// The exponentials of 0 and what is below, in steps of a sixteenth: `4096 exp(-k / 16)`, rounded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exponentials(pub [u16; Exponentials::COUNT]);

impl Exponentials {
    /// Scores further below the greatest count as the last of these.
    pub const COUNT: usize = 160;

    /// How far a score, in sixteenths, is below the greatest, at most the last of the exponentials.
    pub fn below(greatest: i32, score: i32) -> u8 {
        (greatest - score).min(Exponentials::COUNT as i32 - 1) as u8
    }

    /// The weight of a score by how far [below](Exponentials::below) the greatest it is.
    pub fn weight(&self, below: u8) -> u32 {
        self.0[usize::from(below)].into()
    }

    /// The mean of values, rounded, each weighted by how far its score is [below](Exponentials::below) the greatest, if
    /// one is the greatest.
    pub fn mean(&self, values: impl Iterator<Item = (u8, u16)>) -> u16 {
        let (weights, sum) = values.fold((0, 0), |(weights, sum), (below, value)| {
            let weight = self.weight(below);
            (weights + weight, sum + u64::from(weight) * u64::from(value))
        });
        ((sum + u64::from(weights / 2)) / u64::from(weights)) as u16
    }

    /// The mean of values, each weighted by its score.
    pub fn mean_by_scores<const COUNT: usize>(&self, scores: [i16; COUNT], values: [u16; COUNT]) -> u16 {
        let greatest = scores.iter().copied().max().unwrap_or_default().into();
        self.mean(std::iter::zip(scores, values).map(|(score, value)| (Exponentials::below(greatest, score.into()), value)))
    }
}
