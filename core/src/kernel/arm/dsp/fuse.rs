//! Fused costs in the DSP extension, with the least of all.
//!
//! Every function takes the block sums of a pixel, `V` views in each vector, and returns the least fused cost
//! in each half of a word; any word if `LEAST` is not set.
#![allow(unsafe_code)]

use super::isa::VECTOR;

/// A vector of 16-bit costs.
pub(super) type Costs = [u32; 4];

/// The lesser halves of two words, in place of the first.
macro_rules! min {
    ($a:literal, $b:literal) => {
        instructions! {
            usub16 "{t}", $a, $b;
            sel $a, $b, $a;
        }
    };
    ([$a:literal, $b:literal, $c:literal, $d:literal], [$e:literal, $f:literal, $g:literal, $h:literal]) => {
        concat!(min!($a, $e), min!($b, $f), min!($c, $g), min!($d, $h))
    };
}

/// Stores the fused costs of a vector, and lowers the least of all if it is asked for.
macro_rules! store_and_lower {
    () => {
        concat!(
            "stm {fused}!, {{r0, r1, r2, r3}}\n",
            ".if {lower}\n",
            min!("{least}", "r0"),
            min!("{least}", "r1"),
            min!("{least}", "r2"),
            min!("{least}", "r3"),
            ".endif\n",
        )
    };
}

/// Fuses the costs of four views, a word of two lanes each, by the heuristic rule, in place of the first.
macro_rules! heuristic {
    ($a:literal, $b:literal, $c:literal, $d:literal) => {
        instructions! {
            // Sort both pairs: (t, a) and (b, c).
            usub16 "{t}", $a, $b;
            sel "{t}", $b, $a;
            sel $a, $a, $b;
            usub16 $b, $c, $d;
            sel $b, $d, $c;
            sel $c, $c, $d;
            // The least of all in d. The second and the third lie between the greater minimum, b, and the
            // lesser maximum, a.
            usub16 $d, "{t}", $b;
            sel $d, $b, "{t}";
            sel $b, "{t}", $b;
            usub16 "{t}", $a, $c;
            sel $a, $c, $a;
            // The second in c and the third in a.
            usub16 "{t}", $b, $a;
            sel $c, $a, $b;
            sel $a, $b, $a;
            // The sum of two in d, of three in b, and three times the second in t; then three times the sum of two,
            // and twice the sum of three. A Cortex-M7 takes a saturated sum a cycle later.
            uqadd16 $d, $d, $c;
            uqadd16 "{t}", $c, $c;
            uqadd16 $b, $d, $a;
            uqadd16 "{t}", "{t}", $c;
            uqadd16 $c, $d, $d;
            uqadd16 $b, $b, $b;
            uqadd16 $d, $c, $d;
            usub16 "{t}", "{t}", $a;
            sel $a, $b, $d;
        }
    };
}

/// Raises the costs of a view to its masks, word by word, and goes on to the view's next masks.
macro_rules! mask {
    ($a:literal, $b:literal, $c:literal, $d:literal) => {
        instructions! {
            ldr "{t}", "[{mask}]", "#4";
            orr $a, $a, "{t}";
            ldr "{t}", "[{mask}]", "#4";
            orr $b, $b, "{t}";
            ldr "{t}", "[{mask}]", "#4";
            orr $c, $c, "{t}";
            ldr "{t}", "[{mask}]", "#{next}";
            orr $d, $d, "{t}";
        }
    };
}

