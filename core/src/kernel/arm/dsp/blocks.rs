//! The inner loops in the DSP extension.
#![allow(unsafe_code)]

use core::arch::asm;

use bytemuck::Pod;

use super::{
    Dsp, VECTOR,
    fuse::{self, Costs},
    slide,
    vector::{U16x8, U32x8},
    wide::{self, WideCosts},
};
use crate::kernel::{
    blocks::{Blocks, fuse_loop, fuse_masked_loop},
    isa::{Block, Isa},
    rule::Rule,
    steps::{RawStep, Steps},
};

/// True if there are four views, and four vectors of each.
#[inline(always)]
pub(super) fn are_four<const V: usize>(
    steps: &Steps<'_, Dsp, V>,
    blocks: &[[Costs; V]],
    masks: &[[Costs; V]],
    fused: &[Costs],
) -> bool {
    (V == 4) & (blocks.len() == 4) & (masks.len() == 4) & (fused.len() == 4) & (steps.vectors() == 4)
}

/// Slides the blocks of a pixel, and fuses them by the minimum. Returns the least fused cost in each half of a
/// word; any word if `LEAST` is not set.
///
/// # Safety
/// There are four views, and four vectors of each.
#[inline(always)]
pub(super) unsafe fn slide_to_min<const V: usize, const LEAST: bool>(
    masked: u8,
    step: RawStep<'_, Dsp, V>,
    blocks: &mut [[Costs; V]],
    masks: &[[Costs; V]],
    fused: &mut [Costs],
) -> u32 {
    // SAFETY: the step has as many vectors as there are blocks, masks and fused costs.
    unsafe {
        slide::slide::<_, V, 4>(step, blocks);
        let (blocks, masks) = (blocks.as_ptr(), masks.as_ptr());
        match masked {
            0 => fuse::min::<V, 4, LEAST>(blocks, fused),
            1 => fuse::min_with_one_masked::<V, 0, LEAST>(blocks, masks, fused),
            2 => fuse::min_with_one_masked::<V, 1, LEAST>(blocks, masks, fused),
            4 => fuse::min_with_one_masked::<V, 2, LEAST>(blocks, masks, fused),
            8 => fuse::min_with_one_masked::<V, 3, LEAST>(blocks, masks, fused),
            _ => fuse::min_masked(blocks, masks, fused),
        }
    }
}

/// The lesser half of a word.
#[inline(always)]
fn lesser_half(word: u32) -> u16 {
    (word as u16).min((word >> 16) as u16)
}

/// [`Blocks::slide`].
#[inline(never)]
fn slide_blocks<C: Pod, const V: usize>(steps: &mut Steps<'_, Dsp, V>, blocks: &mut [[C; V]]) {
    if steps.vectors() != blocks.len() || blocks.is_empty() {
        return;
    }
    let Some(step) = steps.next_raw() else { return };
    // SAFETY: the step has as many vectors as there are blocks, not 0.
    unsafe {
        match blocks.len() {
            1 => slide::slide::<C, V, 1>(step, blocks),
            2 => slide::slide::<C, V, 2>(step, blocks),
            4 => slide::slide::<C, V, 4>(step, blocks),
            8 if const { V <= 4 && size_of::<C>() == VECTOR } => slide::slide::<C, V, 8>(step, blocks),
            _ => slide::slide::<C, V, 0>(step, blocks),
        }
    }
}

#[inline(never)]
fn prime<const V: usize>(steps: &mut Steps<'_, Dsp, V>) {
    let vectors = steps.vectors();
    if let Some(step) = steps.next_raw().filter(|_| vectors > 0) {
        // SAFETY: the step has so many vectors in a view, and they are not 0.
        unsafe { slide::prime(step, vectors) }
    }
}

impl Blocks<u16> for Dsp {
    const MOST_MASKED_OF_SUM: u32 = 1;
    type Costs = Costs;
    type Block = U16x8;

    #[inline(always)]
    fn load_block(self, costs: &[u32; 4]) -> U16x8 {
        U16x8(*costs)
    }

