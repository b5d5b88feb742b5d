//! Fused sums become 8-bit costs in the DSP extension.
#![allow(unsafe_code)]

use super::{
    fuse::Costs,
    instruction::{if_not_less, splat_half},
};
use crate::kernel::bytes::Divisor;

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
