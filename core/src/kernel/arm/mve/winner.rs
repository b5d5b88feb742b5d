//! Fused sums are divided, and the least sums of path costs found, in MVE.
#![allow(unsafe_code)]

use core::arch::asm;

use crate::kernel::bytes::Divisor;

/// Disparities whose sums are compared at once: sums and indices together fit 16 bits.
pub(super) const AT_ONCE: usize = 32;

/// The most paths: sums are below 2^11 then.
pub(super) const MOST_PATHS: u16 = 7;

/// A least sum and its index, as the loops find them: the sum times [`AT_ONCE`], and the index.
pub(super) fn unpack(key: u32) -> (u16, usize) {
    ((key / AT_ONCE as u32) as u16, key as usize % AT_ONCE)
}

/// The least sum of up to [`AT_ONCE`] disparities, packed with the first index that has it.
///
/// # Safety
/// There are as many costs as excess, in whole vectors of eight, not 0. Paths are at most [`MOST_PATHS`].
#[inline(always)]
pub(super) unsafe fn least(paths: u16, costs: &[u8], excess: &[u8]) -> u32 {
    let mut key = u32::from(u16::MAX);
    // SAFETY: reads as many vectors as there are costs and excess. Every register that changes is an output.
    unsafe {
        asm!(
            "dls lr, {n}",
            "2:",
            "vldrb.u16 q0, [r0], #8",
            "vldrb.u16 q1, [r1], #8",
            "vmla.i16 q0, q1, {paths}",
            "vidup.u16 q1, r2, #1",
            "vsli.16 q1, q0, #5",
            "vminv.u16 {key}, q1",
            "le lr, 2b",
            n = in(reg) costs.len() / 8,
            paths = in(reg) u32::from(paths),
            key = inout(reg) key,
            // Loads that widen take their addresses from low registers, and indices count in even ones.
            inout("r0") excess.as_ptr() => _,
            inout("r1") costs.as_ptr() => _,
            inout("r2") 0 => _,
            out("lr") _, out("q0") _, out("q1") _,
            options(readonly, nostack, preserves_flags),
        );
    }
    key
}

/// [`PixelLoops::divide`](crate::kernel::PixelLoops::divide).
///
/// # Safety
/// There are as many vectors of quotients as of sums, not 0.
#[inline(always)]
pub(super) unsafe fn divide<const BY_THREE: bool>(shift: u32, sums: &[[u16; 8]], quotients: &mut [u8]) {
    // SAFETY: reads all sums and writes as many quotients. Every register that changes is an output.
    unsafe {
        asm_up_to!(80 bytes,
            "vdup.16 q1, {limit}",
            ".if {by_three}",
            "vdup.16 q2, {most}",
            "vdup.16 q3, {third}",
            ".endif",
            "dls lr, {n}",
            "2:",
            "vldrh.u16 q0, [{sums}], #16",
            "vshl.u16 q0, {left}",
            ".if {by_three}",
            "vmin.u16 q0, q0, q2",
            "vmul.i16 q0, q0, q3",
            "vshr.u16 q0, q0, #9",
            ".endif",
            "vmin.u16 q0, q0, q1",
            "vstrb.16 q0, [r0], #8",
            "le lr, 2b";
            n = in(reg) sums.len(),
            left = in(reg) (shift as i32).wrapping_neg(),
            limit = in(reg) u32::from(Divisor::LIMIT),
            most = in(reg) Divisor::MOST_THIRDS,
            third = in(reg) 171,
            sums = inout(reg) sums.as_ptr() => _,
            // Stores that narrow take their addresses from low registers.
            inout("r0") quotients.as_mut_ptr() => _,
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _,
            by_three = const BY_THREE as u8,
            options(nostack, preserves_flags),
        );
    }
}
