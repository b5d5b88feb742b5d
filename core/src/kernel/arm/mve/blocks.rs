//! The inner loops in MVE.
#![allow(unsafe_code)]

use core::arch::asm;

use super::{Mve, VECTOR, fuse, slide};
use crate::kernel::{
    blocks::{Blocks, fuse_loop, fuse_masked_loop},
    isa::Lane,
    rule::Rule,
    steps::Steps,
};

#[inline(never)]
fn prime<const V: usize>(steps: &mut Steps<'_, Mve, V>) {
    let vectors = steps.vectors();
    if let Some(step) = steps.next_raw().filter(|_| vectors > 0) {
        // SAFETY: the step has so many vectors in a view, and they are not 0.
        unsafe { slide::prime(step, vectors) }
    }
}

/// [`Blocks::slide`].
#[inline(always)]
fn slide_along<const V: usize>(steps: &mut Steps<'_, Mve, V>, blocks: &mut [[[u16; 8]; V]]) {
    if steps.vectors() != blocks.len() || blocks.is_empty() {
        return;
    }
    let Some(step) = steps.next_raw() else { return };
    // SAFETY: the step has as many vectors in a view as there are blocks, not 0.
    unsafe {
        match blocks.len() {
            1 => slide::slide_unrolled::<V, 1>(step, blocks),
            2 => slide::slide_unrolled::<V, 2>(step, blocks),
            4 if const { V <= 4 } => slide::slide_unrolled::<V, 4>(step, blocks),
            _ => slide::slide::<u16, V>(step, blocks),
        }
    }
}

/// [`Blocks::position`].
#[inline(always)]
fn position<L: Lane>(costs: &[[L; 8]], cost: L) -> usize {
    if costs.is_empty() {
        return 0;
    }
    let vectors = size_of_val(costs) / VECTOR;
    let (equal, vectors_left): (u32, usize);
    // SAFETY: reads one vector after the other, at least one, at most all. Every register that changes is
    // an output; the predicate, of which the compiler is not told, is restored.
    unsafe {
        asm!(
            "vmrs {before}, p0",
            "2:",
            ".if {bits} == 16",
            "vldrh.u16 q0, [{costs}], #16",
            ".else",
            "vldrw.u32 q0, [{costs}], #16",
            ".endif",
            "vcmp.i{bits} eq, q0, {cost}",
            "vmrs {equal}, p0",
            "cmp {equal}, #0",
            "bne 3f",
            "subs {vectors_left}, {vectors_left}, #1",
            "bne 2b",
            "3:",
            "vmsr p0, {before}",
            costs = inout(reg) costs.as_ptr() => _,
            vectors_left = inout(reg) vectors => vectors_left,
            cost = in(reg) cost.widen(),
            before = out(reg) _,
            equal = out(reg) equal,
            out("q0") _,
            bits = const 8 * size_of::<L>(),
            options(readonly, nostack),
        );
    }
    // A bit for each byte of a lane; none if no lane has the cost.
    (VECTOR * (vectors - vectors_left) + equal.trailing_zeros() as usize) / size_of::<L>()
}

/// [`Blocks::least`].
#[inline(always)]
fn least<L: Lane>(costs: &[[L; 8]]) -> L {
    let mut least = L::MAX.widen();
    for costs in costs {
        // SAFETY: reads eight lanes. Every register that changes is an output.
        unsafe {
            asm!(
                ".if {bits} == 16",
                "vldrh.u16 q0, [{costs}]",
                ".else",
                "vldrw.u32 q0, [{costs}], #16",
                "vminv.u32 {least}, q0",
                "vldrw.u32 q0, [{costs}]",
                ".endif",
                "vminv.u{bits} {least}, q0",
                costs = inout(reg) costs.as_ptr() => _,
                least = inout(reg) least,
                out("q0") _,
                bits = const 8 * size_of::<L>(),
                options(pure, readonly, nostack, preserves_flags),
            );
        }
    }
    L::from_index(least as usize)
}

