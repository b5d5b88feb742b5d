//! The path from the right, through many pixels, in MVE.
#![allow(unsafe_code)]

use super::{
    isa::Mve,
    unrolled::{DEPTH, STRIDE},
    winner::{self, MOST_PATHS},
};
use crate::kernel::bytes::{BackwardRun, Reached, Slot, backward_loop};

/// Pixels whose winners are found before any is handed over.
const PIXELS: usize = 32;

/// [`RunLoops::extend_backward`](crate::kernel::RunLoops::extend_backward).
#[inline(always)]
pub(super) fn backward(mve: Mve, paths: u16, run: BackwardRun<'_, '_>, mut reach: impl FnMut(Reached<'_>)) {
    if run.depth != DEPTH || paths > MOST_PATHS || run.along[0].len() != STRIDE {
        return backward_loop(mve, paths, run, reach);
    }
    let BackwardRun { costs, excess, along, penalties, .. } = run;
    let (costs, excess) = (costs.as_chunks::<DEPTH>().0, excess.as_chunks_mut::<DEPTH>().0);
    let constant = penalties.constant_p2();
    let (mut p2, mut keys) = ([constant.unwrap_or_default(); PIXELS], [0; PIXELS]);
    let mut end = costs.len().min(excess.len());
    while end > 0 {
        let start = end.saturating_sub(PIXELS);
        let (Some(costs), Some(excess)) = (costs.get(start..end), excess.get_mut(start..end)) else { return };
        let (Some(p2), Some(keys)) = (p2.get_mut(..end - start), keys.get_mut(..end - start)) else { return };
        let (all_costs, all_excess) = (costs.as_flattened(), excess.as_flattened_mut());
        if constant.is_none() {
            p2.iter_mut().zip(start..).for_each(|(p2, u)| *p2 = penalties.backward_p2(u));
            // SAFETY: there are as many pixels as penalties and keys, not 0, and a slot.
            unsafe { backward_unrolled::<true>(paths, penalties.p1, p2, all_costs, all_excess, along[0], keys) }
        } else {
            // SAFETY: there are as many pixels as keys, not 0, and a slot.
            unsafe { backward_unrolled::<false>(paths, penalties.p1, p2, all_costs, all_excess, along[0], keys) }
        }
        for (i, ((costs, excess), &mut key)) in costs.iter().zip(&*excess).zip(keys).enumerate() {
            reach(Reached { column: start + i, costs, excess, winner: winner::unpack(key.into()) });
        }
        end = start;
    }
}
/// Extends the path from the right through pixels, the last first, and writes the [keys](super::winner) of
/// their winners. P2 is a single one, or if `EDGES` is set, that of each pixel.
///
/// # Safety
/// There are [`DEPTH`] costs and excess for each key, at least one, and `along` is a slot. Paths are at most
/// [`MOST_PATHS`](super::winner::MOST_PATHS).
#[inline(always)]
unsafe fn backward_unrolled<const EDGES: bool>(
    paths: u16,
    p1: u8,
    p2: &[u8],
    costs: &[u8],
    excess: &mut [u8],
    along: &mut [u8],
    keys: &mut [u16],
) {
    let mut least = along.first().copied().map_or(0, u32::from);
    // SAFETY: for each key, reads the penalty and the costs of a pixel, reads and writes as much excess and the
    // slot. Every register that changes is an output.
    unsafe {
        asm_up_to!(300 bytes,
            "ldrb r2, [{p2}, #-1]",
            "vdup.8 q0, r2",
            "movs r2, #0",
            "vidup.u16 q4, r2, #1",
            "movs r2, #{depth}",
            "vdup.16 q2, r2",
            "dls lr, lr",
            "2:",
            ".if {edges}",
            "ldrb r2, [{p2}, #-1]!",
            "vdup.8 q0, r2",
            ".endif",
            extend_unrolled!(
                "{along}", "0", "{least}",
                "vmin.u8 q5, q5, q0
                vldrb.u8 q3, [r0, #-{depth}]!
                vldrb.u8 q1, [r1, #-{depth}]!
                vqadd.u8 q3, q3, q5
                vqadd.u8 q5, q5, q1
                vstrb.8 q3, [r0]\n",
                "vmin.u8 q7, q7, q0
                vldrb.u8 q3, [r0, #16]
                vldrb.u8 q1, [r1, #16]
                vqadd.u8 q3, q3, q7
                vqadd.u8 q7, q7, q1
                vstrb.8 q3, [r0, #16]\n"
            ),
            // The sums of eight disparities, times 32, and plus the index of the first of them.
            "vldrb.u16 q1, [r0]",
            "vldrb.u16 q3, [r1]",
            "vmla.i16 q1, q3, {paths}",
            "vmul.i16 q1, q1, q2",
            ".irp j, 8, 16, 24",
            "vldrb.u16 q3, [r0, #\\j]",
            "vldrb.u16 q5, [r1, #\\j]",
            "vmla.i16 q3, q5, {paths}",
            ".if \\j == 8",
            "vmlas.i16 q3, q2, {at8}",
            ".elseif \\j == 16",
            "vmlas.i16 q3, q2, {at16}",
            ".else",
            "vmlas.i16 q3, q2, {at24}",
            ".endif",
            "vmin.u16 q1, q1, q3",
            ".endr",
            "vadd.i16 q1, q1, q4",
            "movw r2, #0xffff",
            "vminv.u16 r2, q1",
            "strh r2, [{keys}, #-2]!",
            "le lr, 2b";
            p1 = in(reg) u32::from(p1),
            p2 = inout(reg) p2.as_ptr_range().end => _,
            paths = in(reg) u32::from(paths),
            at8 = in(reg) 8,
            at16 = in(reg) 16,
            at24 = in(reg) 24,
            along = in(reg) along.as_mut_ptr(),
            least = inout(reg) least,
            keys = inout(reg) keys.as_mut_ptr().wrapping_add(keys.len()) => _,
            // Loads that widen take their addresses from low registers, and indices count in even ones.
            inout("r0") excess.as_mut_ptr().wrapping_add(excess.len()) => _,
            inout("r1") costs.as_ptr().wrapping_add(costs.len()) => _,
            out("r2") _,
            inout("lr") keys.len() => _,
            out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _, out("q6") _, out("q7") _,
            lead = const Slot::LEAD,
            depth = const DEPTH,
            edges = const EDGES as u8,
            options(nostack),
        );
    }
    along.iter_mut().take(1).for_each(|slot| *slot = least as u8);
}
