//! Fused costs in the DSP extension, with the least of all.
//!
//! Every function takes the block sums of a pixel, `V` views in each vector, and returns the least fused cost
//! in each half of a word; any word if `LEAST` is not set.
#![allow(unsafe_code)]

use super::VECTOR;

/// A vector of 16-bit costs.
pub(super) type Costs = [u32; 4];

/// The lesser halves of two words, in place of the first.
macro_rules! min {
    ($a:literal, $b:literal) => {
        min!($a, $b, "{t}")
    };
    ($a:literal, $b:literal, $t:literal) => {
        instructions! {
            usub16 $t, $a, $b;
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

/// Sorts the least three of four words, in each half: the least of all then in `$d`, the second in `$c` and the third in `$a`.
/// `$b` and `$t` are free.
macro_rules! sort_least_three {
    ($a:literal, $b:literal, $c:literal, $d:literal, $t:literal) => {
        instructions! {
            // Sort both pairs: (t, a) and (b, c).
            usub16 $t, $a, $b;
            sel $t, $b, $a;
            sel $a, $a, $b;
            usub16 $b, $c, $d;
            sel $b, $d, $c;
            sel $c, $c, $d;
            // The second and the third lie between the greater minimum, b, and the lesser maximum, a.
            usub16 $d, $t, $b;
            sel $d, $b, $t;
            sel $b, $t, $b;
            usub16 $t, $a, $c;
            sel $a, $c, $a;
            usub16 $t, $b, $a;
            sel $c, $a, $b;
            sel $a, $b, $a;
        }
    };
}

/// Fuses the costs of four views, a word of two lanes each, by the heuristic rule, in place of the first.
macro_rules! heuristic {
    ($a:literal, $b:literal, $c:literal, $d:literal) => {
        concat!(
            sort_least_three!($a, $b, $c, $d, "{t}"),
            instructions! {
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
        )
    };
}

/// The lesser halves of two words in `$t`, and the greater ones in place of the first. The second is free.
macro_rules! exchange {
    ($a:literal, $b:literal, $t:literal) => {
        instructions! {
            usub16 $t, $a, $b;
            sel $t, $b, $a;
            sel $a, $a, $b;
        }
    };
}

/// Sorts four words, in each half: `$d` then has the least, and `$c`, `$t` and `$a` follow. `$b` is free.
macro_rules! sort_four {
    ($a:literal, $b:literal, $c:literal, $d:literal, $t:literal) => {
        concat!(exchange!($a, $b, $t), exchange!($c, $d, $b), exchange!($t, $b, $d), exchange!($a, $c, $b), exchange!($t, $b, $c))
    };
}

/// The least four of eight words, in each half: in r3, r2, r10 and r0. r1, r4, r5, r8 and r9 are free.
///
/// Of two ascending sequences of four, they are the lesser of each cost in one and its counterpart in the other, counted
/// from the end.
macro_rules! least_four {
    () => {
        concat!(
            sort_four!("r0", "r1", "r2", "r3", "r10"),
            sort_four!("r4", "r5", "r8", "r9", "r1"),
            "usub16 r5, r3, r4
            sel r3, r4, r3
            usub16 r5, r2, r1
            sel r2, r1, r2
            usub16 r5, r10, r8
            sel r10, r8, r10
            usub16 r5, r0, r9
            sel r0, r9, r0
            "
        )
    };
}

/// Lowers the least of all, in lr, to a word. r5 is free.
macro_rules! lower_to {
    ($cost:literal) => {
        instructions! {
            usub16 "r5", "lr", $cost;
            sel "lr", $cost, "lr";
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

/// [`asm_up_to!`] for a loop over the blocks of a pixel, with the operands that all of them have: `{n}` blocks from `{block}`
/// on, their masks from `{mask}` on, the costs to be written from `{fused}` on, and the `{least}` of them. Those of one
/// loop alone follow.
macro_rules! fuse_blocks {
    ([$blocks:ident $(, $masks:ident)? -> $fused:ident, $least:ident] $bytes:literal bytes, $($template:expr),+; $($operands:tt)*) => {
        asm_up_to!($bytes bytes, $($template),+;
            n = inout(reg) $fused.len() => _,
            block = inout(reg) $blocks => _,
            $(mask = inout(reg) $masks => _,)?
            fused = inout(reg) $fused.as_mut_ptr() => _,
            least = inout(reg) $least,
            $($operands)*
        )
    };
}

/// The minimum of views.
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
        fuse_blocks!([blocks -> fused, least] 600 bytes,
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

/// Adds four words to four others, in place of the first.
macro_rules! add {
    ([$a:literal, $b:literal, $c:literal, $d:literal], [$e:literal, $f:literal, $g:literal, $h:literal]) => {
        instructions! {
            uqadd16 $a, $a, $e;
            uqadd16 $b, $b, $f;
            uqadd16 $c, $c, $g;
            uqadd16 $d, $d, $h;
        }
    };
}

/// The sum of two to four views.
///
/// # Safety
/// There are as many blocks as fused costs, not 0.
#[inline(always)]
pub(super) unsafe fn sum<const V: usize>(blocks: *const [Costs; V], fused: &mut [Costs]) -> u32 {
    let mut least = u32::MAX;
    // SAFETY: reads as many blocks as it writes fused costs. Every register that changes is an output.
    unsafe {
        fuse_blocks!([blocks -> fused, least] 200 bytes,
            "2:",
            "ldm {block}!, {{r0, r1, r2, r3, r4, r5, r8, r9}}",
            add!(["r0", "r1", "r2", "r3"], ["r4", "r5", "r8", "r9"]),
            ".rept {views} - 2",
            "ldm {block}!, {{r4, r5, r8, r9}}",
            add!(["r0", "r1", "r2", "r3"], ["r4", "r5", "r8", "r9"]),
            ".endr",
            store_and_lower!(),
            "subs {n}, {n}, #1",
            "bne 2b";
            t = out(reg) _,
            out("r0") _, out("r1") _, out("r2") _, out("r3") _, out("r4") _, out("r5") _, out("r8") _, out("r9") _,
            views = const V,
            lower = const 1,
            options(nostack),
        );
    }
    least
}

/// Loads a word of the view that is masked without what its masks hide.
macro_rules! load_shown {
    ($to:literal, $place:literal) => {
        concat!(
            "ldr ",
            $to,
            ", [{block}], #4
            ldr r5, [{mask}",
            $place,
            "]
            bic ",
            $to,
            ", ",
            $to,
            ", r5
            "
        )
    };
}

/// Multiplies a sum by as much as fewer views are in it, and goes on to the view's next masks.
macro_rules! scale_available {
    ($sum:literal, $next:literal) => {
        concat!(
            "ldr r5, [{mask}], #",
            $next,
            "
            and r5, r5, ",
            $sum,
            "
            .if {views} > 2
            uqadd16 r4, ",
            $sum,
            ", ",
            $sum,
            "
            .if {views} == 4
            uqadd16 ",
            $sum,
            ", ",
            $sum,
            ", r4
            .else
            uqadd16 r5, r5, r5
            uqadd16 ",
            $sum,
            ", r4, r4
            .endif
            .endif
            uqadd16 ",
            $sum,
            ", ",
            $sum,
            ", r5
            "
        )
    };
}

/// The sum of two to four views of which view `K` is masked, on the scale of
/// [`Rule::fuse_available`](crate::kernel::rule::Rule::fuse_available).
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0, and `K < V`.
#[inline(always)]
pub(super) unsafe fn sum_with_one_masked<const V: usize, const K: usize>(
    blocks: *const [Costs; V],
    masks: *const [Costs; V],
    fused: &mut [Costs],
) -> u32 {
    let mut least = u32::MAX;
    let masks = masks.cast::<Costs>().wrapping_add(K);
    // SAFETY: reads as many blocks and masks as it writes fused costs. Every register that changes is an output.
    unsafe {
        fuse_blocks!([blocks, masks -> fused, least] 400 bytes,
            "2:",
            ".if {masked}",
            "ldm {block}!, {{r0, r1, r2, r3}}",
            ".else",
            load_shown!("r0", ""),
            load_shown!("r1", ", #4"),
            load_shown!("r2", ", #8"),
            load_shown!("r3", ", #12"),
            ".endif",
            ".irp view, 1, 2, 3",
            ".if \\view < {views}",
            ".if \\view == {masked}",
            load_shown!("r4", ""),
            "uqadd16 r0, r0, r4",
            load_shown!("r4", ", #4"),
            "uqadd16 r1, r1, r4",
            load_shown!("r4", ", #8"),
            "uqadd16 r2, r2, r4",
            load_shown!("r4", ", #12"),
            "uqadd16 r3, r3, r4",
            ".else",
            "ldm {block}!, {{r4, r5, r8, r9}}",
            add!(["r0", "r1", "r2", "r3"], ["r4", "r5", "r8", "r9"]),
            ".endif",
            ".endif",
            ".endr",
            scale_available!("r0", "4"),
            scale_available!("r1", "4"),
            scale_available!("r2", "4"),
            scale_available!("r3", "{next}"),
            "stm {fused}!, {{r0, r1, r2, r3}}",
            min!("{least}", "r0", "r4"),
            min!("{least}", "r1", "r4"),
            min!("{least}", "r2", "r4"),
            min!("{least}", "r3", "r4"),
            "subs {n}, {n}, #1",
            "bne 2b";
            out("r0") _, out("r1") _, out("r2") _, out("r3") _, out("r4") _, out("r5") _, out("r8") _, out("r9") _,
            views = const V,
            masked = const K,
            // From the last word of the view's masks in a vector to the first in the next vector.
            next = const V * VECTOR - 12,
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
        fuse_blocks!([blocks -> fused, least] 600 bytes,
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
        fuse_blocks!([blocks, masks -> fused, least] 800 bytes,
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
        fuse_blocks!([blocks, masks -> fused, least] 700 bytes,
            "2:",
            ".irp half, 0, 8",
            "ldrd {a}, {b}, [{block}, #\\half]",
            "ldrd {c}, {d}, [{mask}, #\\half]",
            "orr {a}, {a}, {c}",
            "orr {b}, {b}, {d}",
            ".irp view, 16, 32, 48, 64, 80, 96, 112",
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

/// The sum of the least half of eight views.
///
/// # Safety
/// There are as many blocks as fused costs, not 0.
#[inline(always)]
pub(super) unsafe fn half_of_eight(blocks: *const [Costs; 8], fused: &mut [Costs]) -> u32 {
    let mut least = u32::MAX;
    // SAFETY: reads as many blocks as it writes fused costs. Every register that changes is an output or restored from
    // the stack.
    unsafe {
        asm_up_to!(900 bytes,
            // The number of vectors left is in r6, which is reserved for the compiler.
            "push {{r6}}",
            "mov r6, r0",
            "2:",
            ".irp next, 4, 4, 4, 116",
            "ldr r1, [r11, #16]",
            "ldr r2, [r11, #32]",
            "ldr r3, [r11, #48]",
            "ldr r4, [r11, #64]",
            "ldr r5, [r11, #80]",
            "ldr r8, [r11, #96]",
            "ldr r9, [r11, #112]",
            "ldr r0, [r11], #\\next",
            least_four!(),
            "uqadd16 r3, r3, r2",
            "uqadd16 r10, r10, r0",
            "uqadd16 r3, r3, r10",
            "str r3, [r12], #4",
            lower_to!("r3"),
            ".endr",
            "subs r6, r6, #1",
            "bne 2b",
            "pop {{r6}}";
            inout("r0") fused.len() => _,
            out("r1") _, out("r2") _, out("r3") _, out("r4") _, out("r5") _, out("r8") _, out("r9") _, out("r10") _,
            inout("r11") blocks => _,
            inout("r12") fused.as_mut_ptr() => _,
            inout("lr") least,
        );
    }
    least
}

/// Loads a word of a view's costs, raised to their mask, and counts the view in r7 if it is not hidden.
#[rustfmt::skip]
macro_rules! load_masked {
    ($cost:literal, $address:literal, $next:literal) => {
        concat!(
            "ldr ", $cost, ", [r11", $address, "]", $next, "\n",
            "ldr r10, [r6", $address, "]", $next, "\n",
            "uadd16 r7, r7, r10\n",
            "orr ", $cost, ", ", $cost, ", r10\n",
        )
    };
}

/// The mean of the least half of those of eight views that masks do not hide, on the scale of
/// [`Rule::fuse_available`](crate::kernel::rule::Rule::fuse_available).
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0.
#[inline(always)]
pub(super) unsafe fn half_of_eight_masked(blocks: *const [Costs; 8], masks: *const [Costs; 8], fused: &mut [Costs]) -> u32 {
    let mut least = u32::MAX;
    // SAFETY: reads as many blocks and masks as it writes fused costs. Every register that changes is an output or
    // restored from the stack.
    unsafe {
        asm_up_to!(600 bytes,
            // The number of words left is on the stack. The masks are in r6 and the number of views that are not hidden
            // in r7, which are reserved for the compiler.
            "push {{r0, r6, r7}}",
            "mov r6, r10",
            "2:",
            "mov r7, #0x00080008",
            load_masked!("r1", ", #16", ""),
            load_masked!("r2", ", #32", ""),
            load_masked!("r3", ", #48", ""),
            load_masked!("r4", ", #64", ""),
            load_masked!("r5", ", #80", ""),
            load_masked!("r8", ", #96", ""),
            load_masked!("r9", ", #112", ""),
            load_masked!("r0", "", ", #4"),
            least_four!(),
            // Sorted: r0, r1, r10, r3.
            exchange!("r3", "r10", "r1"),
            exchange!("r2", "r0", "r10"),
            exchange!("r1", "r10", "r0"),
            exchange!("r3", "r2", "r10"),
            // The sums of one to four, times 12, 6, 4 and 3.
            "uqadd16 r1, r0, r1",
            "uqadd16 r10, r1, r10",
            "uqadd16 r3, r10, r3",
            "uqadd16 r4, r3, r3",
            "uqadd16 r3, r4, r3",
            "uqadd16 r10, r10, r10",
            "uqadd16 r10, r10, r10",
            "uqadd16 r4, r1, r1",
            "uqadd16 r1, r4, r1",
            "uqadd16 r1, r1, r1",
            "uqadd16 r4, r0, r0",
            "uqadd16 r0, r4, r0",
            "uqadd16 r0, r0, r0",
            "uqadd16 r0, r0, r0",
            "mov r4, #0x00070007",
            "usub16 r5, r7, r4",
            "sel r3, r3, r10",
            "mov r4, #0x00050005",
            "usub16 r5, r7, r4",
            "sel r3, r3, r1",
            "mov r4, #0x00030003",
            "usub16 r5, r7, r4",
            "sel r3, r3, r0",
            "mov r4, #0x00010001",
            "mvn r8, #0",
            "usub16 r5, r7, r4",
            "sel r3, r3, r8",
            "str r3, [r12], #4",
            lower_to!("r3"),
            "ldr r0, [sp]",
            "subs r0, r0, #1",
            "str r0, [sp]",
            "beq 3f",
            // After the last word of a vector, the other views are skipped.
            "tst r0, #3",
            "bne 2b",
            "add r11, r11, #112",
            "add r6, r6, #112",
            "b 2b",
            "3:",
            "pop {{r0, r6, r7}}";
            inout("r0") 4 * fused.len() => _,
            out("r1") _, out("r2") _, out("r3") _, out("r4") _, out("r5") _, out("r8") _, out("r9") _,
            inout("r10") masks => _,
            inout("r11") blocks => _,
            inout("r12") fused.as_mut_ptr() => _,
            inout("lr") least,
        );
    }
    least
}