/// The sum of costs, some of which may be masked.
///
/// A function of its own: the loops for the other rules then need fewer registers.
#[inline(never)]
fn fuse_sum<L: Lane, const V: usize>(masked: u8, blocks: &[[[L; 8]; V]], masks: &[[[L; 8]; V]], fused: &mut [[L; 8]]) -> L {
    if blocks.len() != fused.len() || masks.len() != fused.len() || fused.is_empty() {
        return L::MAX;
    }
    let (block, mask) = (blocks.as_ptr(), masks.as_ptr());
    // SAFETY: there are as many blocks and masks as fused costs, not 0.
    unsafe { by_mask!(masked, fuse::sum::<L, V>(block, mask, fused)) }
}

impl Blocks<u16> for Mve {
    const MASKS_SUM: bool = true;
    type Costs = [u16; 8];
    type Block = [u16; 8];

    #[inline(always)]
    fn load_block(self, costs: &[u16; 8]) -> [u16; 8] {
        *costs
    }

    #[inline(always)]
    fn splat(self, cost: u16) -> [u16; 8] {
        [cost; 8]
    }

    #[inline(always)]
    fn position(self, costs: &[[u16; 8]], cost: u16) -> usize {
        position(costs, cost)
    }

    #[inline(always)]
    fn prime<const V: usize>(self, steps: &mut Steps<'_, Self, V>) {
        prime(steps);
    }

    #[inline(never)]
    fn slide<const V: usize>(self, steps: &mut Steps<'_, Self, V>, blocks: &mut [[[u16; 8]; V]]) {
        slide_along(steps, blocks);
    }

    #[inline(always)]
    fn slide_and_fuse<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        steps: &mut Steps<'_, Self, V>,
        blocks: &mut [[[u16; 8]; V]],
        masks: &[[[u16; 8]; V]],
        fused: &mut [[u16; 8]],
    ) -> u16 {
        if const { V == 4 } && slide::suits(rule, steps, blocks, masks) && fused.len() == 4 {
            let Some(step) = steps.next_raw() else { return u16::MAX };
            // SAFETY: there are four views, and four vectors of each.
            return unsafe { by_mask!(masked, slide::slide_to_min::<V>(step, blocks, masks, fused)) };
        }
        slide_along(steps, blocks);
        self.fuse_masked(rule, masked, blocks, masks, fused)
    }

    #[inline(always)]
    fn fuse<const V: usize>(self, rule: Rule, blocks: &[[[u16; 8]; V]], fused: &mut [[u16; 8]]) -> u16 {
        if blocks.len() != fused.len() || fused.is_empty() {
            return u16::MAX;
        }
        let first = blocks.as_ptr();
        // SAFETY: there are as many blocks as fused costs, not 0, of eight views in the loops for eight. Nothing is masked.
        unsafe {
            match (rule, V) {
                (Rule::Min, ..=4) => fuse::min::<u16, V, 0>(first, first, fused),
                (Rule::Heuristic, 3 | 4) => fuse::heuristic::<u16, V, 0>(first, first, fused),
                (Rule::Sum, 2..=4) => fuse_sum(0, blocks, blocks, fused),
                (Rule::Min, 8) => fuse::min_of_eight::<false>(first.cast(), first.cast(), fused),
                (Rule::Half, 8) => fuse::half_of_eight(first.cast(), fused),
                _ => fuse_loop(self, rule, blocks, fused),
            }
        }
    }

    #[inline(always)]
    fn fuse_masked<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        blocks: &[[[u16; 8]; V]],
        masks: &[[[u16; 8]; V]],
        fused: &mut [[u16; 8]],
    ) -> u16 {
        if masked == 0 {
            return self.fuse(rule, blocks, fused);
        }
        if blocks.len() != fused.len() || masks.len() != fused.len() || fused.is_empty() {
            return u16::MAX;
        }
        let (first, mask) = (blocks.as_ptr(), masks.as_ptr());
        // SAFETY: there are as many blocks and masks as fused costs, not 0, of eight views in the loops for eight.
        unsafe {
            match (rule, V, masked) {
                (Rule::Min, ..=4, 1) => fuse::min::<u16, V, 1>(first, mask, fused),
                (Rule::Min, ..=4, 2) => fuse::min::<u16, V, 2>(first, mask, fused),
                (Rule::Min, ..=4, 4) => fuse::min::<u16, V, 4>(first, mask, fused),
                (Rule::Min, ..=4, 8) => fuse::min::<u16, V, 8>(first, mask, fused),
                (Rule::Min, ..=4, _) => fuse::min::<u16, V, 15>(first, mask, fused),
                (Rule::Heuristic, 3 | 4, 1) => fuse::heuristic::<u16, V, 1>(first, mask, fused),
                (Rule::Heuristic, 3 | 4, 2) => fuse::heuristic::<u16, V, 2>(first, mask, fused),
                (Rule::Heuristic, 3 | 4, 4) => fuse::heuristic::<u16, V, 4>(first, mask, fused),
                (Rule::Heuristic, 3 | 4, 8) => fuse::heuristic::<u16, V, 8>(first, mask, fused),
                (Rule::Heuristic, 3 | 4, _) => fuse::heuristic::<u16, V, 15>(first, mask, fused),
                (Rule::Sum, 2..=4, _) => fuse_sum(masked, blocks, masks, fused),
                (Rule::Min, 8, _) => fuse::min_of_eight::<true>(first.cast(), mask.cast(), fused),
                (Rule::Half, 8, _) => fuse::half_of_eight_masked(first.cast(), mask.cast(), fused),
                _ => fuse_masked_loop(self, rule, blocks, masks, fused),
            }
        }
    }

    #[inline(always)]
    fn least(self, costs: &[[u16; 8]]) -> u16 {
        least(costs)
    }
}

