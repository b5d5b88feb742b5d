//! The loops over the disparities of a pixel.

use core::slice;

use super::{
    divisor::Divisor,
    hamming::{Candidates, hamming_loop},
    lanes::Bytes,
    paths::{Step, extend_loop},
};
use crate::{
    Fusion,
    kernel::{blocks::Blocks, rule::Rule, steps::Steps},
};

/// The loops over the 8-bit costs of a pixel.
///
/// The provided loops are their definition. An instruction set that overrides one computes the same.
pub trait PixelLoops: Bytes {
    /// Fuses the Hamming distances of a pixel's `descriptor` to the candidates of `V` views, rounded down. Costs past
    /// the last of `count` disparities are 255.
    #[inline(always)]
    fn hamming_costs<const N: usize, const V: usize>(
        self,
        fusion: Fusion,
        descriptor: [u8; N],
        views: &[Candidates<'_, N>; V],
        count: usize,
        costs: &mut [Self::Samples],
    ) {
        hamming_loop(self, fusion, descriptor, views, count, costs);
    }

    /// Divides fused sums to matching costs, in the order of the disparities. `quotients` are as many.
    #[inline(always)]
    fn divide(self, divisor: Divisor, sums: &[<Self as Blocks<u16>>::Costs], quotients: &mut [u8]) {
        for (sums, quotients) in sums.iter().zip(quotients.chunks_exact_mut(Self::LANES)) {
            let lanes: &[u16] = bytemuck::try_cast_slice(slice::from_ref(sums)).unwrap_or_default();
            for (index, quotient) in quotients.iter_mut().enumerate() {
                *quotient = divisor.divide(lanes.get(Self::lane(index)).copied().unwrap_or(u16::MAX));
            }
        }
    }

    /// [`slide_and_fuse`](Blocks::slide_and_fuse) and [`divide`](PixelLoops::divide). The fused sums are only a
    /// buffer.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "those of both operations")]
    fn slide_and_divide<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        divisor: Divisor,
        steps: &mut Steps<'_, Self, V>,
        blocks: &mut [[<Self as Blocks<u16>>::Costs; V]],
        masks: &[[<Self as Blocks<u16>>::Costs; V]],
        fused: &mut [<Self as Blocks<u16>>::Costs],
        quotients: &mut [u8],
    ) {
        Blocks::<u16>::slide_and_fuse(self, rule, masked, steps, blocks, masks, fused);
        self.divide(divisor, fused, quotients);
    }

    /// Extends paths by a pixel with these `costs`.
    ///
    /// The excess of the paths over the costs, at most [`PathPenalties::MAX`](crate::PathPenalties::MAX) each, is
    /// written to `excess` if `FIRST` is set, and added to it otherwise.
    #[inline(always)]
    fn extend<const N: usize, const FIRST: bool>(
        self,
        costs: &[Self::Samples],
        steps: [Step<'_>; N],
        p1: u8,
        excess: &mut [Self::Samples],
    ) {
        extend_loop::<Self, N, FIRST>(self, costs, steps, p1, excess);
    }

    /// The least of `paths`, at most 127, times the cost plus the excess, over all lanes, and the index of the
    /// first lane that has it.
    #[inline(always)]
    fn winner(self, paths: u16, costs: &[Self::Samples], excess: &[Self::Samples]) -> (u16, usize) {
        let (costs, excess): (&[u8], &[u8]) = (bytemuck::cast_slice(costs), bytemuck::cast_slice(excess));
        let sums = || costs.iter().zip(excess).map(|(&cost, &excess)| paths * u16::from(cost) + u16::from(excess));
        let least = sums().fold(u16::MAX, u16::min);
        (least, sums().position(|sum| sum == least).unwrap_or_default())
    }
}