    #[inline(always)]
    fn splat(self, cost: u16) -> U16x8 {
        U16x8([u32::from(cost) * 0x1_0001; 4])
    }

    #[inline(always)]
    fn position(self, costs: &[[u32; 4]], cost: u16) -> usize {
        if costs.is_empty() {
            return 0;
        }
        let (found, vectors_left): (u32, usize);
        // SAFETY: reads one vector after the other, at least one, at most all. Every register that changes is
        // an output.
        unsafe {
            asm!(
                "2:",
                "ldm {costs}!, {{r0, r1, r2, r3}}",
                // A bit for each half that has the cost, since none is less.
                "usub16 r0, {cost}, r0",
                "sel r0, {ones}, {zero}",
                "usub16 r1, {cost}, r1",
                "sel r1, {ones}, {zero}",
                "usub16 r2, {cost}, r2",
                "sel r2, {ones}, {zero}",
                "usub16 r3, {cost}, r3",
                "sel r3, {ones}, {zero}",
                "orr r0, r0, r1, lsl #1",
                "orr r2, r2, r3, lsl #1",
                "orrs r0, r0, r2, lsl #4",
                "bne 3f",
                "subs {vectors_left}, {vectors_left}, #1",
                "bne 2b",
                "3:",
                costs = inout(reg) costs.as_ptr() => _,
                vectors_left = inout(reg) costs.len() => vectors_left,
                cost = in(reg) u32::from(cost) * 0x1_0001,
                ones = in(reg) 0x1_0001,
                zero = in(reg) 0,
                out("r0") found,
                out("r1") _,
                out("r2") _,
                out("r3") _,
                options(readonly, nostack),
            );
        }
        // Bits in the order of the disparities; none if no lane has the cost.
        let lanes = found | found >> 14;
        8 * (costs.len() - vectors_left) + lanes.trailing_zeros() as usize
    }

    #[inline(always)]
    fn prime<const V: usize>(self, steps: &mut Steps<'_, Self, V>) {
        prime(steps);
    }

    #[inline(always)]
    fn slide<const V: usize>(self, steps: &mut Steps<'_, Self, V>, blocks: &mut [[[u32; 4]; V]]) {
        slide_blocks(steps, blocks);
    }

    #[inline(always)]
    fn slide_and_fuse<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        steps: &mut Steps<'_, Self, V>,
        blocks: &mut [[[u32; 4]; V]],
        masks: &[[[u32; 4]; V]],
        fused: &mut [[u32; 4]],
    ) -> u16 {
        if rule == Rule::Min && are_four(steps, blocks, masks, fused) {
            let Some(step) = steps.next_raw() else { return u16::MAX };
            // SAFETY: there are four views, and four vectors of each.
            let least = unsafe { slide_to_min::<V, true>(masked, step, blocks, masks, fused) };
            return lesser_half(least);
        }
        Blocks::<u16>::slide(self, steps, blocks);
        self.fuse_masked(rule, masked, blocks, masks, fused)
    }

    #[inline(never)]
    fn fuse<const V: usize>(self, rule: Rule, blocks: &[[[u32; 4]; V]], fused: &mut [[u32; 4]]) -> u16 {
        let has_loop = match rule {
            Rule::Min => true,
            Rule::Heuristic => V == 4,
            Rule::Half => V == 8,
            Rule::Sum => matches!(V, 2..=4),
        };
        if !has_loop || blocks.len() != fused.len() || blocks.is_empty() {
            return fuse_loop(self, rule, blocks, fused);
        }
        let blocks = blocks.as_ptr();
        // SAFETY: there are as many blocks as fused costs, not 0: a multiple of what is unrolled. The heuristic rule has a
        // loop for four views, and there are four; the least half has one for eight, and there are eight; the sum has one for
        // two to four.
        lesser_half(unsafe {
            match fused.len() {
                _ if rule == Rule::Heuristic => fuse::heuristic_of_four(blocks.cast(), fused),
                _ if rule == Rule::Half => fuse::half_of_eight(blocks.cast(), fused),
                _ if rule == Rule::Sum => fuse::sum(blocks, fused),
                n if V <= 4 && n % 4 == 0 => fuse::min::<V, 4, true>(blocks, fused),
                _ => fuse::min::<V, 1, true>(blocks, fused),
            }
        })
    }

    #[inline(always)]
    fn fuse_masked<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        blocks: &[[[u32; 4]; V]],
        masks: &[[[u32; 4]; V]],
        fused: &mut [[u32; 4]],
    ) -> u16 {
        match masked {
            0 => self.fuse(rule, blocks, fused),
            _ => fuse_masked(self, rule, masked, blocks, masks, fused),
        }
    }

    #[inline(always)]
    fn least(self, costs: &[[u32; 4]]) -> u16 {
        least::<{ Dsp::LANES }>(costs)
    }
}

