//! Fused costs of 32 bits in the DSP extension, with the least of all.
//!
//! The block sums of a block of 17 to 21 pixels take 17 bits, but only beside objects whose brightness differs by more than
//! 148 over a whole block do they need the last one. As long as none does, sums are packed in pairs, compared as those of
//! smaller blocks, and widened. A bound that grows with each [step](Steps) says so: only when it leaves 16 bits are all sums
//! looked at.
//!
//! In a packed pair the half `0xffff` is that of a hidden view, which no sum reaches.
#![allow(unsafe_code)]

use core::arch::asm;

use super::{Dsp, VECTOR};
use crate::kernel::steps::Steps;

/// A vector of 32-bit costs.
pub(super) type WideCosts = [u32; 8];

/// The greatest sum that can be packed.
const MOST_PACKED: u32 = 0xfffe;

/// True if the sums of a block can be packed.
pub(super) fn can_pack<const V: usize>(blocks: &[[WideCosts; V]]) -> bool {
    greatest(blocks) <= MOST_PACKED
}

/// [`can_pack`] after a step, without looking at the sums as long as they cannot have grown so far.
pub(super) fn can_still_pack<const V: usize>(steps: &mut Steps<'_, Dsp, V>, blocks: &[[WideCosts; V]]) -> bool {
    let bound = steps.sums_bound();
    if *bound > MOST_PACKED {
        *bound = greatest(blocks);
    }
    *bound <= MOST_PACKED
}

/// The greatest sum.
#[inline(never)]
fn greatest<const V: usize>(blocks: &[[WideCosts; V]]) -> u32 {
    blocks.as_flattened().iter().fold(0, |most, sums| sums.iter().fold(most, |most, &sum| most.max(sum)))
}

/// The index of the first disparity with a cost, and one past all disparities if there is none.
#[inline(never)]
pub(super) fn position(costs: &[WideCosts], cost: u32) -> usize {
    if costs.is_empty() {
        return 0;
    }
    let (groups_left, first, second, third): (usize, u32, u32, u32);
    // SAFETY: reads four costs after the other, at least once, at most all. Every register that changes is an output.
    unsafe {
        asm!(
            "2:",
            "ldm {costs}!, {{r0, r1, r2, r3}}",
            "cmp r0, {cost}",
            "ittt ne",
            "cmpne r1, {cost}",
            "cmpne r2, {cost}",
            "cmpne r3, {cost}",
            "beq 3f",
            "subs {groups_left}, {groups_left}, #1",
            "bne 2b",
            "3:",
            costs = inout(reg) costs.as_ptr() => _,
            groups_left = inout(reg) 2 * costs.len() => groups_left,
            cost = in(reg) cost,
            out("r0") first,
            // Lanes lie in memory as the disparities 0, 2, 1, 3.
            out("r1") third,
            out("r2") second,
            out("r3") _,
            options(readonly, nostack),
        );
    }
    let before = 8 * costs.len() - 4 * groups_left;
    match groups_left {
        0 => before,
        _ if first == cost => before,
        _ if second == cost => before + 1,
        _ if third == cost => before + 2,
        _ => before + 3,
    }
}

