//! Single instructions as functions of words.
#![allow(unsafe_code)]

use core::arch::asm;

/// A function that is one instruction: of this name, with this suffix to its last operand.
macro_rules! instruction {
    ($name:ident $(, $suffix:literal)?) => {
        instruction!($name, stringify!($name) $(, $suffix)?);
    };
    ($name:ident, $mnemonic:expr $(, $suffix:literal)?) => {
        #[inline(always)]
        pub(super) fn $name(a: u32, b: u32) -> u32 {
            let result;
            // SAFETY: an instruction is only assembled for a processor that has it, and these work on registers alone.
            unsafe {
                asm!(concat!($mnemonic, " {}, {}, {}" $(, $suffix)?), lateout(reg) result, in(reg) a, in(reg) b,
                     options(pure, nomem, nostack));
            }
            result
        }
    };
}

instruction!(uqadd8);
instruction!(uqsub8);
instruction!(uadd16);
instruction!(usub16);
instruction!(uqadd16);
instruction!(uxtab16);
instruction!(uxtab16_high, "uxtab16", ", ror #8");

/// A function that is one instruction of this name, with this suffix to its operand.
macro_rules! extension {
    ($name:ident, $mnemonic:literal, $suffix:literal) => {
        #[inline(always)]
        pub(super) fn $name(a: u32) -> u32 {
            let result;
            // SAFETY: an instruction is only assembled for a processor that has it, and these work on registers alone.
            unsafe {
                asm!(concat!($mnemonic, " {}, {}", $suffix), lateout(reg) result, in(reg) a, options(pure, nomem, nostack));
            }
            result
        }
    };
}

extension!(uxtb16, "uxtb16", "");
extension!(uxtb16_high, "uxtb16", ", ror #8");
extension!(sxtb16, "sxtb16", "");
extension!(sxtb16_high, "sxtb16", ", ror #8");

/// A sum, and the products of two signed halves.
#[inline(always)]
pub(super) fn smlad(a: u32, b: u32, sum: i32) -> i32 {
    let result;
    // SAFETY: an instruction is only assembled for a processor that has it, and these work on registers alone.
    unsafe {
        asm!("smlad {}, {}, {}, {}", lateout(reg) result, in(reg) a, in(reg) b, in(reg) sum, options(pure, nomem, nostack));
    }
    result
}

/// `then` in the halves where `a >= b`, and `otherwise` elsewhere. Two instructions in one block, since flags
/// connect them.
#[inline(always)]
pub(super) fn if_not_less(a: u32, b: u32, then: u32, otherwise: u32) -> u32 {
    let result;
    // SAFETY: an instruction is only assembled for a processor that has it, and these work on registers alone.
    unsafe {
        asm!("usub16 {result}, {a}, {b}", "sel {result}, {then}, {otherwise}", result = out(reg) result,
             a = in(reg) a, b = in(reg) b, then = in(reg) then, otherwise = in(reg) otherwise, options(pure, nomem, nostack));
    }
    result
}

/// Adds 1 to the halves of `counts` where `value - least`, which wraps, is at most `span`.
///
/// The compiler has to believe that it works on memory: otherwise it loads many values ahead, more than there are registers.
#[inline(always)]
pub(super) fn count_within(value: u32, least: u32, span: u32, mut counts: u32) -> u32 {
    // SAFETY: an instruction is only assembled for a processor that has it, and these work on registers alone.
    unsafe {
        asm!("usub16 {excess}, {value}, {least}", "usub16 {excess}, {span}, {excess}", "sel {excess}, {ones}, {zero}",
             "add {counts}, {counts}, {excess}", excess = out(reg) _, value = in(reg) value, least = in(reg) least,
             span = in(reg) span, ones = in(reg) splat_half(1), zero = in(reg) 0, counts = inout(reg) counts, options(nostack));
    }
    counts
}

/// `then` in the bytes where `a >= b`, and `otherwise` elsewhere.
#[inline(always)]
pub(super) fn if_byte_not_less(a: u32, b: u32, then: u32, otherwise: u32) -> u32 {
    let result;
    // SAFETY: an instruction is only assembled for a processor that has it, and these work on registers alone.
    unsafe {
        asm!("usub8 {result}, {a}, {b}", "sel {result}, {then}, {otherwise}", result = out(reg) result,
             a = in(reg) a, b = in(reg) b, then = in(reg) then, otherwise = in(reg) otherwise, options(pure, nomem, nostack));
    }
    result
}

/// A byte four times.
#[inline(always)]
pub(super) fn splat(byte: u8) -> u32 {
    u32::from(byte) * 0x0101_0101
}

/// A half twice.
#[inline(always)]
pub(super) fn splat_half(half: u16) -> u32 {
    u32::from(half) * 0x1_0001
}

/// Samples four by four.
#[inline(always)]
pub(super) fn words(samples: &[u8; 8]) -> [u32; 2] {
    let [a, b, c, d, e, f, g, h] = *samples;
    [u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h])]
}

/// The absolute differences of bytes: one of the two differences saturates at 0.
#[inline(always)]
pub(super) fn differences(a: u32, b: u32) -> u32 {
    uqsub8(a, b) | uqsub8(b, a)
}
