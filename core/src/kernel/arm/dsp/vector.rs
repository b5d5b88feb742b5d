//! Vectors in words: eight lanes of 16 bits, in halves, or of 32 bits.

use super::instruction::{if_not_less, uadd16, uqadd16, usub16};
use crate::kernel::vector::{Block, Column};

/// Eight lanes of 16 bits.
#[derive(Clone, Copy, Debug)]
pub struct U16x8(pub(super) [u32; 4]);

/// Eight lanes of 32 bits.
#[derive(Clone, Copy, Debug)]
pub struct U32x8(pub(super) [u32; 8]);

impl Column for U16x8 {
    type Sums = [u32; 4];

    #[inline(always)]
    fn store(self, sums: &mut [u32; 4]) {
        *sums = self.0;
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, uadd16)
    }
}

impl Block<u16> for U16x8 {
    type Costs = [u32; 4];
    type Column = U16x8;

    #[inline(always)]
    fn store(self, costs: &mut [u32; 4]) {
        *costs = self.0;
    }

    #[inline(always)]
    fn slide(self, entering: U16x8, leaving: U16x8) -> Self {
        Column::add(self, entering).sub(leaving)
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, uqadd16)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if_not_less(a, b, b, a))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if_not_less(a, b, a, b))
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        let choose = |word: usize| if_not_less(other.0[word], self.0[word], otherwise.0[word], then.0[word]);
        U16x8([choose(0), choose(1), choose(2), choose(3)])
    }

    #[inline(always)]
    fn least(self) -> u16 {
        let [a, b, c, d] = self.0;
        let (a, b) = (if_not_less(a, b, b, a), if_not_less(c, d, d, c));
        let least = if_not_less(a, b, b, a);
        (least as u16).min((least >> 16) as u16)
    }
}

impl U16x8 {
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, usub16)
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(u32, u32) -> u32) -> Self {
        let word = |word: usize| f(self.0[word], other.0[word]);
        U16x8([word(0), word(1), word(2), word(3)])
    }
}

impl Block<u32> for U32x8 {
    type Costs = [u32; 8];
    type Column = U16x8;

    #[inline(always)]
    fn store(self, costs: &mut [u32; 8]) {
        *costs = self.0;
    }

    #[inline(always)]
    fn slide(self, entering: U16x8, leaving: U16x8) -> Self {
        let growth = entering.sub(leaving).0;
        let [low, high] = [growth.map(|word| word as i16 as u32), growth.map(|word| (word as i32 >> 16) as u32)];
        let lanes = [low[0], high[0], low[1], high[1], low[2], high[2], low[3], high[3]];
        self.zip(U32x8(lanes), u32::wrapping_add)
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, u32::wrapping_add)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, u32::min)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, u32::max)
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        let choose = |lane: usize| {
            // Modulo eight, so that no bound is checked.
            let lane = lane % 8;
            if self.0[lane] > other.0[lane] { then.0[lane] } else { otherwise.0[lane] }
        };
        U32x8([0, 1, 2, 3, 4, 5, 6, 7].map(choose))
    }

    #[inline(always)]
    fn least(self) -> u32 {
        self.0.into_iter().fold(u32::MAX, u32::min)
    }
}

impl U32x8 {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(u32, u32) -> u32) -> Self {
        let lane = |lane: usize| f(self.0[lane % 8], other.0[lane % 8]);
        U32x8([0, 1, 2, 3, 4, 5, 6, 7].map(lane))
    }
}