/// Loads a pair of a view's sums, raised to their masks if there are any, into the halves of `$to`.
macro_rules! load_pair {
    ($to:literal, $place:literal) => {
        concat!(
            "ldrd ",
            $to,
            ", {t}, [{block}",
            $place,
            "
            pkhbt ",
            $to,
            ", ",
            $to,
            ", {t}, lsl #16
            .if {is_masked}
            ldrd {t}, {u}, [{mask}",
            $place,
            "
            pkhbt {t}, {t}, {u}, lsl #16
            orr ",
            $to,
            ", ",
            $to,
            ", {t}
            .endif
            "
        )
    };
}

/// Lowers the least of all to two costs.
macro_rules! lower_to_pair {
    ($a:literal, $b:literal) => {
        concat!("cmp ", $a, ", {least}\nit lo\nmovlo {least}, ", $a, "\ncmp ", $b, ", {least}\nit lo\nmovlo {least}, ", $b, "\n")
    };
}

/// The minimum of views, of which masks hide some if `MASKED` is set.
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0. All sums can be packed.
#[inline(always)]
pub(super) unsafe fn min<const V: usize, const MASKED: bool>(
    blocks: *const [WideCosts; V],
    masks: *const [WideCosts; V],
    fused: &mut [WideCosts],
) -> u32 {
    let mut least = u32::MAX;
    // SAFETY: reads as many blocks and masks as it writes fused costs. Every register that changes is an output.
    unsafe {
        asm_up_to!(1800 bytes,
            "2:",
            ".irp next, 8, 8, 8, {to_next}",
            load_pair!("{a}", "], #\\next"),
            ".irp view, 1, 2, 3, 4, 5, 6, 7",
            ".if \\view < {views}",
            // The first view's address has moved on.
            load_pair!("{b}", ", #(32 * \\view - \\next)]"),
            min!("{a}", "{b}"),
            ".endif",
            ".endr",
            min!("{least}", "{a}"),
            ".if {is_masked}",
            // 0xffff becomes the greatest cost.
            "mov {t}, #0x00010001",
            "uadd16 {a}, {a}, {t}",
            ".endif",
            "lsr {b}, {a}, #16",
            "uxth {a}, {a}",
            ".if {is_masked}",
            "sub {a}, {a}, #1",
            "sub {b}, {b}, #1",
            ".endif",
            "strd {a}, {b}, [{fused}], #8",
            ".endr",
            "subs {n}, {n}, #1",
            "bne 2b";
            n = inout(reg) fused.len() => _,
            block = inout(reg) blocks => _,
            mask = inout(reg) masks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            a = out(reg) _,
            b = out(reg) _,
            t = out(reg) _,
            u = out(reg) _,
            views = const V,
            is_masked = const MASKED as u8,
            // From the last pair of a view to its first in the next vector.
            to_next = const 2 * VECTOR * (V - 1) + 8,
            options(nostack),
        );
    }
    match (least & 0xffff).min(least >> 16) {
        0xffff => u32::MAX,
        least => least,
    }
}

/// The heuristic rule over four views, of which masks hide up to two if `MASKED` is set.
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0. All sums can be packed.
#[inline(always)]
pub(super) unsafe fn heuristic_of_four<const MASKED: bool>(
    blocks: *const [WideCosts; 4],
    masks: *const [WideCosts; 4],
    fused: &mut [WideCosts],
) -> u32 {
    let mut least = u32::MAX;
    // SAFETY: reads as many blocks and masks as it writes fused costs. Every register that changes is an output.
    unsafe {
        asm_up_to!(1400 bytes,
            "2:",
            ".irp next, 8, 8, 8, 104",
            load_pair!("{a}", "], #\\next"),
            load_pair!("{b}", ", #(32 - \\next)]"),
            load_pair!("{c}", ", #(64 - \\next)]"),
            load_pair!("{d}", ", #(96 - \\next)]"),
            sort_least_three!("{a}", "{b}", "{c}", "{d}", "{t}"),
            // The least of all in d, the second in c and the third in a. In a goes what stays of the third, and in b the sum
            // of the others where it does not, since their mean is that of two.
            "uqadd16 {t}, {c}, {c}",
            "uqadd16 {t}, {t}, {c}",
            ".if {is_masked}",
            // The third leaves if it is as much as three times the second and 1: a hidden view does so where this saturates.
            // Then the sum of the others may saturate too, and goes to b and u as two.
            "mov {u}, #0x00010001",
            "uqadd16 {t}, {t}, {u}",
            "mov {u}, #0",
            "usub16 {t}, {a}, {t}",
            "sel {a}, {u}, {a}",
            "sel {b}, {c}, {u}",
            "sel {u}, {d}, {u}",
            ".else",
            "mov {u}, #0",
            "uqadd16 {b}, {c}, {d}",
            "usub16 {t}, {t}, {a}",
            "sel {a}, {a}, {u}",
            "sel {b}, {u}, {b}",
            ".endif",
            // Of each half twice the first three, and the others.
            "uxth {t}, {d}",
            "uxtah {t}, {t}, {c}",
            "uxtah {t}, {t}, {a}",
            "lsl {t}, {t}, #1",
            "uxtah {t}, {t}, {b}",
            "lsr {d}, {d}, #16",
            "add {d}, {d}, {c}, lsr #16",
            "add {d}, {d}, {a}, lsr #16",
            ".if {is_masked}",
            "uxtah {t}, {t}, {u}",
            "lsr {u}, {u}, #16",
            "add {u}, {u}, {b}, lsr #16",
            ".else",
            "lsr {u}, {b}, #16",
            ".endif",
            "add {u}, {u}, {d}, lsl #1",
            "strd {t}, {u}, [{fused}], #8",
            lower_to_pair!("{t}", "{u}"),
            ".endr",
            "subs {n}, {n}, #1",
            "bne 2b";
            n = inout(reg) fused.len() => _,
            block = inout(reg) blocks => _,
            mask = inout(reg) masks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            a = out(reg) _,
            b = out(reg) _,
            c = out(reg) _,
            d = out(reg) _,
            t = out(reg) _,
            u = out(reg) _,
            is_masked = const MASKED as u8,
            options(nostack),
        );
    }
    least
}

/// The sum of two to four views: of all if `MASKED` is not set, and otherwise of those that the masks of view `k` leave, on
/// the scale of [`Rule::fuse_available`](crate::kernel::rule::Rule::fuse_available).
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0, and `k < V`.
#[inline(always)]
pub(super) unsafe fn sum<const V: usize, const MASKED: bool>(
    k: usize,
    blocks: *const [WideCosts; V],
    masks: *const [WideCosts; V],
    fused: &mut [WideCosts],
) -> u32 {
    let mut least = u32::MAX;
    // SAFETY: reads as many blocks and masks as it writes fused costs. Every register that changes is an output.
    unsafe {
        asm_up_to!(800 bytes,
            "2:",
            ".irp next, 8, 8, 8, {to_next}",
            "ldrd {a}, {b}, [{block}], #\\next",
            ".irp view, 1, 2, 3",
            ".if \\view < {views}",
            "ldrd {t}, {u}, [{block}, #(32 * \\view - \\next)]",
            "add {a}, {a}, {t}",
            "add {b}, {b}, {u}",
            ".endif",
            ".endr",
            ".if {is_masked}",
            // Without what is hidden; where that is nothing, there is a view more to the mean.
            "ldrd {t}, {u}, [{hidden}], #\\next",
            ".irp sum, {a}, {b}",
            "ldr {m}, [{mask}], #4",
            "and {t}, {t}, {m}",
            "sub \\sum, \\sum, {t}",
            "and {m}, \\sum, {m}",
            ".if {views} == 3",
            "add \\sum, {m}, \\sum, lsl #1",
            "lsl \\sum, \\sum, #1",
            ".else",
            ".if {views} == 4",
            "add \\sum, \\sum, \\sum, lsl #1",
            ".endif",
            "add \\sum, \\sum, {m}",
            ".endif",
            "mov {t}, {u}",
            ".endr",
            "add {mask}, {mask}, #\\next - 8",
            ".endif",
            "strd {a}, {b}, [{fused}], #8",
            lower_to_pair!("{a}", "{b}"),
            ".endr",
            "subs {n}, {n}, #1",
            "bne 2b";
            n = inout(reg) fused.len() => _,
            block = inout(reg) blocks => _,
            hidden = inout(reg) blocks.cast::<WideCosts>().wrapping_add(k) => _,
            mask = inout(reg) masks.cast::<WideCosts>().wrapping_add(k) => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            a = out(reg) _,
            b = out(reg) _,
            m = out(reg) _,
            t = out(reg) _,
            u = out(reg) _,
            views = const V,
            is_masked = const MASKED as u8,
            to_next = const 2 * VECTOR * (V - 1) + 8,
            options(nostack),
        );
    }
    least
}