/// [`Blocks::fuse_masked`] with a view that is masked.
#[inline(never)]
fn fuse_masked<const V: usize>(
    dsp: Dsp,
    rule: Rule,
    masked: u8,
    blocks: &[[Costs; V]],
    masks: &[[Costs; V]],
    fused: &mut [Costs],
) -> u16 {
    let fits = blocks.len() == fused.len() && masks.len() == fused.len() && !fused.is_empty();
    let least = match rule {
        // SAFETY: there are as many blocks and masks as fused costs, not 0, and four where one view is
        // masked, which is one of them.
        Rule::Min if fits => unsafe {
            let (blocks, masks) = (blocks.as_ptr(), masks.as_ptr());
            match (masked, fused.len()) {
                _ if V > 4 => fuse::min_masked(blocks, masks, fused),
                (1, 4) => fuse::min_with_one_masked::<V, 0, true>(blocks, masks, fused),
                (2, 4) if V > 1 => fuse::min_with_one_masked::<V, 1, true>(blocks, masks, fused),
                (4, 4) if V > 2 => fuse::min_with_one_masked::<V, 2, true>(blocks, masks, fused),
                (8, 4) if V > 3 => fuse::min_with_one_masked::<V, 3, true>(blocks, masks, fused),
                _ => fuse::min_masked(blocks, masks, fused),
            }
        },
        // SAFETY: there are as many blocks and masks as fused costs, not 0, and one view is masked, which is one of them.
        Rule::Sum if fits && matches!(V, 2..=4) && masked.is_power_of_two() && masked < 1 << V => unsafe {
            let (blocks, masks) = (blocks.as_ptr(), masks.as_ptr());
            match masked {
                1 => fuse::sum_with_one_masked::<V, 0>(blocks, masks, fused),
                2 => fuse::sum_with_one_masked::<V, 1>(blocks, masks, fused),
                4 => fuse::sum_with_one_masked::<V, 2>(blocks, masks, fused),
                _ => fuse::sum_with_one_masked::<V, 3>(blocks, masks, fused),
            }
        },
        // SAFETY: there are four views, and as many blocks and masks as fused costs, not 0.
        Rule::Heuristic if fits && V == 4 => unsafe {
            fuse::heuristic_of_four_masked(blocks.as_ptr().cast(), masks.as_ptr().cast(), fused)
        },
        // SAFETY: there are eight views, and as many blocks and masks as fused costs, not 0.
        Rule::Half if fits && V == 8 => unsafe {
            fuse::half_of_eight_masked(blocks.as_ptr().cast(), masks.as_ptr().cast(), fused)
        },
        _ => return fuse_masked_loop(dsp, rule, blocks, masks, fused),
    };
    lesser_half(least)
}

/// [`Blocks::least`]. Generic, so that only a processor that uses it compiles it: this module is built for
/// all of Arm's.
#[inline(never)]
fn least<const LANES: usize>(costs: &[Costs]) -> u16 {
    // As many vectors as the usual 32 disparities take, without a loop.
    if let Ok(four) = <&[Costs; 4]>::try_from(costs) {
        let [a, b, c, d] = four.map(U16x8);
        return a.min(b).min(c.min(d)).least();
    }
    let mut least = U16x8([u32::MAX; 4]);
    for &costs in costs {
        least = least.min(U16x8(costs));
    }
    least.least()
}

