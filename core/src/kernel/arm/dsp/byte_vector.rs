//! Eight costs in words.

use super::instruction::{if_byte_not_less, splat, splat_half, uqadd8, uqsub8, words};
use crate::kernel::bytes::ByteVector;

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
