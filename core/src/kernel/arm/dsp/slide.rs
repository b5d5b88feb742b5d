//! Column sums move down, and blocks slide, in the DSP extension.
#![allow(unsafe_code)]

use bytemuck::Pod;

use super::{Dsp, VECTOR, instruction::splat};
use crate::kernel::steps::{RawStep, Track};

/// Half a vector of [`slide`]: adds four differences that enter and subtracts four that leave.
macro_rules! slide_half {
    ($low:literal, $high:literal) => {
        instructions! {
            ldr "r0", "[r9]", "#4";
            uqsub8 "r1", "r0", "r2";
            uqsub8 "r0", "r2", "r0";
            orr "r0", "r0", "r1";
            uxtab16 $low, $low, "r0";
            uxtab16 $high, $high, "r0", "ror #8";
            // 255 - |a - b|: what neither 255 - a + b, saturated, nor b - a, saturated, takes away.
            ldr "r0", "[r10]", "#4";
            uqadd8 "r1", "r8", "r0";
            uqsub8 "r0", "r0", "r3";
            bic "r1", "r1", "r0";
            uxtab16 $low, $low, "r1";
            uxtab16 $high, $high, "r1", "ror #8";
        }
    };
}

/// Adds what four lanes of a column grow by, two in a word, to block sums of 32 bits.
macro_rules! grow_four {
    ($first:literal, $second:literal) => {
        instructions! {
            ldm "lr", "{{r0, r1, r2, r3}}";
            sxtah "r0", "r0", $first;
            sxtah "r1", "r1", $first, "ror #16";
            sxtah "r2", "r2", $second;
            sxtah "r3", "r3", $second, "ror #16";
            stm "lr!", "{{r0, r1, r2, r3}}";
        }
    };
}

/// A vector of [`slide`].
macro_rules! slide_vector {
    () => {
        concat!(
            "ldm r11, {{r4, r5, r6, r7}}\n",
            slide_half!("r4", "r5"),
            slide_half!("r6", "r7"),
            "stm r11!, {{r4, r5, r6, r7}}
            ldm r12!, {{r0, r1, r2, r3}}
            usub16 r4, r4, r0
            usub16 r5, r5, r1
            usub16 r6, r6, r2
            usub16 r7, r7, r3
            .if {block} > {vector}
            ",
            grow_four!("r4", "r5"),
            grow_four!("r6", "r7"),
            ".else
            ldm lr, {{r0, r1, r2, r3}}
            uadd16 r4, r4, r0
            uadd16 r5, r5, r1
            uadd16 r6, r6, r2
            uadd16 r7, r7, r3
            stm lr!, {{r4, r5, r6, r7}}
            .endif
            ldrd r2, r3, [sp]
            "
        )
    };
}

