//! The paths of semi-global matching through a pixel, in the DSP extension.
//!
//! In all loops r7 holds P1, r9 the cost of a jump, r10 P2, each in every byte, and r6 the least path costs so
//! far.
#![allow(unsafe_code)]

use super::instruction::splat;
use crate::kernel::bytes::{Slot, Step};

/// Begins a pixel, with the least path cost before it in every byte of r0, and P2 in those of r1. Without
/// candidates, that cost and a jump's are 255, and P2 becomes 0.
macro_rules! start_pixel {
    () => {
        "
        uqadd8 r9, r0, r1
        sub r10, r9, r0
        mvn r6, #0
        "
    };
}

/// Computes the path costs of four disparities in r0, and in `$added` what they exceed the matching costs in
/// `$costs` by. That is added to `$sum`.
///
/// Of the path costs at the pixel before, r1 has those of the disparities below, `$same` is the address of their
/// own, and `$above` that of the disparities above.
macro_rules! path_costs {
    ($above:expr, $same:expr, $costs:literal, $added:literal $(, $sum:literal)?) => {
        concat!(
            "ldr r0, ", $above, "
            usub8 r2, r0, r1
            sel r0, r1, r0
            uqadd8 r0, r0, r7
            ldr r1, ", $same, "
            usub8 r2, r1, r0
            sel r0, r0, r1
            ",
            // The penalty is P2, less what the path saves against a jump.
            "uqsub8 r0, r9, r0
            sub ", $added, ", r10, r0\n",
            $("uqadd8 ", $sum, ", ", $sum, ", ", $added, "\n",)?
            "uqadd8 r0, ", $costs, ", ", $added, "\n",
        )
    };
}

/// Lowers the least path costs to those in r0.
macro_rules! lower_least {
    () => {
        "
        usub8 r2, r6, r0
        sel r6, r0, r6
        "
    };
}

/// The least of four path costs in the lowest byte, and in all if `$shift` rotates.
macro_rules! least_of_four {
    ($shift:literal) => {
        concat!(
            "ror r0, r6, #16
            usub8 r1, r0, r6
            sel r6, r6, r0
            ",
            $shift,
            " r0, r6, #8
            usub8 r1, r0, r6
            sel r6, r6, r0
            "
        )
    };
}

/// A [`Step`] as assembly loads it.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
struct RawStep {
    before: *const u8,
    after: *mut u8,
    p2: u32,
}

/// Extends paths by a pixel: see [`PixelLoops::extend`](crate::kernel::PixelLoops::extend).
///
/// # Safety
/// There are as many vectors of costs as of excess, at least one, and all slots are for as many.
#[inline(always)]
pub(super) unsafe fn extend<const N: usize, const FIRST: bool>(
    costs: &[[u8; 8]],
    steps: [Step<'_>; N],
    p1: u8,
    excess: &mut [[u8; 8]],
) {
    const { assert!(N > 0 && N <= 4) };
    let steps =
        steps.map(|Step { before, after, p2 }| RawStep { before: before.as_ptr(), after: after.as_mut_ptr(), p2: splat(p2) });
    let excess = excess.as_mut_ptr_range();
    // SAFETY: reads the costs and the slots before the pixel, and writes the slots after it and the excess,
    // as many vectors as there are. Every register that changes is an output or restored from the stack.
    unsafe {
        asm_up_to!(800 bytes,
            // The code takes all registers. The stack holds the steps; the end of the excess; r6 and r7, which
            // are reserved for the compiler; and where costs and excess begin.
            "push {{r4, r5, r6, r7, r12, lr}}",
            "mov r7, r3",
            ".irp path, 0, 1, 2, 3",
            ".if \\path < {paths}",
            "ldr r0, [sp]",
            "ldrd r12, lr, [sp, #16]",
            "ldr r1, [r0, #({step} * \\path + 8)]",
            "ldrd r11, r8, [r0, #({step} * \\path)]",
            "ldrb r0, [r11], #{lead}",
            "mov r2, #0x01010101",
            "mul r0, r0, r2",
            start_pixel!(),
            "3:",
            "ldr r3, [r12], #4",
            "ldr r1, [r11, #-1]",
            ".if {first} && (\\path == 0)",
            path_costs!("[r11, #1]", "[r11], #4", "r3", "r4"),
            ".else",
            "ldr r4, [lr]",
            path_costs!("[r11, #1]", "[r11], #4", "r3", "r1", "r4"),
            ".endif",
            "str r4, [lr], #4",
            "str r0, [r8, #4]!",
            lower_least!(),
            "ldrd r3, r4, [sp]",
            "cmp lr, r4",
            "bne 3b",
            least_of_four!("lsr"),
            "ldr r0, [r3, #({step} * \\path + 4)]",
            "strb r6, [r0]",
            ".endif",
            ".endr",
            "pop {{r4, r5, r6, r7, r12, lr}}";
            out("r0") _, out("r1") _, out("r2") _,
            inout("r3") splat(p1) => _,
            in("r4") steps.as_ptr(),
            in("r5") excess.end,
            out("r8") _, out("r9") _, out("r10") _, out("r11") _,
            in("r12") costs.as_ptr(),
            in("lr") excess.start,
            paths = const N,
            first = const FIRST as u8,
            step = const size_of::<RawStep>(),
            lead = const Slot::LEAD,
        );
    }
}
