//! Vectors in words: lanes of 8, 16 or 32 bits.

use super::instruction::{if_byte_not_less, if_not_less, splat, splat_half, uadd16, uqadd8, uqadd16, uqsub8, usub16, words};
use crate::kernel::{
    bytes::ByteVector,
    isa::{Block, Column},
};

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

/// Eight lanes of 8 bits.
#[derive(Clone, Copy, Debug)]
pub struct U8x8(pub(super) [u32; 2]);

impl ByteVector for U8x8 {
    type Memory = [u8; 8];

    #[inline(always)]
    fn store(self, costs: &mut [u8; 8]) {
        let [low, high] = self.0;
        *costs = (u64::from(low) | u64::from(high) << 32).to_le_bytes();
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, uqadd8)
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, uqsub8)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if_byte_not_less(a, b, b, a))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if_byte_not_less(a, b, a, b))
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        let choose = |word: usize| if_byte_not_less(other.0[word], self.0[word], otherwise.0[word], then.0[word]);
        U8x8([choose(0), choose(1)])
    }

    #[inline(always)]
    fn halved(self) -> Self {
        U8x8(self.0.map(|word| word >> 1 & 0x7f7f_7f7f))
    }

    #[inline(always)]
    fn third(self) -> Self {
        U8x8(self.0.map(|word| {
            let [even, odd] = [word, word >> 8].map(|lanes| ((lanes & splat_half(0xff)) * 171) >> 9 & splat_half(0x7f));
            even | odd << 8
        }))
    }

    #[inline(always)]
    fn least(self) -> u8 {
        let [a, b] = self.0;
        let least = if_byte_not_less(a, b, b, a);
        least.to_le_bytes().into_iter().fold(u8::MAX, u8::min)
    }

    #[inline(always)]
    fn least_in_each(self) -> Self {
        U8x8([splat(self.least()); 2])
    }

    #[inline(always)]
    fn moved_up(self, previous: Self) -> Self {
        let ([a, b], [_, before]) = (self.0, previous.0);
        U8x8([a << 8 | before >> 24, b << 8 | a >> 24])
    }

    #[inline(always)]
    fn moved_down(self, next: Self) -> Self {
        let ([a, b], [after, _]) = (self.0, next.0);
        U8x8([a >> 8 | b << 24, b >> 8 | after << 24])
    }
}

impl U8x8 {
    /// The costs in memory.
    #[inline(always)]
    pub(super) fn load(costs: &[u8; 8]) -> U8x8 {
        U8x8(words(costs))
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(u32, u32) -> u32) -> Self {
        U8x8([f(self.0[0], other.0[0]), f(self.0[1], other.0[1])])
    }
}
