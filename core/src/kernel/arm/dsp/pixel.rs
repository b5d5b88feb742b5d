//! The loops over the 8-bit costs of a pixel, in the DSP extension: the division of fused sums, the paths of semi-global
//! matching, and the winner over all paths.
//!
//! In all loops r7 holds P1, r9 the cost of a jump, r10 P2, each in every byte, and r6 the least path costs so
//! far.
//!
//! Halves of words hold keys: the sum of path costs, and in the lower bits the index of the disparity. The
//! least key is that of the first disparity with the least sum.
#![allow(unsafe_code)]

use super::{
    fuse::Costs,
    instruction::{if_not_less, splat, splat_half},
};
use crate::{
    SemiGlobalParams,
    kernel::bytes::{Divisor, Slot, Step},
};

/// The largest shift of [`by_power_of_two`]: a quotient's bits do not leave their half to the left.
pub(super) const MOST_SHIFT: u32 = 8;

/// The costs of four disparities from two words of sums, in place of the first.
macro_rules! shift_word {
    ($even:literal, $odd:literal) => {
        instructions! {
            uqadd16 $even, $even, "{saturate}";
            uqadd16 $odd, $odd, "{saturate}";
            lsr $even, $even, "{right}";
            lsl $odd, $odd, "{left}";
            sel $even, $odd, $even;
            bic $even, $even, "#0x80808080";
        }
    };
}

/// Divides by `2^shift`.
///
/// # Safety
/// `quotients` has room for all of `sums`, which are a multiple of `UNROLLED`, not 0. The shift is at most
/// [`MOST_SHIFT`].
#[inline(always)]
pub(super) unsafe fn by_power_of_two<const UNROLLED: usize>(shift: u32, sums: &[Costs], quotients: *mut u8) {
    // Makes a sum saturate if its quotient is above 127. The seven bits of the quotient stay as they are if it
    // does not, and are all set if it does. The bits above them are set either way.
    let saturate = splat_half((0x1_0000 - (128 << shift)) as u16);
    // SAFETY: reads all sums, and writes as many quotients. Every register that changes is an output.
    unsafe {
        asm_up_to!(400 bytes,
            // From here on, `sel` takes every other byte from its first operand.
            "mov r0, #0xff00ff00",
            "uadd8 r0, r0, r0",
            "2:",
            ".rept {unrolled}",
            "ldm {sums}!, {{r0, r1, r2, r3}}",
            shift_word!("r0", "r1"),
            shift_word!("r2", "r3"),
            "str r0, [{quotients}], #4",
            "str r2, [{quotients}], #4",
            ".endr",
            "subs {n}, {n}, #{unrolled}",
            "bne 2b";
            sums = inout(reg) sums.as_ptr() => _,
            quotients = inout(reg) quotients => _,
            n = inout(reg) sums.len() => _,
            saturate = in(reg) saturate,
            right = in(reg) shift,
            left = in(reg) MOST_SHIFT - shift,
            out("r0") _, out("r1") _, out("r2") _, out("r3") _,
            unrolled = const UNROLLED,
            options(nostack),
        );
    }
}

/// Divides the sums of four disparities, in two words of halves, by any divisor.
#[inline(always)]
pub(super) fn four(divisor: Divisor, even: u32, odd: u32) -> u32 {
    let Divisor { shift, by_three } = divisor;
    let (mask, limit) = (splat_half(u16::MAX.checked_shr(shift).unwrap_or(0)), splat_half(Divisor::LIMIT.into()));
    let most = if by_three { splat_half(Divisor::MOST_THIRDS as u16) } else { limit };
    let [even, odd] = [even, odd].map(|sums| {
        let shifted = sums.checked_shr(shift).unwrap_or(0) & mask;
        let shifted = if_not_less(shifted, most, most, shifted);
        // Products by 171 fit in a half.
        if by_three { (shifted * 171) >> 9 & limit } else { shifted }
    });
    even | odd << 8
}

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

/// The most vectors for whose disparities a key has bits.
pub(super) const MOST_VECTORS: usize = 4;

/// Bits of an index.
pub(super) const INDEX_BITS: u32 = (8 * MOST_VECTORS).ilog2();

// The sums of five paths fit in the other bits.
const _: () = assert!(SemiGlobalParams::PATHS == 5 && (5 * 255 + 255 + 1) << INDEX_BITS <= 1 << 16);

/// The sum and the index of a key.
#[inline(always)]
pub(super) fn unpack(key: u16) -> (u16, usize) {
    (key >> INDEX_BITS, usize::from(key % (1 << INDEX_BITS)))
}

/// Begins the search: no key is the least as yet.
macro_rules! start_keys {
    () => {
        "
        mov r9, #0x00020000
        mvn r8, #0
        mvn r10, #0x00010001
        "
    };
}

/// Lowers the least keys to those of four disparities: of the even ones in r8, and of the odd ones in r10, as if
/// each were the one before. r9 has the indices of the even ones.
macro_rules! lower_keys {
    ($costs:literal, $excess:literal) => {
        instructions! {
            uxtb16 "r4", $costs;
            uxtb16 $costs, $costs, "ror #8";
            add "r4", "r4", "r4", "lsl #2";
            add $costs, $costs, $costs, "lsl #2";
            uxtab16 "r4", "r4", $excess;
            uxtab16 $costs, $costs, $excess, "ror #8";
            add "r4", "r9", "r4", "lsl #{index_bits}";
            add $costs, "r9", $costs, "lsl #{index_bits}";
            add "r9", "r9", "#0x00040004";
            usub16 "r5", "r8", "r4";
            sel "r8", "r4", "r8";
            usub16 "r5", "r10", $costs;
            sel "r10", $costs, "r10";
        }
    };
}

/// The least key in the lower half of r8.
macro_rules! end_keys {
    () => {
        "
        add r10, r10, #0x00010001
        usub16 r0, r10, r8
        sel r8, r8, r10
        ror r0, r8, #16
        usub16 r1, r0, r8
        sel r8, r8, r0
        "
    };
}

/// The least key.
///
/// # Safety
/// There are as many costs as excess, at least one vector and at most [`MOST_VECTORS`].
#[inline(always)]
pub(super) unsafe fn least_key(costs: &[[u8; 8]], excess: &[[u8; 8]]) -> u16 {
    let key: u32;
    // SAFETY: reads all of both. Every register that changes is an output.
    unsafe {
        asm_up_to!(200 bytes,
            start_keys!(),
            "2:",
            "ldr r0, [{costs}], #4",
            "ldr r2, [{excess}], #4",
            lower_keys!("r0", "r2"),
            "subs {n}, {n}, #1",
            "bne 2b",
            end_keys!();
            costs = inout(reg) costs.as_ptr() => _,
            excess = inout(reg) excess.as_ptr() => _,
            n = inout(reg) 2 * costs.len() => _,
            out("r0") _, out("r1") _, out("r2") _, out("r4") _, out("r5") _,
            out("r8") key, out("r9") _, out("r10") _,
            index_bits = const INDEX_BITS,
            options(nostack, readonly),
        );
    }
    key as u16
}
