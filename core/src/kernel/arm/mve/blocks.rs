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
fn slide_along<L: Lane, const V: usize>(steps: &mut Steps<'_, Mve, V>, blocks: &mut [[[L; 8]; V]]) {
    if steps.vectors() != blocks.len() || blocks.is_empty() {
        return;
    }
    let Some(step) = steps.next_raw() else { return };
    // SAFETY: the step has as many vectors in a view as there are blocks, not 0.
    unsafe {
        match blocks.len() {
            1 => slide::slide_unrolled::<L, V, 1>(step, blocks),
            2 => slide::slide_unrolled::<L, V, 2>(step, blocks),
            4 if const { V <= 4 } => slide::slide_unrolled::<L, V, 4>(step, blocks),
            _ => slide::slide::<L, V>(step, blocks),
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
    let lanes_left: usize;
    // SAFETY: reads one vector after the other, at least one, at most all. Every register that changes is
    // an output; the predicate, of which the compiler is not told, is restored.
    unsafe {
        asm!(
            "vmrs {before}, p0",
            "dls lr, {vectors}",
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
            "le lr, 2b",
            "3:",
            "vmsr p0, {before}",
            // A bit for each byte of a lane, and the vectors from this one on.
            "rbit {equal}, {equal}",
            "clz {equal}, {equal}",
            "lsr {equal}, {equal}, #({bits} / 16)",
            "rsb {equal}, {equal}, lr, lsl #(4 - {bits} / 16)",
            costs = inout(reg) costs.as_ptr() => _,
            vectors = in(reg) vectors,
            cost = in(reg) cost.widen(),
            before = out(reg) _,
            equal = out(reg) lanes_left,
            out("lr") _,
            out("q0") _,
            bits = const 8 * size_of::<L>(),
            options(readonly, nostack),
        );
    }
    size_of_val(costs) / size_of::<L>() - lanes_left
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

/// [`Blocks::fuse_masked`] of up to four views, if there is a loop for the rule.
#[inline(always)]
fn fuse_few<L: Lane, const V: usize>(
    rule: Rule,
    masked: u8,
    blocks: &[[[L; 8]; V]],
    masks: &[[[L; 8]; V]],
    fused: &mut [[L; 8]],
) -> Option<L> {
    if blocks.len() != fused.len() || masks.len() != fused.len() || fused.is_empty() {
        return Some(L::MAX);
    }
    let (block, mask) = (blocks.as_ptr(), masks.as_ptr());
    // SAFETY: there are as many blocks and masks as fused costs, not 0.
    unsafe {
        match (rule, V) {
            (Rule::Min, ..=4) => Some(by_mask!(masked, fuse::min::<L, V>(block, mask, fused))),
            (Rule::Heuristic, 3 | 4) => Some(by_mask!(masked, fuse::heuristic::<L, V>(block, mask, fused))),
            (Rule::Sum, 2..=4) => Some(fuse_sum(masked, blocks, masks, fused)),
            (Rule::Half, 3 | 4) if masked == 0 => Some(fuse::half::<L, V, 0>(block, mask, fused)),
            (Rule::Half, 3 | 4) => Some(fuse::half::<L, V, 15>(block, mask, fused)),
            _ => None,
        }
    }
}

impl Blocks<u16> for Mve {
    const MOST_MASKED_OF_SUM: u32 = 4;
    const FUSES_HALF: bool = true;
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
        if let Some(least) = fuse_few(rule, 0, blocks, blocks, fused) {
            return least;
        }
        let first = blocks.as_ptr().cast();
        // SAFETY: there are as many blocks as fused costs, not 0, of eight views. Nothing is masked.
        unsafe {
            match (rule, V) {
                (Rule::Min, 8) => fuse::min_of_eight::<false>(first, first, fused),
                (Rule::Half, 8) => fuse::half_of_eight(first, fused),
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
        if let Some(least) = fuse_few(rule, masked, blocks, masks, fused) {
            return least;
        }
        let (first, mask) = (blocks.as_ptr().cast(), masks.as_ptr().cast());
        // SAFETY: there are as many blocks and masks as fused costs, not 0, of eight views.
        unsafe {
            match (rule, V) {
                (Rule::Min, 8) => fuse::min_of_eight::<true>(first, mask, fused),
                (Rule::Half, 8) => fuse::half_of_eight_masked(first, mask, fused),
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
    const MOST_MASKED_OF_SUM: u32 = 4;
    const FUSES_HALF: bool = true;
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
        slide_along(steps, blocks);
    }

    #[inline(always)]
    fn fuse<const V: usize>(self, rule: Rule, blocks: &[[[u32; 8]; V]], fused: &mut [[u32; 8]]) -> u32 {
        fuse_few(rule, 0, blocks, blocks, fused).unwrap_or_else(|| fuse_loop(self, rule, blocks, fused))
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
        match masked {
            0 => self.fuse(rule, blocks, fused),
            _ => {
                fuse_few(rule, masked, blocks, masks, fused).unwrap_or_else(|| fuse_masked_loop(self, rule, blocks, masks, fused))
            }
        }
    }

    #[inline(always)]
    fn least(self, costs: &[[u32; 8]]) -> u32 {
        least(costs)
    }
}
