//! Paths through many pixels of 32 disparities, in the DSP extension.
#![allow(unsafe_code)]

use super::{
    instruction::splat,
    pixel::{INDEX_BITS, MOST_VECTORS},
};
use crate::kernel::bytes::Slot;

/// Disparities of a pixel: eight words.
pub(super) const DEPTH: usize = 32;

/// Bytes of a slot.
pub(super) const STRIDE: usize = Slot::bytes(DEPTH);

const _: () = assert!(DEPTH == 8 * MOST_VECTORS);

/// Extends a path by the four disparities at `\w + $word`, from the slot at r11 to the one `$to` bytes from there,
/// which may be the same.
///
/// r1 holds the path costs of the disparities below. Those of the next word are loaded before this one is stored,
/// which may overwrite one of them.
macro_rules! path_word {
    ($word:literal, $to:literal, $($registers:literal),+) => {
        concat!(
            path_costs!(
                concat!("[r11, #({lead} + 1 + \\w + ", $word, ")]"),
                concat!("[r11, #({lead} + \\w + ", $word, ")]"),
                $($registers),+
            ),
            "ldr r1, [r11, #({lead} + 3 + \\w + ", $word, ")]
            str r0, [r11, #({lead} + \\w + ", $word, " + ", $to, ")]\n",
            lower_least!(),
        )
    };
}

/// The path along the line, in place. Its slot is at `[sp, #8]`, the least cost in `[sp, #4]`, the address of P2 in
/// `[sp]`.
macro_rules! extend_along {
    ($($words:expr),+) => {
        concat!(
            "ldrd r1, r0, [sp]
            ldrb r11, [r1], #1
            str r1, [sp]
            mov r1, #0x01010101
            mul r1, r11, r1
            ldr r11, [sp, #8]
            ",
            start_pixel!(),
            "ldr r1, [r11, #({lead} - 1)]
            .irp w, 0, 8, 16, 24\n",
            $($words,)+
            ".endr\n",
            least_of_four!("ror"),
            "str r6, [sp, #4]\n",
        )
    };
}

/// Adds what a path adds to the excess.
macro_rules! add_words {
    ($to:literal) => {
        concat!(
            "ldrd r3, r4, [r12, #\\w]
            ldrd r5, r8, [lr, #\\w]
            ",
            path_word!("0", $to, "r3", "r1", "r5"),
            path_word!("4", $to, "r4", "r1", "r8"),
            "strd r5, r8, [lr, #\\w]\n",
        )
    };
}

/// Extends the paths from the left and from above through pixels, which have a penalty P2 for each of them.
///
/// # Safety
/// There are [`DEPTH`] costs and as much excess for each `p2`, at least one, aligned to words. `along` is a slot,
/// and `from_above` are a slot more than pixels.
#[inline(always)]
pub(super) unsafe fn forward(
    p1: u8,
    p2: &[[u8; 4]],
    costs: &[u8],
    excess: &mut [u8],
    along: &mut [u8],
    from_above: [&mut [u8]; 3],
) {
    let least_along = along.first().copied().unwrap_or(u8::MAX);
    let [a, b, c] = from_above.map(|slots| slots.as_mut_ptr());
    let excess = excess.as_mut_ptr_range();
    let least: u32;
    // SAFETY: for each pixel, reads its costs, writes as much excess, and reads and writes the slots. Every
    // register that changes is an output or restored from the stack.
    unsafe {
        asm_up_to!(2600 bytes,
            // The code takes all registers. The stack holds the address of P2; the least cost along the line;
            // that path's slot; the slots from above; r6 and r7, which are reserved for the compiler; and the end of the
            // excess.
            "push {{r0, r1, r2, r3, r4, r5, r6, r7, r8}}",
            "mov r7, r9",
            "2:",
            extend_along!(
                "ldrd r3, r4, [r12, #\\w]\n",
                path_word!("0", "0", "r3", "r5"),
                path_word!("4", "0", "r4", "r8"),
                "strd r5, r8, [lr, #\\w]\n"
            ),
            ".irp slots, 12, 16, 20",
            "ldr r11, [sp, #\\slots]",
            "ldrb r0, [r11, #{stride}]!",
            "mov r1, #0x01010101",
            "mul r0, r0, r1",
            "ldr r3, [sp]",
            "ldrb r4, [r3], #1",
            "str r3, [sp]",
            "mul r1, r4, r1",
            start_pixel!(),
            "ldr r1, [r11, #({lead} - 1)]",
            ".irp w, 0, 8, 16, 24",
            add_words!("-{stride}"),
            ".endr",
            least_of_four!("lsr"),
            "strb r6, [r11, #-{stride}]",
            "str r11, [sp, #\\slots]",
            ".endr",
            "ldr r0, [sp, #32]",
            "add r12, r12, #{depth}",
            "add lr, lr, #{depth}",
            "cmp lr, r0",
            "bne 2b",
            "pop {{r0, r1, r2, r3, r4, r5, r6, r7, r8}}";
            inout("r0") p2.as_ptr() => _,
            inout("r1") splat(least_along) => least,
            in("r2") along.as_mut_ptr(),
            inout("r3") a => _,
            inout("r4") b => _,
            inout("r5") c => _,
            in("r8") excess.end,
            inout("r9") splat(p1) => _,
            out("r10") _,
            out("r11") _,
            inout("r12") costs.as_ptr() => _,
            inout("lr") excess.start => _,
            lead = const Slot::LEAD,
            stride = const STRIDE,
            depth = const DEPTH,
        );
    }
    along.iter_mut().take(1).for_each(|slot| *slot = least as u8);
}

/// Extends the path from the right through pixels, the last first, and writes the [keys](super::winner) of
/// their winners. There is a penalty P2 for each pixel, that of the last first.
///
/// # Safety
/// There are [`DEPTH`] costs and excess for each key and `p2`, at least one, aligned to words. `along` is a slot.
#[inline(always)]
pub(super) unsafe fn backward(p1: u8, p2: &[u8], costs: &[u8], excess: &mut [u8], along: &mut [u8], keys: &mut [u16]) {
    let least_along = along.first().copied().unwrap_or(u8::MAX);
    let (costs, excess, keys) = (costs.as_ptr_range(), excess.as_mut_ptr_range(), keys.as_mut_ptr_range());
    let least: u32;
    // SAFETY: for each key, reads the costs of a pixel, reads and writes as much excess and the slot. Every
    // register that changes is an output or restored from the stack.
    unsafe {
        asm_up_to!(1400 bytes,
            // The code takes all registers. The stack holds the address of P2; the least cost along the line;
            // that path's slot; the last key; the first excess; and r6 and r7, which are reserved for the compiler.
            "push {{r0, r1, r2, r3, r4, r6, r7}}",
            "mov r7, r5",
            "2:",
            "sub r12, r12, #{depth}",
            "sub lr, lr, #{depth}",
            extend_along!(add_words!("0")),
            start_keys!(),
            ".irp w, 0, 8, 16, 24",
            "ldrd r0, r1, [r12, #\\w]",
            "ldrd r2, r3, [lr, #\\w]",
            lower_keys!("r0", "r2"),
            lower_keys!("r1", "r3"),
            ".endr",
            end_keys!(),
            "ldrd r0, r1, [sp, #12]",
            "strh r8, [r0, #-2]!",
            "str r0, [sp, #12]",
            "cmp lr, r1",
            "bne 2b",
            "pop {{r0, r1, r2, r3, r4, r6, r7}}";
            inout("r0") p2.as_ptr() => _,
            inout("r1") splat(least_along) => least,
            in("r2") along.as_mut_ptr(),
            inout("r3") keys.end => _,
            in("r4") excess.start,
            inout("r5") splat(p1) => _,
            out("r8") _,
            out("r9") _,
            out("r10") _,
            out("r11") _,
            inout("r12") costs.end => _,
            inout("lr") excess.end => _,
            lead = const Slot::LEAD,
            depth = const DEPTH,
            index_bits = const INDEX_BITS,
        );
    }
    along.iter_mut().take(1).for_each(|slot| *slot = least as u8);
}
