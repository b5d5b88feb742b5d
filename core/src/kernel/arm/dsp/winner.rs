//! The winner over all paths in the DSP extension.
//!
//! Halves of words hold keys: the sum of path costs, and in the lower bits the index of the disparity. The
//! least key is that of the first disparity with the least sum.
#![allow(unsafe_code)]

use crate::SemiGlobalParams;

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