/// The minimum of one to four views.
///
/// # Safety
/// There are as many blocks as fused costs: a multiple of `UNROLLED`, not 0.
#[inline(always)]
pub(super) unsafe fn min<const V: usize, const UNROLLED: usize, const LEAST: bool>(
    blocks: *const [Costs; V],
    fused: &mut [Costs],
) -> u32 {
    let mut least = u32::MAX;
    // SAFETY: reads so many blocks and writes as many fused costs. Every register that changes is an output.
    unsafe {
        asm_up_to!(600 bytes,
            "2:",
            ".rept {unrolled}",
            ".if {views} == 1",
            "ldm {block}!, {{r0, r1, r2, r3}}",
            ".else",
            "ldm {block}!, {{r0, r1, r2, r3, r4, r5, r8, r9}}",
            min!(["r0", "r1", "r2", "r3"], ["r4", "r5", "r8", "r9"]),
            ".rept {views} - 2",
            "ldm {block}!, {{r4, r5, r8, r9}}",
            min!(["r0", "r1", "r2", "r3"], ["r4", "r5", "r8", "r9"]),
            ".endr",
            ".endif",
            store_and_lower!(),
            ".endr",
            "subs {n}, {n}, #{unrolled}",
            "bne 2b";
            n = inout(reg) fused.len() => _,
            block = inout(reg) blocks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            t = out(reg) _,
            out("r0") _, out("r1") _, out("r2") _, out("r3") _, out("r4") _, out("r5") _, out("r8") _, out("r9") _,
            views = const V,
            unrolled = const UNROLLED,
            lower = const LEAST as u8,
            options(nostack),
        );
    }
    least
}

/// The heuristic rule over four views.
///
/// # Safety
/// There are as many blocks as fused costs, not 0.
#[inline(always)]
pub(super) unsafe fn heuristic_of_four(blocks: *const [Costs; 4], fused: &mut [Costs]) -> u32 {
    let mut least = u32::MAX;
    // SAFETY: reads as many blocks as it writes fused costs. Every register that changes is an output.
    unsafe {
        asm_up_to!(600 bytes,
            "2:",
            ".irp next, 8, 56",
            "ldrd r2, r3, [{block}, #16]",
            "ldrd r4, r5, [{block}, #32]",
            "ldrd r8, r9, [{block}, #48]",
            "ldrd r0, r1, [{block}], #\\next",
            heuristic!("r0", "r2", "r4", "r8"),
            heuristic!("r1", "r3", "r5", "r9"),
            "strd r0, r1, [{fused}], #8",
            min!("{least}", "r0"),
            min!("{least}", "r1"),
            ".endr",
            "subs {n}, {n}, #1",
            "bne 2b";
            n = inout(reg) fused.len() => _,
            block = inout(reg) blocks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            t = out(reg) _,
            out("r0") _, out("r1") _, out("r2") _, out("r3") _, out("r4") _, out("r5") _, out("r8") _, out("r9") _,
            options(nostack),
        );
    }
    least
}

/// The heuristic rule over four masked views.
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0.
#[inline(always)]
pub(super) unsafe fn heuristic_of_four_masked(blocks: *const [Costs; 4], masks: *const [Costs; 4], fused: &mut [Costs]) -> u32 {
    let mut least = u32::MAX;
    // SAFETY: reads as many blocks and masks as it writes fused costs. Every register that changes is an
    // output.
    unsafe {
        asm_up_to!(800 bytes,
            "2:",
            // Word by word, for want of registers.
            ".irp next, 4, 4, 4, 52",
            "ldr {b}, [{block}, #16]",
            "ldr {t}, [{mask}, #16]",
            "orr {b}, {b}, {t}",
            "ldr {c}, [{block}, #32]",
            "ldr {t}, [{mask}, #32]",
            "orr {c}, {c}, {t}",
            "ldr {d}, [{block}, #48]",
            "ldr {t}, [{mask}, #48]",
            "orr {d}, {d}, {t}",
            "ldr {a}, [{block}], #\\next",
            "ldr {t}, [{mask}], #\\next",
            "orr {a}, {a}, {t}",
            heuristic!("{a}", "{b}", "{c}", "{d}"),
            "str {a}, [{fused}], #4",
            min!("{least}", "{a}"),
            ".endr",
            "subs {n}, {n}, #1",
            "bne 2b";
            n = inout(reg) fused.len() => _,
            block = inout(reg) blocks => _,
            mask = inout(reg) masks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            a = out(reg) _,
            b = out(reg) _,
            c = out(reg) _,
            d = out(reg) _,
            t = out(reg) _,
            options(nostack),
        );
    }
    least
}

