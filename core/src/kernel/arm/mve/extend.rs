//! Paths through a pixel, in MVE.
#![allow(unsafe_code)]

use crate::kernel::bytes::{Slot, Step};

/// Extends a path by a pixel. What it adds to the costs is written to `excess` if `FIRST` is set, and added to
/// it otherwise.
///
/// # Safety
/// There are as many costs as excess, not 0, and the slots of the step have as many as well.
#[inline(always)]
pub(super) unsafe fn extend<const FIRST: bool>(costs: &[u8], step: Step<'_>, p1: u8, excess: &mut [u8]) {
    let Step { before, after, p2 } = step;
    let least_before = before.first().copied().unwrap_or(u8::MAX);
    let mut least = u32::from(u8::MAX);
    // SAFETY: reads and writes as many bytes as there are costs, and reads one more on either side in `before`.
    // Every register that changes is an output.
    unsafe {
        asm_up_to!(100 bytes,
            "vdup.8 q0, {p2}",
            // The last of the vectors may be half a one.
            "dlstp.8 lr, {n}",
            "2:",
            "vldrb.u8 q1, [{before}, #-1]",
            "vldrb.u8 q2, [{before}, #1]",
            "vmin.u8 q1, q1, q2",
            "vqadd.u8 q1, q1, {p1}",
            "vldrb.u8 q2, [{before}], #16",
            "vmin.u8 q1, q1, q2",
            // The least is taken away first, so that P2 does not have to be added to it.
            "vqsub.u8 q1, q1, {least_before}",
            "vmin.u8 q1, q1, q0",
            ".if {first}",
            "vstrb.8 q1, [{excess}], #16",
            ".else",
            "vldrb.u8 q2, [{excess}]",
            "vqadd.u8 q2, q2, q1",
            "vstrb.8 q2, [{excess}], #16",
            ".endif",
            "vldrb.u8 q2, [{costs}], #16",
            "vqadd.u8 q1, q1, q2",
            "vstrb.8 q1, [{after}], #16",
            "vminv.u8 {least}, q1",
            "letp lr, 2b";
            n = in(reg) costs.len(),
            p1 = in(reg) u32::from(p1),
            p2 = in(reg) u32::from(p2),
            least_before = in(reg) u32::from(least_before),
            least = inout(reg) least,
            before = inout(reg) before.as_ptr().wrapping_add(Slot::LEAD) => _,
            after = inout(reg) after.as_mut_ptr().wrapping_add(Slot::LEAD) => _,
            costs = inout(reg) costs.as_ptr() => _,
            excess = inout(reg) excess.as_mut_ptr() => _,
            out("lr") _, out("q0") _, out("q1") _, out("q2") _,
            first = const FIRST as u8,
            options(nostack, preserves_flags),
        );
    }
    after.iter_mut().take(1).for_each(|slot| *slot = least as u8);
}
