//! The loops in the vector instructions of Arm's MVE (Helium), as Cortex-M55 and M85 have them.
//!
//! Rust has no types for these vectors, so whole loops are written with them; single operations are the portable ones.
//!
//! An instruction is only assembled for a processor that has it. What goes through the vector predicate puts it back, since the
//! compiler is not told of it.
#![allow(unsafe_code, clippy::undocumented_unsafe_blocks)]

use core::arch::asm;

use super::{Blocks, Change, Isa, Portable, Rule, Steps, fuse_generic, fuse_masked_generic, steps::Place};

/// MVE: eight lanes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mve;

/// Operation by operation, the same.
const TWIN: Portable<8> = Portable;

/// Bytes of a vector of 16-bit lanes.
const VECTOR: usize = size_of::<[u16; 8]>();

impl Isa for Mve {
    const LANES: usize = 8;
    const BATCH: usize = 1;
    type Samples = [u8; 8];
    type Sums = [u16; 8];
    type Column = [u16; 8];

    #[inline(always)]
    fn load_column(self, sums: &[u16; 8]) -> [u16; 8] {
        *sums
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8; 8]) -> [u16; 8] {
        TWIN.differences(center, view)
    }

    #[inline(always)]
    fn advance(self, sums: [u16; 8], center: Change<u8>, view: Change<&[u8; 8]>) -> [u16; 8] {
        TWIN.advance(sums, center, view)
    }

    #[inline(never)]
    fn prime<const V: usize>(self, steps: &mut Steps<'_, Self, V>) {
        let vectors = steps.vectors();
        if let Some(place) = steps.enter().filter(|_| vectors > 0) {
            unsafe { prime(place, vectors) }
        }
    }
}

impl Blocks<u16> for Mve {
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
        if costs.is_empty() {
            return 0;
        }
        let (equal, left): (u32, usize);
        unsafe {
            asm!(
                "vmrs {before}, p0",
                "2:",
                "vldrh.u16 q0, [{costs}], #16",
                "vcmp.i16 eq, q0, {cost}",
                "vmrs {equal}, p0",
                "cmp {equal}, #0",
                "bne 3f",
                "subs {left}, {left}, #1",
                "bne 2b",
                "3:",
                "vmsr p0, {before}",
                costs = inout(reg) costs.as_ptr() => _,
                left = inout(reg) costs.len() => left,
                cost = in(reg) u32::from(cost),
                before = out(reg) _,
                equal = out(reg) equal,
                out("q0") _,
                options(readonly, nostack),
            );
        }
        // Two bits for each lane, and none without the cost.
        8 * (costs.len() - left) + equal.trailing_zeros() as usize / 2
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
        let four = (blocks.len() == 4) & (masks.len() == 4) & (fused.len() == 4) & (steps.vectors() == 4);
        if V == 4 && rule == Rule::Min && four {
            let Some(place) = steps.enter() else { return u16::MAX };
            return unsafe {
                match masked {
                    0 => slide_to_least::<V, 0>(place, blocks, masks, fused),
                    1 => slide_to_least::<V, 1>(place, blocks, masks, fused),
                    2 => slide_to_least::<V, 2>(place, blocks, masks, fused),
                    4 => slide_to_least::<V, 4>(place, blocks, masks, fused),
                    8 => slide_to_least::<V, 8>(place, blocks, masks, fused),
                    _ => slide_to_least::<V, 15>(place, blocks, masks, fused),
                }
            };
        }
        slide_along(steps, blocks);
        self.fuse_by_masks(rule, masked, blocks, masks, fused)
    }

    #[inline(always)]
    fn fuse<const V: usize>(self, rule: Rule, blocks: &[[[u16; 8]; V]], fused: &mut [[u16; 8]]) -> u16 {
        if blocks.len() != fused.len() || fused.is_empty() {
            return u16::MAX;
        }
        let first = blocks.as_ptr();
        match (rule, V) {
            (Rule::Min, _) => unsafe { least_of::<V, 0>(first, first, fused) },
            (Rule::Heuristic, 3 | 4) => unsafe { heuristic_of::<V, 0>(first, first, fused) },
            _ => fuse_generic(self, rule, blocks, fused),
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
        if blocks.len() != fused.len() || masks.len() != fused.len() || fused.is_empty() {
            return u16::MAX;
        }
        let (first, mask) = (blocks.as_ptr(), masks.as_ptr());
        match (rule, V, masked) {
            (Rule::Min, _, 1) => unsafe { least_of::<V, 1>(first, mask, fused) },
            (Rule::Min, _, 2) => unsafe { least_of::<V, 2>(first, mask, fused) },
            (Rule::Min, _, 4) => unsafe { least_of::<V, 4>(first, mask, fused) },
            (Rule::Min, _, 8) => unsafe { least_of::<V, 8>(first, mask, fused) },
            (Rule::Min, ..) => unsafe { least_of::<V, 15>(first, mask, fused) },
            (Rule::Heuristic, 3 | 4, 1) => unsafe { heuristic_of::<V, 1>(first, mask, fused) },
            (Rule::Heuristic, 3 | 4, 2) => unsafe { heuristic_of::<V, 2>(first, mask, fused) },
            (Rule::Heuristic, 3 | 4, 4) => unsafe { heuristic_of::<V, 4>(first, mask, fused) },
            (Rule::Heuristic, 3 | 4, 8) => unsafe { heuristic_of::<V, 8>(first, mask, fused) },
            (Rule::Heuristic, 3 | 4, _) => unsafe { heuristic_of::<V, 15>(first, mask, fused) },
            _ => fuse_masked_generic(self, rule, blocks, masks, fused),
        }
    }

    #[inline(always)]
    fn least(self, costs: &[[u16; 8]]) -> u16 {
        let mut least = u32::from(u16::MAX);
        for costs in costs {
            unsafe {
                asm!("vldrh.u16 q0, [{costs}]", "vminv.u16 {least}, q0", costs = in(reg) costs, least = inout(reg) least,
                     out("q0") _, options(pure, readonly, nostack, preserves_flags));
            }
        }
        least as u16
    }
}