/// The minimum of masked views.
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0.
#[inline(always)]
pub(super) unsafe fn min_masked<const V: usize>(blocks: *const [Costs; V], masks: *const [Costs; V], fused: &mut [Costs]) -> u32 {
    let mut least = u32::MAX;
    // SAFETY: reads as many blocks and masks as it writes fused costs. Every register that changes is an
    // output.
    unsafe {
        asm_up_to!(400 bytes,
            "2:",
            ".irp half, 0, 8",
            "ldrd {a}, {b}, [{block}, #\\half]",
            "ldrd {c}, {d}, [{mask}, #\\half]",
            "orr {a}, {a}, {c}",
            "orr {b}, {b}, {d}",
            ".irp view, 16, 32, 48",
            ".if \\view < {stride}",
            "ldrd {c}, {d}, [{block}, #(\\view + \\half)]",
            "ldrd {e}, {t}, [{mask}, #(\\view + \\half)]",
            "orr {c}, {c}, {e}",
            "orr {d}, {d}, {t}",
            min!("{a}", "{c}"),
            min!("{b}", "{d}"),
            ".endif",
            ".endr",
            "strd {a}, {b}, [{fused}], #8",
            min!("{least}", "{a}"),
            min!("{least}", "{b}"),
            ".endr",
            "add {block}, {block}, #{stride}",
            "add {mask}, {mask}, #{stride}",
            "subs {n}, {n}, #1",
            "bne 2b";
            n = inout(reg) fused.len() => _,
            block = inout(reg) blocks => _,
            mask = inout(reg) masks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            a = out(reg) _,
            b = out(reg) _,
            c = out(reg) _,
            d = out(reg) _,
            e = out(reg) _,
            t = out(reg) _,
            stride = const V * VECTOR,
            options(nostack),
        );
    }
    least
}

/// The minimum of views of which only view `K` is masked.
///
/// # Safety
/// There are four blocks, masks and fused costs, and `K < V`.
#[inline(always)]
pub(super) unsafe fn min_with_one_masked<const V: usize, const K: usize, const LEAST: bool>(
    blocks: *const [Costs; V],
    masks: *const [Costs; V],
    fused: &mut [Costs],
) -> u32 {
    let mut least = u32::MAX;
    // SAFETY: reads four blocks and masks and writes four fused costs. Every register that changes is an
    // output.
    unsafe {
        asm_up_to!(800 bytes,
            ".rept 4",
            "ldm {block}!, {{r0, r1, r2, r3}}",
            ".if !{masked}",
            mask!("r0", "r1", "r2", "r3"),
            ".endif",
            ".irp view, 1, 2, 3",
            ".if \\view < {views}",
            "ldm {block}!, {{r4, r5, r8, r9}}",
            ".if \\view == {masked}",
            mask!("r4", "r5", "r8", "r9"),
            ".endif",
            min!(["r0", "r1", "r2", "r3"], ["r4", "r5", "r8", "r9"]),
            ".endif",
            ".endr",
            store_and_lower!(),
            ".endr";
            block = inout(reg) blocks => _,
            mask = inout(reg) masks.cast::<Costs>().wrapping_add(K) => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            t = out(reg) _,
            out("r0") _, out("r1") _, out("r2") _, out("r3") _, out("r4") _, out("r5") _, out("r8") _, out("r9") _,
            views = const V,
            masked = const K,
            lower = const LEAST as u8,
            // From the last word of the view's masks in a vector to the first in the next vector.
            next = const V * VECTOR - 12,
            options(nostack),
        );
    }
    least
}
