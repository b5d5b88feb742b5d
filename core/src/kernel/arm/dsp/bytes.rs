//! The operations on 8-bit costs in the DSP extension.
#![allow(unsafe_code)]

use super::{
    Dsp,
    blocks::{are_four, slide_to_min},
    fuse::Costs,
    instruction::{splat, words},
    pixel, runs,
    vector::U8x8,
};
use crate::{
    SemiGlobalParams,
    kernel::{
        blocks::Blocks,
        bytes::{
            BackwardRun, Bytes, Divisor, ForwardRun, PixelLoops, PixelPaths, RunLoops, Slot, Step, backward_loop, forward_loop,
        },
        portable::Portable,
        rule::Rule,
        steps::Steps,
    },
};

/// Pixels whose path from the right is extended before they are handed over.
const PIXELS: usize = 32;

/// True if costs are aligned to words.
fn are_words(costs: &[u8]) -> bool {
    costs.as_ptr().cast::<u32>().is_aligned()
}

impl Bytes for Dsp {
    type Bytes = U8x8;

    #[inline(always)]
    fn load_bytes(self, costs: &[u8; 8]) -> U8x8 {
        U8x8::load(costs)
    }

    #[inline(always)]
    fn splat_byte(self, cost: u8) -> U8x8 {
        U8x8([splat(cost); 2])
    }

    #[inline(always)]
    fn byte_indices(self) -> U8x8 {
        U8x8([0x0302_0100, 0x0706_0504])
    }

    #[inline(always)]
    fn hamming_distances<const N: usize>(self, descriptor: [u8; N], others: [&[u8; 8]; N]) -> U8x8 {
        let mut distances = [0; 2];
        for (byte, others) in descriptor.into_iter().zip(others) {
            for (distances, others) in distances.iter_mut().zip(words(others)) {
                *distances += count_ones(splat(byte) ^ others);
            }
        }
        U8x8(distances)
    }
}

impl PixelLoops for Dsp {
    #[inline(always)]
    fn divide(self, divisor: Divisor, sums: &[Costs], quotients: &mut [u8]) {
        let Divisor { shift, by_three } = divisor;
        if by_three || shift > pixel::MOST_SHIFT || sums.is_empty() || quotients.len() != 8 * sums.len() {
            return divide_others(divisor, sums, quotients);
        }
        let quotients = quotients.as_mut_ptr();
        // SAFETY: there are as many quotients as lanes of sums, which are a multiple of what is unrolled. The
        // shift is not too large.
        unsafe {
            match sums.len() {
                4 => pixel::by_power_of_two::<4>(shift, sums, quotients),
                _ => pixel::by_power_of_two::<1>(shift, sums, quotients),
            }
        }
    }

    #[inline(always)]
    fn slide_and_divide<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        divisor: Divisor,
        steps: &mut Steps<'_, Self, V>,
        blocks: &mut [[Costs; V]],
        masks: &[[Costs; V]],
        fused: &mut [Costs],
        quotients: &mut [u8],
    ) {
        let is_short = !divisor.by_three && divisor.shift <= pixel::MOST_SHIFT;
        if rule != Rule::Min || !is_short || !are_four(steps, blocks, masks, fused) || quotients.len() != runs::DEPTH {
            Blocks::<u16>::slide_and_fuse(self, rule, masked, steps, blocks, masks, fused);
            return self.divide(divisor, fused, quotients);
        }
        let Some(step) = steps.next_raw() else { return };
        // SAFETY: there are four views, four vectors of each, and as many quotients. The shift is not too large.
        unsafe {
            slide_to_min::<V, false>(masked, step, blocks, masks, fused);
            pixel::by_power_of_two::<4>(divisor.shift, fused, quotients.as_mut_ptr());
        }
    }

    #[inline(always)]
    fn extend<const N: usize, const FIRST: bool>(self, costs: &[[u8; 8]], steps: [Step<'_>; N], p1: u8, excess: &mut [[u8; 8]]) {
        let slot = Slot::bytes(8 * costs.len());
        let fits = |step: &Step<'_>| (step.before.len() == slot) & (step.after.len() == slot);
        if !costs.is_empty() && costs.len() == excess.len() && steps.iter().all(fits) {
            // SAFETY: there are as many vectors of costs as of excess, not 0, and all slots are for as many.
            unsafe { pixel::extend::<N, FIRST>(costs, steps, p1, excess) }
        }
    }

    #[inline(always)]
    fn winner(self, paths: u16, costs: &[[u8; 8]], excess: &[[u8; 8]]) -> (u16, usize) {
        if usize::from(paths) != SemiGlobalParams::PATHS || costs.len() != excess.len() {
            return Portable::<8>.winner(paths, costs, excess);
        }
        let mut least = (u16::MAX, 0);
        let parts = costs.chunks(pixel::MOST_VECTORS).zip(excess.chunks(pixel::MOST_VECTORS));
        for ((costs, excess), first) in parts.zip((0..).step_by(8 * pixel::MOST_VECTORS)) {
            // SAFETY: there are as many vectors of each, from 1 to the most.
            let (sum, index) = pixel::unpack(unsafe { pixel::least_key(costs, excess) });
            if sum < least.0 {
                least = (sum, first + index);
            }
        }
        least
    }
}