/// Moves a column down by a line and slides the blocks by it, whose sums, `C`, have 16 or 32 bits. `N` is the number of
/// vectors in a view, unrolled, or 0 for a loop.
///
/// The differences that leave are subtracted by adding 255 less each: that is the
/// [bias](crate::kernel::Isa::bias).
///
/// # Safety
/// The step has as many vectors in a view as there are blocks: `N`, or at least one if `N` is 0.
#[inline(always)]
pub(super) unsafe fn slide<C: Pod, const V: usize, const N: usize>(step: RawStep<'_, Dsp, V>, blocks: &mut [[C; V]]) {
    const { assert!(size_of::<C>() == VECTOR || size_of::<C>() == 2 * VECTOR, "block sums have 16 or 32 bits") };
    let RawStep { center, index, tracks, entering, leaving, .. } = step;
    let (center_entering, center_leaving) = (splat(center.entering), splat(center.leaving));
    // SAFETY: the step has samples and sums of `V` views in as many vectors as there are blocks. Every
    // register that changes is an output or restored from the stack.
    unsafe {
        asm_up_to!(6300 bytes,
            // The code takes all registers. The stack holds the centre's samples, whose registers each vector
            // borrows; r6 and r7, which are reserved for the compiler; the tracks and the column's index.
            "push {{r2, r3, r6, r7, r9, r10}}",
            // A loop over vectors also needs the centre's samples, the bytes of a view's vectors, and the
            // view's first block.
            ".if !{unrolled}",
            "sub sp, sp, #16",
            "strd r2, r3, [sp]",
            "strd r0, lr, [sp, #8]",
            ".endif",
            ".rept {views}",
            "ldrd r0, r1, [sp, #{tracks}]",
            "ldm r0!, {{r4, r5, r6}}",
            "str r0, [sp, #{tracks}]",
            "mla r9, r6, r1, r4",
            "mla r10, r6, r1, r5",
            ".if {unrolled}",
            ".rept {unrolled} - 1",
            slide_vector!(),
            "add lr, lr, #{other_views}",
            ".endr",
            slide_vector!(),
            "sub lr, lr, #{to_next_view}",
            ".else",
            "ldr r0, [sp, #8]",
            "add r0, r0, r12",
            "str r0, [sp, #16]",
            "3:",
            slide_vector!(),
            "add lr, lr, #{other_views}",
            "ldr r0, [sp, #16]",
            "cmp r12, r0",
            "bne 3b",
            "ldr lr, [sp, #12]",
            "add lr, lr, #{block}",
            "str lr, [sp, #12]",
            ".endif",
            ".endr",
            ".if !{unrolled}",
            "add sp, sp, #16",
            ".endif",
            "pop {{r2, r3, r6, r7, r9, r10}}";
            inout("r0") blocks.len() * VECTOR => _,
            out("r1") _,
            inout("r2") center_entering => _,
            inout("r3") center_leaving => _,
            out("r4") _,
            out("r5") _,
            in("r8") !center_leaving,
            inout("r9") tracks => _,
            inout("r10") index => _,
            inout("r11") entering => _,
            inout("r12") leaving => _,
            inout("lr") blocks.as_mut_ptr() => _,
            views = const V,
            unrolled = const N,
            // From a view's last block to the next view's first.
            to_next_view = const N.saturating_sub(1) * V * size_of::<C>(),
            other_views = const size_of::<C>() * (V - 1),
            vector = const VECTOR,
            block = const size_of::<C>(),
            tracks = const if N == 0 { 32 } else { 16 },
        );
    }
}

/// Half a vector of [`prime`].
macro_rules! prime_half {
    ($low:literal, $high:literal) => {
        instructions! {
            ldr "{x}", "[{entering}]", "#4";
            uqsub8 "{y}", "{x}", "{center}";
            uqsub8 "{x}", "{center}", "{x}";
            orr "{x}", "{x}", "{y}";
            uxtab16 $low, $low, "{x}";
            uxtab16 $high, $high, "{x}", "ror #8";
        }
    };
}

/// Adds the line that enters to the sums of a column.
///
/// # Safety
/// The step has `vectors` vectors in a view, at least one.
#[inline(always)]
pub(super) unsafe fn prime<const V: usize>(step: RawStep<'_, Dsp, V>, vectors: usize) {
    let RawStep { center, index, tracks, entering, .. } = step;
    // SAFETY: the step has samples and sums of `V` views in so many vectors. Every register that changes is
    // an output.
    unsafe {
        asm_up_to!(620 bytes,
            ".rept {views}",
            "ldr {x}, [{tracks}, #8]",
            "ldr {entering}, [{tracks}], #{track}",
            "mla {entering}, {x}, {index}, {entering}",
            "mov {n}, {vectors}",
            "3:",
            "ldm {column}, {{r0, r1, r2, r3}}",
            prime_half!("r0", "r1"),
            prime_half!("r2", "r3"),
            "stm {column}!, {{r0, r1, r2, r3}}",
            "subs {n}, {n}, #1",
            "bne 3b",
            ".endr";
            vectors = in(reg) vectors,
            index = in(reg) index,
            tracks = inout(reg) tracks => _,
            column = inout(reg) entering => _,
            center = in(reg) splat(center.entering),
            entering = out(reg) _,
            n = out(reg) _,
            x = out(reg) _,
            y = out(reg) _,
            out("r0") _, out("r1") _, out("r2") _, out("r3") _,
            track = const size_of::<Track>(),
            views = const V,
            options(nostack),
        );
    }
}