impl Blocks<u32> for Dsp {
    const MOST_MASKED_OF_SUM: u32 = 1;
    type Costs = WideCosts;
    type Block = U32x8;

    #[inline(always)]
    fn load_block(self, costs: &WideCosts) -> U32x8 {
        U32x8(*costs)
    }

    #[inline(always)]
    fn splat(self, cost: u32) -> U32x8 {
        U32x8([cost; 8])
    }

    #[inline(always)]
    fn position(self, costs: &[WideCosts], cost: u32) -> usize {
        wide::position(costs, cost)
    }

    #[inline(always)]
    fn prime<const V: usize>(self, steps: &mut Steps<'_, Self, V>) {
        prime(steps);
    }

    #[inline(always)]
    fn slide<const V: usize>(self, steps: &mut Steps<'_, Self, V>, blocks: &mut [[WideCosts; V]]) {
        // At every step, also where costs are not fused in lanes afterwards.
        let growth = steps.most_growth();
        let bound = steps.sums_bound();
        *bound = bound.saturating_add(growth);
        slide_blocks(steps, blocks);
    }

    #[inline(always)]
    fn fuse<const V: usize>(self, rule: Rule, blocks: &[[WideCosts; V]], fused: &mut [WideCosts]) -> u32 {
        fuse_wide(self, rule, 0, wide::can_pack(blocks), blocks, blocks, fused)
    }

    #[inline(always)]
    fn fuse_masked<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        blocks: &[[WideCosts; V]],
        masks: &[[WideCosts; V]],
        fused: &mut [WideCosts],
    ) -> u32 {
        fuse_wide(self, rule, masked, wide::can_pack(blocks), blocks, masks, fused)
    }

    #[inline(always)]
    fn slide_and_fuse<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        steps: &mut Steps<'_, Self, V>,
        blocks: &mut [[WideCosts; V]],
        masks: &[[WideCosts; V]],
        fused: &mut [WideCosts],
    ) -> u32 {
        Blocks::<u32>::slide(self, steps, blocks);
        let can_pack = rule != Rule::Sum && wide::can_still_pack(steps, blocks);
        fuse_wide(self, rule, masked, can_pack, blocks, masks, fused)
    }
}

/// [`Blocks::fuse_masked`] for sums of 32 bits, all of which can be packed if `can_pack` is set.
#[inline(never)]
fn fuse_wide<const V: usize>(
    dsp: Dsp,
    rule: Rule,
    masked: u8,
    can_pack: bool,
    blocks: &[[WideCosts; V]],
    masks: &[[WideCosts; V]],
    fused: &mut [WideCosts],
) -> u32 {
    let has_loop = match rule {
        Rule::Min => can_pack,
        Rule::Heuristic => can_pack && V == 4 && masked.count_ones() <= 2,
        Rule::Sum => matches!(V, 2..=4) && masked.count_ones() <= 1,
        Rule::Half => false,
    };
    if !has_loop || blocks.len() != fused.len() || masks.len() != fused.len() || fused.is_empty() {
        return match masked {
            0 => fuse_loop(dsp, rule, blocks, fused),
            _ => fuse_masked_loop(dsp, rule, blocks, masks, fused),
        };
    }
    let (blocks, masks) = (blocks.as_ptr(), masks.as_ptr());
    // SAFETY: there are as many blocks and masks as fused costs, not 0. Sums can be packed where they have to be. The heuristic
    // rule has a loop for four views, and there are four; sums have one for two to four, at most one of which is masked.
    unsafe {
        match (rule, masked) {
            (Rule::Sum, 0) => wide::sum::<V, false>(0, blocks, masks, fused),
            (Rule::Sum, _) => wide::sum::<V, true>(masked.trailing_zeros() as usize % V, blocks, masks, fused),
            (Rule::Heuristic, 0) => wide::heuristic_of_four::<false>(blocks.cast(), masks.cast(), fused),
            (Rule::Heuristic, _) => wide::heuristic_of_four::<true>(blocks.cast(), masks.cast(), fused),
            (_, 0) => wide::min::<V, false>(blocks, masks, fused),
            _ => wide::min::<V, true>(blocks, masks, fused),
        }
    }
}
