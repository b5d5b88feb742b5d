//! The loops over the 8-bit costs of a pixel, in MVE: paths, the division of fused sums, the least sums of path costs, and
//! Hamming distances.
#![allow(unsafe_code)]

use core::arch::asm;

use crate::kernel::bytes::{Divisor, Slot, Step};

/// Extends a path by a pixel. Its excess over the costs is written to `excess` if `FIRST` is set, and added to
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

/// The number of set bits of each byte.
static ONES: [u8; 256] = {
    let mut ones = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        ones[byte] = (byte as u8).count_ones() as u8;
        byte += 1;
    }
    ones
};

/// The number of bits in which a descriptor differs from others, whose bytes are in planes: at most four.
#[inline(always)]
pub(super) fn distances<const N: usize>(descriptor: [u8; N], others: [&[u8; 8]; N]) -> [u8; 8] {
    const { assert!(N <= 4) };
    let mut distances = [0; 8];
    // SAFETY: reads the descriptor, a vector of each plane and the table at bytes, and writes a vector. Every
    // register that changes is an output.
    unsafe {
        asm_up_to!(140 bytes,
            "vmov.i16 q0, #0",
            ".irp k, 0, 1, 2, 3",
            ".if \\k < {planes}",
            "ldr r0, [{others}, #(4 * \\k)]",
            "vldrb.u16 q1, [r0]",
            "ldrb r0, [{descriptor}, #\\k]",
            "vdup.16 q2, r0",
            "veor q1, q1, q2",
            "vldrb.u16 q2, [{ones}, q1]",
            "vadd.i16 q0, q0, q2",
            ".endif",
            ".endr",
            "vstrb.16 q0, [r1]";
            others = in(reg) others.as_ptr(),
            descriptor = in(reg) descriptor.as_ptr(),
            ones = in(reg) ONES.as_ptr(),
            // Loads that widen and stores that narrow take their addresses from low registers.
            out("r0") _,
            in("r1") distances.as_mut_ptr(),
            out("q0") _, out("q1") _, out("q2") _,
            planes = const N,
            options(nostack, preserves_flags),
        );
    }
    distances
}

/// Lowers the costs of candidates to their Hamming distances, from those of `costs` on.
///
/// # Safety
/// Each plane has as many bytes as there are costs, not 0, and planes are at most four.
#[inline(always)]
pub(super) unsafe fn lower<const N: usize>(descriptor: [u8; N], planes: [&[u8]; N], costs: &mut [u8]) {
    let plane = |k: usize| planes.get(k).map_or(costs.as_ptr(), |plane| plane.as_ptr());
    let mut bytes = [0; 4];
    bytes.iter_mut().zip(descriptor).for_each(|(to, byte)| *to = byte);
    // SAFETY: reads the planes and the table at bytes, and reads and writes as many costs. Every register that
    // changes is an output.
    unsafe {
        asm_up_to!(160 bytes,
            ".irp q, 4, 5, 6, 7",
            ".if \\q - 4 < {planes}",
            "vdup.8 q\\q, {bytes}",
            "lsr {bytes}, {bytes}, #8",
            ".endif",
            ".endr",
            "dlstp.8 lr, {n}",
            "2:",
            "vldrb.u8 q1, [{a}], #16",
            "veor q1, q1, q4",
            "vldrb.u8 q0, [{ones}, q1]",
            ".if {planes} > 1",
            "vldrb.u8 q1, [{b}], #16",
            "veor q1, q1, q5",
            "vldrb.u8 q2, [{ones}, q1]",
            "vadd.i8 q0, q0, q2",
            ".endif",
            ".if {planes} > 2",
            "vldrb.u8 q1, [{c}], #16",
            "veor q1, q1, q6",
            "vldrb.u8 q2, [{ones}, q1]",
            "vadd.i8 q0, q0, q2",
            ".endif",
            ".if {planes} > 3",
            "vldrb.u8 q1, [{d}], #16",
            "veor q1, q1, q7",
            "vldrb.u8 q2, [{ones}, q1]",
            "vadd.i8 q0, q0, q2",
            ".endif",
            "vldrb.u8 q1, [{costs}]",
            "vmin.u8 q0, q0, q1",
            "vstrb.8 q0, [{costs}], #16",
            "letp lr, 2b";
            n = in(reg) costs.len(),
            bytes = inout(reg) u32::from_le_bytes(bytes) => _,
            a = inout(reg) plane(0) => _,
            b = inout(reg) plane(1) => _,
            c = inout(reg) plane(2) => _,
            d = inout(reg) plane(3) => _,
            ones = in(reg) ONES.as_ptr(),
            costs = inout(reg) costs.as_mut_ptr() => _,
            out("lr") _,
            out("q0") _, out("q1") _, out("q2") _, out("q4") _, out("q5") _, out("q6") _, out("q7") _,
            planes = const N,
            options(nostack, preserves_flags),
        );
    }
}
