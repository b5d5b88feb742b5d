//! Joint sums of all views, in the DSP extension.
#![allow(unsafe_code)]

use super::{Dsp, fuse::Costs, instruction::splat};
use crate::kernel::steps::RawStep;

/// The most vectors that are unrolled.
pub(super) const MOST_UNROLLED: usize = 4;

/// Adds four differences that enter, at `$place` from r9 on, and subtracts four that leave, from r10 on: as
/// [`slide`](super::slide::slide) does.
macro_rules! advance_half {
    ($low:literal, $high:literal, $place:literal) => {
        concat!(
            "ldr r0, [r9, #",
            $place,
            "]\n",
            instructions! {
                uqsub8 "r1", "r0", "r2";
                uqsub8 "r0", "r2", "r0";
                orr "r0", "r0", "r1";
                uxtab16 $low, $low, "r0";
                uxtab16 $high, $high, "r0", "ror #8";
            },
            "ldr r0, [r10, #",
            $place,
            "]\n",
            instructions! {
                uqadd8 "r1", "r8", "r0";
                uqsub8 "r0", "r0", "r3";
                bic "r1", "r1", "r0";
                uxtab16 $low, $low, "r1";
                uxtab16 $high, $high, "r1", "ror #8";
            }
        )
    };
}

/// Lowers the least of all, in r9, and raises the greatest, in r10, to a word.
macro_rules! bound_word {
    ($sums:literal) => {
        instructions! {
            usub16 "r0", "r9", $sums;
            sel "r9", $sums, "r9";
            usub16 "r0", $sums, "r10";
            sel "r10", $sums, "r10";
        }
    };
}

/// [`Blocks::slide_jointly`](crate::kernel::Blocks::slide_jointly), `N` vectors unrolled. Returns the least sum in each
/// half of a word, and the greatest in each half of another.
///
/// # Safety
/// The step has as many vectors in a view as there are sums: a multiple of `N`, not 0. As many vectors leave. There are at
/// most four views.
#[inline(always)]
pub(super) unsafe fn slide_jointly<const V: usize, const N: usize>(step: RawStep<'_, Dsp, V>, sums: &mut [Costs]) -> (u32, u32) {
    const { assert!(N <= MOST_UNROLLED) };
    let RawStep { center, index, tracks, entering, leaving, .. } = step;
    let (center_entering, center_leaving) = (splat(center.entering), splat(center.leaving));
    let sums = sums.as_mut_ptr_range();
    let (least, greatest): (u32, u32);
    // SAFETY: the step has samples of `V` views and sums of the first in as many vectors as there are sums, and as many
    // leave. Every register that changes is an output or restored from the stack.
    unsafe {
        asm_up_to!(2600 bytes,
            // The code takes all registers. The stack holds the samples of each view that enter and that leave; the least
            // sum, and the greatest; the end of the sums; and r6 and r7, which are reserved for the compiler.
            "push {{r0, r6, r7}}",
            "sub sp, sp, #{bounds} + 8",
            ".irp k, 0, 1, 2, 3",
            ".if \\k < {views}",
            "ldm r9!, {{r4, r5, r6}}",
            "mla r4, r6, r10, r4",
            "mla r5, r6, r10, r5",
            "strd r4, r5, [sp, #(8 * \\k)]",
            ".endif",
            ".endr",
            "mvn r0, #0",
            "mov r1, #0",
            "strd r0, r1, [sp, #{bounds}]",
            "3:",
            ".irp j, 0, 1, 2, 3",
            ".if \\j < {unrolled}",
            "ldm r11, {{r4, r5, r6, r7}}",
            ".irp k, 0, 1, 2, 3",
            ".if \\k < {views}",
            "ldrd r9, r10, [sp, #(8 * \\k)]",
            advance_half!("r4", "r5", "(8 * \\j)"),
            advance_half!("r6", "r7", "(8 * \\j + 4)"),
            ".endif",
            ".endr",
            "stm r11!, {{r4, r5, r6, r7}}",
            "ldm r12!, {{r0, r1, r9, r10}}",
            "usub16 r4, r4, r0",
            "usub16 r5, r5, r1",
            "usub16 r6, r6, r9",
            "usub16 r7, r7, r10",
            "ldm lr, {{r0, r1, r9, r10}}",
            "uadd16 r4, r4, r0",
            "uadd16 r5, r5, r1",
            "uadd16 r6, r6, r9",
            "uadd16 r7, r7, r10",
            "stm lr!, {{r4, r5, r6, r7}}",
            "ldrd r9, r10, [sp, #{bounds}]",
            bound_word!("r4"),
            bound_word!("r5"),
            bound_word!("r6"),
            bound_word!("r7"),
            ".if \\j + 1 < {unrolled}",
            "strd r9, r10, [sp, #{bounds}]",
            ".endif",
            ".endif",
            ".endr",
            "ldr r0, [sp, #({bounds} + 8)]",
            "cmp lr, r0",
            "beq 4f",
            "strd r9, r10, [sp, #{bounds}]",
            ".irp k, 0, 1, 2, 3",
            ".if \\k < {views}",
            "ldrd r9, r10, [sp, #(8 * \\k)]",
            "add r9, r9, #(8 * {unrolled})",
            "add r10, r10, #(8 * {unrolled})",
            "strd r9, r10, [sp, #(8 * \\k)]",
            ".endif",
            ".endr",
            "b 3b",
            "4:",
            "add sp, sp, #{bounds} + 8",
            "pop {{r0, r6, r7}}";
            inout("r0") sums.end => _,
            out("r1") _,
            inout("r2") center_entering => _,
            inout("r3") center_leaving => _,
            out("r4") _,
            out("r5") _,
            in("r8") !center_leaving,
            inout("r9") tracks => least,
            inout("r10") index => greatest,
            inout("r11") entering => _,
            inout("r12") leaving => _,
            inout("lr") sums.start => _,
            views = const V,
            unrolled = const N,
            bounds = const 8 * V,
        );
    }
    (least, greatest)
}