impl Blocks<u32> for Mve {
    const MASKS_SUM: bool = true;
    type Costs = [u32; 8];
    type Block = [u32; 8];

    #[inline(always)]
    fn load_block(self, costs: &[u32; 8]) -> [u32; 8] {
        *costs
    }

    #[inline(always)]
    fn splat(self, cost: u32) -> [u32; 8] {
        [cost; 8]
    }

    #[inline(always)]
    fn position(self, costs: &[[u32; 8]], cost: u32) -> usize {
        position(costs, cost)
    }

    #[inline(always)]
    fn prime<const V: usize>(self, steps: &mut Steps<'_, Self, V>) {
        prime(steps);
    }

    #[inline(never)]
    fn slide<const V: usize>(self, steps: &mut Steps<'_, Self, V>, blocks: &mut [[[u32; 8]; V]]) {
        if steps.vectors() != blocks.len() || blocks.is_empty() {
            return;
        }
        let Some(step) = steps.next_raw() else { return };
        // SAFETY: the step has as many vectors in a view as there are blocks, not 0.
        unsafe { slide::slide(step, blocks) }
    }

    #[inline(always)]
    fn fuse<const V: usize>(self, rule: Rule, blocks: &[[[u32; 8]; V]], fused: &mut [[u32; 8]]) -> u32 {
        if blocks.len() != fused.len() || fused.is_empty() {
            return u32::MAX;
        }
        let first = blocks.as_ptr();
        // SAFETY: there are as many blocks as fused costs, not 0. Nothing is masked.
        unsafe {
            match (rule, V) {
                (Rule::Min, ..=4) => fuse::min::<u32, V, 0>(first, first, fused),
                (Rule::Heuristic, 3 | 4) => fuse::heuristic::<u32, V, 0>(first, first, fused),
                (Rule::Sum, 2..=4) => fuse_sum(0, blocks, blocks, fused),
                _ => fuse_loop(self, rule, blocks, fused),
            }
        }
    }

    #[inline(always)]
    fn fuse_masked<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        blocks: &[[[u32; 8]; V]],
        masks: &[[[u32; 8]; V]],
        fused: &mut [[u32; 8]],
    ) -> u32 {
        if masked == 0 {
            return self.fuse(rule, blocks, fused);
        }
        if blocks.len() != fused.len() || masks.len() != fused.len() || fused.is_empty() {
            return u32::MAX;
        }
        let (first, mask) = (blocks.as_ptr(), masks.as_ptr());
        // SAFETY: there are as many blocks and masks as fused costs, not 0.
        unsafe {
            match (rule, V) {
                (Rule::Min, ..=4) => fuse::min::<u32, V, 15>(first, mask, fused),
                (Rule::Heuristic, 3 | 4) => fuse::heuristic::<u32, V, 15>(first, mask, fused),
                (Rule::Sum, 2..=4) => fuse_sum(masked, blocks, masks, fused),
                _ => fuse_masked_loop(self, rule, blocks, masks, fused),
            }
        }
    }

    #[inline(always)]
    fn least(self, costs: &[[u32; 8]]) -> u32 {
        least(costs)
    }
}