impl Blocks<u32> for Mve {
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
        TWIN.position(costs, cost)
    }
}

/// Where the next view's samples are that enter and that leave, into r2 and r3.
macro_rules! track {
    () => {
        "ldm {tracks}!, {{r2, r3, r4}}
        mla r2, r4, {index}, r2
        mla r3, r4, {index}, r3"
    };
}

/// Moves vector `j` of view `k` down in a column. By what that is more than in the column that is left is then in q0, and that vector of the
/// block in q1.
macro_rules! column_on {
    () => {
        "vldrb.u16 q0, [r2, #(8 * \\j)]
        vldrb.u16 q1, [r3, #(8 * \\j)]
        vabd.u16 q0, q0, q2
        vabd.u16 q1, q1, q3
        vsub.i16 q0, q0, q1
        vldrh.u16 q1, [{column}, #(16 * ({vectors} * \\k + \\j))]
        vadd.i16 q0, q0, q1
        vstrh.16 q0, [{column}, #(16 * ({vectors} * \\k + \\j))]
        vldrh.u16 q1, [{left}, #(16 * ({vectors} * \\k + \\j))]
        vsub.i16 q0, q0, q1
        vldrh.u16 q1, [{block}, #(16 * ({views} * \\j + \\k))]"
    };
}

/// Moves the next column down, and the blocks on by it.
#[inline(always)]
fn slide_along<const V: usize>(steps: &mut Steps<'_, Mve, V>, blocks: &mut [[[u16; 8]; V]]) {
    if steps.vectors() != blocks.len() || blocks.is_empty() {
        return;
    }
    let Some(place) = steps.enter() else { return };
    unsafe {
        match blocks.len() {
            2 => slide_unrolled::<V, 2>(place, blocks),
            4 => slide_unrolled::<V, 4>(place, blocks),
            _ => slide(place, blocks),
        }
    }
}

/// Adds what enters to a column.
///
/// # Safety
/// The place has so many vectors in a view, not 0.
#[inline(always)]
unsafe fn prime<const V: usize>(place: Place<'_, Mve, V>, vectors: usize) {
    let Place { center, index, tracks, column, .. } = place;
    unsafe {
        asm!(
            "vdup.16 q1, r2",
            "2:",
            "ldm {tracks}!, {{r2, r3, r4}}",
            "mla r2, r4, {index}, r2",
            "dls lr, {n}",
            "3:",
            "vldrb.u16 q0, [r2], #8",
            "vabd.u16 q0, q0, q1",
            "vldrh.u16 q2, [{column}]",
            "vadd.i16 q0, q0, q2",
            "vstrh.16 q0, [{column}], #16",
            "le lr, 3b",
            "cmp {tracks}, {end}",
            "bne 2b",
            n = in(reg) vectors,
            tracks = inout(reg) tracks => _,
            end = in(reg) tracks.wrapping_add(V),
            column = inout(reg) column => _,
            index = in(reg) index,
            inout("r2") u32::from(center.entering) => _,
            out("r3") _, out("r4") _, out("lr") _, out("q0") _, out("q1") _, out("q2") _,
            options(nostack),
        );
    }
}

/// Moves a column down, and the blocks on by it: of `N` vectors in a view, at most 16 in all, so that each has a place of its own in the
/// code.
///
/// # Safety
/// The place has as many vectors in a view as there are blocks: `N`.
#[inline(always)]
unsafe fn slide_unrolled<const V: usize, const N: usize>(place: Place<'_, Mve, V>, blocks: &mut [[[u16; 8]; V]]) {
    let Place { center, index, tracks, column, left, .. } = place;
    unsafe {
        asm!(
            at_most!(1200),
            "vdup.16 q2, r2",
            "vdup.16 q3, r3",
            ".irp k, 0, 1, 2, 3",
            ".if \\k < {views}",
            track!(),
            ".irp j, 0, 1, 2, 3, 4, 5, 6, 7",
            ".if \\j < {vectors}",
            column_on!(),
            "vadd.i16 q0, q0, q1",
            "vstrh.16 q0, [{block}, #(16 * ({views} * \\j + \\k))]",
            ".endif",
            ".endr",
            ".endif",
            ".endr",
            index = in(reg) index,
            tracks = inout(reg) tracks => _,
            column = in(reg) column,
            left = in(reg) left,
            block = in(reg) blocks.as_mut_ptr(),
            // Loads that widen take their addresses from low registers.
            inout("r2") u32::from(center.entering) => _,
            inout("r3") u32::from(center.leaving) => _,
            out("r4") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _,
            views = const V,
            vectors = const N,
            options(nostack),
        );
    }
}

/// Sets all bits of a vector of costs that are masked: of vector `j` of view `k`.
macro_rules! mask_view {
    ($costs:literal) => {
        concat!(
            ".if ({masked} >> \\k) & 1\n",
            "vldrh.u16 q1, [{mask}, #(16 * ({views} * \\j + \\k))]\n",
            "vorr ",
            $costs,
            ", ",
            $costs,
            ", q1\n.endif"
        )
    };
}

/// Moves a column down, and the blocks on by it, and fuses their costs to the least, less those that masks hide in the views whose bits are set in
/// `MASKED`. Returns the least of all.
///
/// # Safety
/// The place has four vectors in a view, and there are four blocks, masks and fused costs.
#[inline(always)]
unsafe fn slide_to_least<const V: usize, const MASKED: u8>(
    place: Place<'_, Mve, V>,
    blocks: &mut [[[u16; 8]; V]],
    masks: &[[[u16; 8]; V]],
    fused: &mut [[u16; 8]],
) -> u16 {
    let Place { center, index, tracks, column, left, .. } = place;
    let mut least = u32::from(u16::MAX);
    unsafe {
        asm!(
            at_most!(1200),
            "vdup.16 q2, r2",
            "vdup.16 q3, r3",
            ".irp k, 0, 1, 2, 3",
            ".if \\k < {views}",
            track!(),
            // The fused costs are in q4 to q7.
            ".irp j, 0, 1, 2, 3",
            column_on!(),
            ".irp to, 4, 5, 6, 7",
            ".if \\to == \\j + 4",
            ".if \\k",
            "vadd.i16 q0, q0, q1",
            "vstrh.16 q0, [{block}, #(16 * ({views} * \\j + \\k))]",
            mask_view!("q0"),
            "vmin.u16 q\\to, q\\to, q0",
            ".else",
            "vadd.i16 q\\to, q0, q1",
            "vstrh.16 q\\to, [{block}, #(16 * ({views} * \\j + \\k))]",
            mask_view!("q\\to"),
            ".endif",
            ".endif",
            ".endr",
            ".endr",
            ".endif",
            ".endr",
            ".irp from, 4, 5, 6, 7",
            "vstrh.16 q\\from, [{fused}, #(16 * (\\from - 4))]",
            "vminv.u16 {least}, q\\from",
            ".endr",
            index = in(reg) index,
            tracks = inout(reg) tracks => _,
            column = in(reg) column,
            left = in(reg) left,
            block = in(reg) blocks.as_mut_ptr(),
            mask = in(reg) masks.as_ptr(),
            fused = in(reg) fused.as_mut_ptr(),
            least = inout(reg) least,
            // Loads that widen take their addresses from low registers.
            inout("r2") u32::from(center.entering) => _,
            inout("r3") u32::from(center.leaving) => _,
            out("r4") _,
            out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _, out("q6") _, out("q7") _,
            views = const V,
            vectors = const 4,
            masked = const MASKED,
            options(nostack),
        );
    }
    least as u16
}

/// Moves a column down, and the blocks on by it.
///
/// # Safety
/// The place has as many vectors in a view as there are blocks, at least one.
#[inline(always)]
unsafe fn slide<const V: usize>(place: Place<'_, Mve, V>, blocks: &mut [[[u16; 8]; V]]) {
    let Place { center, index, tracks, column, left, .. } = place;
    unsafe {
        asm!(
            "vdup.16 q2, r2",
            "vdup.16 q3, r3",
            "2:",
            track!(),
            "dls lr, {n}",
            "3:",
            "vldrb.u16 q0, [r2], #8",
            "vldrb.u16 q1, [r3], #8",
            "vabd.u16 q0, q0, q2",
            "vabd.u16 q1, q1, q3",
            "vsub.i16 q0, q0, q1",
            "vldrh.u16 q1, [{column}]",
            "vadd.i16 q0, q0, q1",
            "vstrh.16 q0, [{column}], #16",
            "vldrh.u16 q1, [{left}], #16",
            "vsub.i16 q0, q0, q1",
            "vldrh.u16 q1, [{block}]",
            "vadd.i16 q0, q0, q1",
            "vstrh.16 q0, [{block}], #{stride}",
            "le lr, 3b",
            "sub {block}, {block}, {back}",
            "cmp {tracks}, {end}",
            "bne 2b",
            n = in(reg) blocks.len(),
            index = in(reg) index,
            tracks = inout(reg) tracks => _,
            end = in(reg) tracks.wrapping_add(V),
            column = inout(reg) column => _,
            left = inout(reg) left => _,
            block = inout(reg) blocks.as_mut_ptr() => _,
            back = in(reg) (blocks.len() * V - 1) * VECTOR,
            // Loads that widen take their addresses from low registers.
            inout("r2") u32::from(center.entering) => _,
            inout("r3") u32::from(center.leaving) => _,
            out("r4") _, out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _,
            stride = const VECTOR * V,
            options(nostack),
        );
    }
}

/// Loads the costs of the views, from the first on, into vectors from `q0` on; those that are masked with all bits set.
macro_rules! load_views {
    () => {
        "
        .irp q, 0, 1, 2, 3
        .if \\q < {views}
        vldrh.u16 q\\q, [{block}], #16
        .if ({masked} >> \\q) & 1
        vldrh.u16 q5, [{mask}, #16 * \\q]
        vorr q\\q, q\\q, q5
        .endif
        .endif
        .endr
        .if {masked}
        add {mask}, {mask}, #{stride}
        .endif
        "
    };
}

/// Fuses the costs of `V` views to the least, less those that masks hide in the views whose bits are set in `MASKED`, and returns the least of all.
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0.
#[inline(always)]
unsafe fn least_of<const V: usize, const MASKED: u8>(
    blocks: *const [[u16; 8]; V],
    masks: *const [[u16; 8]; V],
    fused: &mut [[u16; 8]],
) -> u16 {
    let mut least = u32::from(u16::MAX);
    unsafe {
        asm!(
            at_most!(64),
            "dls lr, {n}",
            "2:",
            load_views!(),
            ".irp q, 1, 2, 3",
            ".if \\q < {views}",
            "vmin.u16 q0, q0, q\\q",
            ".endif",
            ".endr",
            "vstrh.16 q0, [{fused}], #16",
            "vminv.u16 {least}, q0",
            "le lr, 2b",
            n = in(reg) fused.len(),
            block = inout(reg) blocks => _,
            mask = inout(reg) masks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q5") _,
            views = const V,
            masked = const MASKED,
            stride = const V * VECTOR,
            options(nostack, preserves_flags),
        );
    }
    least as u16
}

/// Fuses the costs of `V` views, three or four, by the heuristic rule, less those that masks hide in the views whose bits are set in `MASKED`, and returns the
/// least of all.
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0.
#[inline(always)]
unsafe fn heuristic_of<const V: usize, const MASKED: u8>(
    blocks: *const [[u16; 8]; V],
    masks: *const [[u16; 8]; V],
    fused: &mut [[u16; 8]],
) -> u16 {
    let mut least = u32::from(u16::MAX);
    unsafe {
        asm!(
            at_most!(64),
            "vmrs {before}, p0",
            "dls lr, {n}",
            "2:",
            // In place of a fourth view that is not there, the greatest cost.
            "vmov.i8 q3, #255",
            load_views!(),
            "vmin.u16 q4, q0, q1",
            "vmax.u16 q0, q0, q1",
            "vmin.u16 q1, q2, q3",
            "vmax.u16 q2, q2, q3",
            // Second and third are the greater of the lower ones and the lesser of the upper ones.
            "vmax.u16 q3, q4, q1",
            "vmin.u16 q4, q4, q1",
            "vmin.u16 q0, q0, q2",
            "vmin.u16 q1, q3, q0",
            "vmax.u16 q3, q3, q0",
            // The sums of two and of three, and three times the second.
            "vqadd.u16 q4, q4, q1",
            "vqadd.u16 q0, q4, q3",
            "vqadd.u16 q2, q1, q1",
            "vqadd.u16 q2, q2, q1",
            "vqadd.u16 q1, q4, q4",
            "vqadd.u16 q4, q4, q1",
            "vqadd.u16 q0, q0, q0",
            "vcmp.u16 hi, q3, q2",
            "vpsel q0, q4, q0",
            "vstrh.16 q0, [{fused}], #16",
            "vminv.u16 {least}, q0",
            "le lr, 2b",
            "vmsr p0, {before}",
            n = in(reg) fused.len(),
            block = inout(reg) blocks => _,
            mask = inout(reg) masks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            before = out(reg) _,
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _,
            views = const V,
            masked = const MASKED,
            stride = const V * VECTOR,
            options(nostack, preserves_flags),
        );
    }
    least as u16
}