impl RunLoops for Dsp {
    #[inline(always)]
    fn extend_forward(self, run: ForwardRun<'_, '_>) {
        let pixels = run.costs.len() / runs::DEPTH;
        let fits = run.depth == runs::DEPTH
            && pixels > 0
            && run.costs.len() == pixels * runs::DEPTH
            && run.excess.len() == run.costs.len()
            && are_words(run.costs) & are_words(run.excess)
            && run.along[0].len() == runs::STRIDE
            && run.from_above.iter().all(|slots| slots.len() == (pixels + 1) * runs::STRIDE);
        if !fits {
            return forward_loop(self, run);
        }
        let ForwardRun { start, costs, excess, along, mut from_above, penalties, .. } = run;
        let parts = costs.chunks(PIXELS * runs::DEPTH).zip(excess.chunks_mut(PIXELS * runs::DEPTH));
        let mut p2 = [[0; 4]; PIXELS];
        for ((costs, excess), first) in parts.zip((0..).step_by(PIXELS)) {
            let pixels = costs.len() / runs::DEPTH;
            let slots = first * runs::STRIDE..(first + pixels + 1) * runs::STRIDE;
            let from_above = from_above.each_mut().map(|all| all.get_mut(slots.clone()).unwrap_or_default());
            let Some(p2) = p2.get_mut(..pixels) else { return };
            p2.iter_mut().zip(start + first..).for_each(|(p2, u)| *p2 = penalties.forward_p2(u));
            // SAFETY: there are costs and excess for each P2, not 0, and aligned, and a slot for each pixel and one
            // more: `fits` covers all parts.
            unsafe { runs::forward(penalties.p1, p2, costs, excess, along[0], from_above) }
        }
    }

    #[inline(always)]
    fn extend_backward(self, paths: u16, run: BackwardRun<'_, '_>, mut reach: impl FnMut(PixelPaths<'_>)) {
        let fits = run.depth == runs::DEPTH
            && usize::from(paths) == SemiGlobalParams::PATHS
            && are_words(run.costs) & are_words(run.excess)
            && run.along[0].len() == runs::STRIDE;
        if !fits {
            return backward_loop(self, paths, run, reach);
        }
        let BackwardRun { costs, excess, along, penalties, .. } = run;
        let (costs, excess) = (costs.as_chunks::<{ runs::DEPTH }>().0, excess.as_chunks_mut::<{ runs::DEPTH }>().0);
        let (mut p2, mut keys) = ([0; PIXELS], [0; PIXELS]);
        let mut end = costs.len().min(excess.len());
        while end > 0 {
            let start = end.saturating_sub(PIXELS);
            let (Some(costs), Some(excess), Some(p2), Some(keys)) =
                (costs.get(start..end), excess.get_mut(start..end), p2.get_mut(..end - start), keys.get_mut(..end - start))
            else {
                return;
            };
            p2.iter_mut().zip((start..end).rev()).for_each(|(p2, u)| *p2 = penalties.backward_p2(u));
            // SAFETY: there are costs and excess for each key and P2, aligned, and a slot.
            unsafe {
                runs::backward(penalties.p1, p2, costs.as_flattened(), excess.as_flattened_mut(), along[0], keys);
            }
            for (i, ((costs, excess), &mut key)) in costs.iter().zip(&*excess).zip(keys).enumerate() {
                reach(PixelPaths { column: start + i, costs, excess, winner: pixel::unpack(key) });
            }
            end = start;
        }
    }
}

/// [`PixelLoops::divide`] by three, or by large powers of two.
#[inline]
fn divide_others(divisor: Divisor, sums: &[Costs], quotients: &mut [u8]) {
    let words = quotients.chunks_exact_mut(4);
    for ([even, odd], quotients) in sums.iter().flat_map(|&[a, b, c, d]| [[a, b], [c, d]]).zip(words) {
        quotients.copy_from_slice(&pixel::four(divisor, even, odd).to_le_bytes());
    }
}

/// The number of bits that are set in each byte of a word.
#[inline(always)]
fn count_ones(word: u32) -> u32 {
    let pairs = word - (word >> 1 & 0x5555_5555);
    let nibbles = (pairs & 0x3333_3333) + (pairs >> 2 & 0x3333_3333);
    (nibbles + (nibbles >> 4)) & 0x0f0f_0f0f
}
