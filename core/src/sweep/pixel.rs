//! The state of a pixel in 64 bits.

use crate::Disparity;

/// The state of a pixel of the centre: what the frames alone say about it, without its neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SweepPixel {
    /// The disparity at the unit baseline, in steps of 1/4096 of a pixel.
    pub disparity_q12: i32,
    /// The information: the inverse of the variance, in steps of 2^-14 per square pixel, below 2^24. 0 before the first
    /// measurement.
    pub information_q14: u32,
    /// The frames from the left and from the right that agreed, up to 15 of each.
    pub seen: [u8; 2],
    /// The frames from the left and from the right that disagreed, as they do behind something nearer, up to 15 of each.
    pub hidden: [u8; 2],
    /// The changes of hypothesis, up to 3.
    pub changes: u8,
}

impl SweepPixel {
    /// The greatest information.
    pub(super) const MAX_INFORMATION: u32 = (1 << 24) - 1;
    /// The greatest number of frames that are counted.
    const MAX_COUNT: u8 = 15;
    /// The disagreements from each side after which the disparity is forgotten, if they are more than the agreements.
    const PATIENCE: u8 = 3;

    /// The state of a pixel that no frame has measured.
    pub(super) const fn unknown(disparity_q12: i32) -> SweepPixel {
        SweepPixel { disparity_q12, information_q14: 0, seen: [0; 2], hidden: [0; 2], changes: 0 }
    }

    /// Decodes two words: 22 bits of disparity, 2 of changes and 8 of the left frames; 24 of information and 8 of the right
    /// frames. Of those, disagreements come first.
    #[inline(always)]
    pub(super) const fn from_words([first, second]: [u32; 2]) -> SweepPixel {
        SweepPixel {
            disparity_q12: first as i32 >> 10,
            information_q14: second >> 8,
            seen: [(first & 15) as u8, (second & 15) as u8],
            hidden: [(first >> 4 & 15) as u8, (second >> 4 & 15) as u8],
            changes: (first >> 8 & 3) as u8,
        }
    }

    /// Encodes the state for [`from_words`](SweepPixel::from_words).
    #[inline(always)]
    pub(super) const fn to_words(self) -> [u32; 2] {
        let ([hidden_left, hidden_right], [left, right]) = (self.hidden, self.seen);
        let first = (self.disparity_q12 as u32) << 10 | (self.changes as u32) << 8 | (hidden_left as u32) << 4 | left as u32;
        [first, self.information_q14 << 8 | (hidden_right as u32) << 4 | right as u32]
    }

    /// Counts a frame that agrees, from the left (0) or from the right (1).
    #[inline(always)]
    pub(super) fn see(&mut self, side: usize) {
        if let Some(count) = self.seen.get_mut(side) {
            *count = (*count + 1).min(Self::MAX_COUNT);
        }
    }

    /// Counts a frame that disagrees. If most do from both sides, all measurements are forgotten.
    ///
    /// Returns true if they are.
    #[inline(always)]
    pub(super) fn miss(&mut self, side: usize) -> bool {
        if let Some(count) = self.hidden.get_mut(side) {
            *count = (*count + 1).min(Self::MAX_COUNT);
        }
        let is_wrong = |(hidden, seen): (&u8, &u8)| *hidden >= Self::PATIENCE && hidden > seen;
        let forgets = self.hidden.iter().zip(&self.seen).all(is_wrong);
        if forgets {
            *self = SweepPixel { changes: self.changes, ..SweepPixel::unknown(self.disparity_q12) };
            self.change();
        }
        forgets
    }

    /// Counts a change of hypothesis.
    #[inline(always)]
    pub(super) fn change(&mut self) {
        self.changes = (self.changes + 1).min(3);
    }

    /// The disparity, rounded down to a step of 1/64 pixel.
    pub fn disparity(self) -> Option<Disparity> {
        Disparity::from_bits((self.disparity_q12 >> 6) as i16)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_survive_their_encoding() {
        for disparity_q12 in [-511 * 4096, -1, 0, 12345, 511 * 4096] {
            let pixel = SweepPixel {
                disparity_q12,
                information_q14: SweepPixel::MAX_INFORMATION - 5,
                seen: [15, 2],
                hidden: [1, 14],
                changes: 3,
            };
            assert_eq!(SweepPixel::from_words(pixel.to_words()), pixel);
            let zero = SweepPixel::unknown(disparity_q12);
            assert_eq!(SweepPixel::from_words(zero.to_words()), zero);
        }
    }

    #[test]
    fn a_pixel_that_both_sides_deny_forgets() {
        let mut pixel = SweepPixel { information_q14: 9, seen: [2, 1], ..SweepPixel::unknown(77) };
        let misses = [0, 0, 0, 0, 1, 1].map(|side| pixel.miss(side));
        assert_eq!((misses, pixel.information_q14), ([false; 6], 9));
        assert!(pixel.miss(1));
        assert_eq!(pixel, SweepPixel { changes: 1, ..SweepPixel::unknown(77) });
    }
}
