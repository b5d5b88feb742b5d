//! The operations in the packed instructions of Arm's DSP extension, as Cortex-M4, M7 and M33 have them.
//!
//! Bytes are compared four at a time, and what is wider is in words of two halves. A word of bytes becomes two words of halves by
//! taking every other byte, so the lanes lie in memory as the disparities 0, 2, 1, 3. A vector is two of these groups, since an instruction loads or
//! stores four words as it does two.
//!
//! An instruction is only assembled for a processor that has it, and works on registers alone.
#![allow(unsafe_code, clippy::undocumented_unsafe_blocks)]

use core::arch::asm;

use super::{
    Block, Blocks, Change, Column, Isa, Rule, Steps, fuse_generic, fuse_masked_generic,
    steps::{Place, Track},
};

/// The DSP extension: eight lanes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Dsp;

/// Eight lanes of 16 bits.
#[derive(Clone, Copy, Debug)]
pub struct U16x8([u32; 4]);

/// Eight lanes of 32 bits.
#[derive(Clone, Copy, Debug)]
pub struct U32x8([u32; 8]);

/// Bytes of a vector of 16-bit lanes.
const VECTOR: usize = size_of::<[u32; 4]>();

/// A function of words that is one instruction: of this name, and with this operand's suffix.
macro_rules! instruction {
    ($name:ident $(, $suffix:literal)?) => {
        instruction!($name, stringify!($name) $(, $suffix)?);
    };
    ($name:ident, $mnemonic:expr $(, $suffix:literal)?) => {
        #[inline(always)]
        fn $name(a: u32, b: u32) -> u32 {
            let result;
            unsafe {
                asm!(concat!($mnemonic, " {}, {}, {}" $(, $suffix)?), lateout(reg) result, in(reg) a, in(reg) b,
                     options(pure, nomem, nostack));
            }
            result
        }
    };
}

instruction!(uqsub8);
instruction!(uadd16);
instruction!(usub16);
instruction!(uqadd16);
instruction!(uxtab16);
instruction!(uxtab16_high, "uxtab16", ", ror #8");

/// `then` in the halves where `a >= b`, and `otherwise` elsewhere: comparing and choosing go through flags, so they are one.
#[inline(always)]
fn if_not_less(a: u32, b: u32, then: u32, otherwise: u32) -> u32 {
    let result;
    unsafe {
        asm!("usub16 {result}, {a}, {b}", "sel {result}, {then}, {otherwise}", result = out(reg) result, a = in(reg) a, b = in(reg) b,
             then = in(reg) then, otherwise = in(reg) otherwise, options(pure, nomem, nostack));
    }
    result
}

/// Half of a vector of [`slide`]: what enters and leaves sums in two registers.
macro_rules! slide_half {
    ($a:literal, $b:literal) => {
        concat!(
            "ldr r0, [r9], #4\nuqsub8 r1, r0, r2\nuqsub8 r0, r2, r0\norr r0, r0, r1\n",
            concat!("uxtab16 ", $a, ", ", $a, ", r0\nuxtab16 ", $b, ", ", $b, ", r0, ror #8\n"),
            // 255 - |a - b| is what neither of 255 - a + b, saturated, and b - a, saturated, takes away.
            "ldr r0, [r10], #4\nuqadd8 r1, r8, r0\nuqsub8 r0, r0, r3\nbic r1, r1, r0\n",
            concat!("uxtab16 ", $a, ", ", $a, ", r1\nuxtab16 ", $b, ", ", $b, ", r1, ror #8\n"),
        )
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
            ldm lr, {{r0, r1, r2, r3}}
            uadd16 r4, r4, r0
            uadd16 r5, r5, r1
            uadd16 r6, r6, r2
            uadd16 r7, r7, r3
            stm lr!, {{r4, r5, r6, r7}}
            ldrd r2, r3, [sp]
            "
        )
    };
}

/// The same byte four times.
#[inline(always)]
fn splat(byte: u8) -> u32 {
    u32::from(byte) * 0x0101_0101
}

/// Samples four by four.
#[inline(always)]
fn words(samples: &[u8; 8]) -> [u32; 2] {
    let [a, b, c, d, e, f, g, h] = *samples;
    [u32::from_le_bytes([a, b, c, d]), u32::from_le_bytes([e, f, g, h])]
}

/// The absolute differences of bytes: one of both differences saturates at 0.
#[inline(always)]
fn differences(a: u32, b: u32) -> u32 {
    uqsub8(a, b) | uqsub8(b, a)
}

/// The lesser of words' halves, to the place of the first if there is no other.
macro_rules! min {
    ($a:literal, $b:literal) => {
        concat!("usub16 {t}, ", $a, ", ", $b, "\nsel ", $a, ", ", $b, ", ", $a, "\n")
    };
    ($a:literal, $b:literal, $to:literal) => {
        concat!("usub16 ", $to, ", ", $a, ", ", $b, "\nsel ", $to, ", ", $b, ", ", $a, "\n")
    };
    ([$a:literal, $b:literal, $c:literal, $d:literal], [$e:literal, $f:literal, $g:literal, $h:literal]) => {
        concat!(min!($a, $e), min!($b, $f), min!($c, $g), min!($d, $h))
    };
}

/// Keeps the fused costs of a vector, and the least of all so far.
macro_rules! keep {
    () => {
        concat!(
            "stm {fused}!, {{r0, r1, r2, r3}}\n",
            min!("{least}", "r0"),
            min!("{least}", "r1"),
            min!("{least}", "r2"),
            min!("{least}", "r3"),
        )
    };
}

/// Fuses the costs of four views to the least, and returns the least of all.
///
/// # Safety
/// There are as many blocks as fused costs: a multiple of `UNROLLED`, not 0.
#[inline(always)]
unsafe fn least_of_all<const UNROLLED: usize>(blocks: *const [[u32; 4]; 4], fused: &mut [[u32; 4]]) -> u32 {
    let mut least = u32::MAX;
    unsafe {
        asm!(
            at_most!(600),
            "2:",
            ".rept {unrolled}",
            "ldm {block}!, {{r0, r1, r2, r3, r4, r5, r8, r9}}",
            min!(["r0", "r1", "r2", "r3"], ["r4", "r5", "r8", "r9"]),
            "ldm {block}!, {{r4, r5, r8, r9}}",
            min!(["r0", "r1", "r2", "r3"], ["r4", "r5", "r8", "r9"]),
            "ldm {block}!, {{r4, r5, r8, r9}}",
            min!(["r0", "r1", "r2", "r3"], ["r4", "r5", "r8", "r9"]),
            keep!(),
            ".endr",
            "subs {n}, {n}, #{unrolled}",
            "bne 2b",
            n = inout(reg) fused.len() => _,
            block = inout(reg) blocks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            t = out(reg) _,
            out("r0") _, out("r1") _, out("r2") _, out("r3") _, out("r4") _, out("r5") _, out("r8") _, out("r9") _,
            unrolled = const UNROLLED,
            options(nostack),
        );
    }
    least
}

/// Fuses the costs of four views in two lanes by the heuristic rule, into the place of the first.
macro_rules! heuristic {
    ($a:literal, $b:literal, $c:literal, $d:literal) => {
        concat!(
            // The lesser and the greater of the first two are in t and a, those of the others in b and c.
            "usub16 {t}, ",
            $a,
            ", ",
            $b,
            "\nsel {t}, ",
            $b,
            ", ",
            $a,
            "\nsel ",
            $a,
            ", ",
            $a,
            ", ",
            $b,
            "\n",
            "usub16 ",
            $b,
            ", ",
            $c,
            ", ",
            $d,
            "\nsel ",
            $b,
            ", ",
            $d,
            ", ",
            $c,
            "\nsel ",
            $c,
            ", ",
            $c,
            ", ",
            $d,
            "\n",
            // The least in d. Second and third are the greater of the lesser ones and the lesser of the greater ones: in b and a.
            "usub16 ",
            $d,
            ", {t}, ",
            $b,
            "\nsel ",
            $d,
            ", ",
            $b,
            ", {t}\nsel ",
            $b,
            ", {t}, ",
            $b,
            "\n",
            "usub16 {t}, ",
            $a,
            ", ",
            $c,
            "\nsel ",
            $a,
            ", ",
            $c,
            ", ",
            $a,
            "\n",
            // In c and a.
            "usub16 {t}, ",
            $b,
            ", ",
            $a,
            "\nsel ",
            $c,
            ", ",
            $a,
            ", ",
            $b,
            "\nsel ",
            $a,
            ", ",
            $b,
            ", ",
            $a,
            "\n",
            // The sums of two in d and of three in b, three times the second in t.
            "uqadd16 ",
            $d,
            ", ",
            $d,
            ", ",
            $c,
            "\nuqadd16 ",
            $b,
            ", ",
            $d,
            ", ",
            $a,
            "\n",
            "uqadd16 {t}, ",
            $c,
            ", ",
            $c,
            "\nuqadd16 {t}, {t}, ",
            $c,
            "\n",
            "uqadd16 ",
            $c,
            ", ",
            $d,
            ", ",
            $d,
            "\nuqadd16 ",
            $d,
            ", ",
            $c,
            ", ",
            $d,
            "\n",
            "uqadd16 ",
            $b,
            ", ",
            $b,
            ", ",
            $b,
            "\n",
            "usub16 {t}, {t}, ",
            $a,
            "\nsel ",
            $a,
            ", ",
            $b,
            ", ",
            $d,
            "\n"
        )
    };
}

/// Fuses the costs of four views by the heuristic rule, and returns the least of all.
///
/// # Safety
/// There are as many blocks as fused costs, not 0.
#[inline(always)]
unsafe fn heuristic_of_all(blocks: *const [[u32; 4]; 4], fused: &mut [[u32; 4]]) -> u32 {
    let mut least = u32::MAX;
    unsafe {
        asm!(
            at_most!(600),
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
            "bne 2b",
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

/// As [`heuristic_of_all`], of what masks leave.
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0.
#[inline(always)]
unsafe fn heuristic_of_unmasked(blocks: *const [[u32; 4]; 4], masks: *const [[u32; 4]; 4], fused: &mut [[u32; 4]]) -> u32 {
    let mut least = u32::MAX;
    unsafe {
        asm!(
            at_most!(800),
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
            "bne 2b",
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

/// Fuses the costs of `V` views that masks leave to the least, and returns the least of all.
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0.
#[inline(always)]
unsafe fn least_of_unmasked<const V: usize>(
    blocks: *const [[u32; 4]; V],
    masks: *const [[u32; 4]; V],
    fused: &mut [[u32; 4]],
) -> u32 {
    let mut least = u32::MAX;
    unsafe {
        asm!(
            at_most!(400),
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
            "bne 2b",
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

/// Masks the costs of a view, word by word.
macro_rules! mask {
    ($a:literal, $b:literal, $c:literal, $d:literal) => {
        concat!(
            concat!("ldr {t}, [{mask}], #4\norr ", $a, ", ", $a, ", {t}\n"),
            concat!("ldr {t}, [{mask}], #4\norr ", $b, ", ", $b, ", {t}\n"),
            concat!("ldr {t}, [{mask}], #4\norr ", $c, ", ", $c, ", {t}\n"),
            concat!("ldr {t}, [{mask}], #{next}\norr ", $d, ", ", $d, ", {t}"),
        )
    };
}

/// As [`least_of_unmasked`], where only view `K` has masks.
///
/// # Safety
/// There are four blocks, masks and fused costs, and a view `K`.
#[inline(always)]
unsafe fn least_of_one_masked<const V: usize, const K: usize>(
    blocks: *const [[u32; 4]; V],
    masks: *const [[u32; 4]; V],
    fused: &mut [[u32; 4]],
) -> u32 {
    let mut least = u32::MAX;
    unsafe {
        asm!(
            at_most!(800),
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
            keep!(),
            ".endr",
            block = inout(reg) blocks => _,
            mask = inout(reg) masks.cast::<[u32; 4]>().wrapping_add(K) => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            t = out(reg) _,
            out("r0") _, out("r1") _, out("r2") _, out("r3") _, out("r4") _, out("r5") _, out("r8") _, out("r9") _,
            views = const V,
            masked = const K,
            // To the next vector's masks of the view.
            next = const V * VECTOR - 12,
            options(nostack),
        );
    }
    least
}

/// Moves a column down, and the blocks on by it: of `N` vectors in a view if that is not 0, and then without counting them.
///
/// # Safety
/// The place has as many vectors in a view as there are blocks: `N`, or at least one.
#[inline(always)]
unsafe fn slide<const V: usize, const N: usize>(place: Place<'_, Dsp, V>, blocks: &mut [[[u32; 4]; V]]) {
    let Place { center, index, tracks, column, left, .. } = place;
    let (entering, leaving) = (splat(center.entering), splat(center.leaving));
    unsafe {
        asm!(
            at_most!(5400),
            // All registers are taken. On the stack: the centre's samples, whose place is taken for a while in each vector; what is not the compiler's to
            // give; the tracks and the column.
            "push {{r2, r3, r6, r7, r9, r10}}",
            // If vectors are counted, before these: the samples, the bytes of a view's vectors, and the view's first block.
            ".if !{fixed}",
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
            ".if {fixed}",
            ".rept {fixed} - 1",
            slide_vector!(),
            "add lr, lr, #{others}",
            ".endr",
            slide_vector!(),
            "sub lr, lr, #{back}",
            ".else",
            "ldr r0, [sp, #8]",
            "add r0, r0, r12",
            "str r0, [sp, #16]",
            "3:",
            slide_vector!(),
            "add lr, lr, #{others}",
            "ldr r0, [sp, #16]",
            "cmp r12, r0",
            "bne 3b",
            "ldr lr, [sp, #12]",
            "add lr, lr, #{vector}",
            "str lr, [sp, #12]",
            ".endif",
            ".endr",
            ".if !{fixed}",
            "add sp, sp, #16",
            ".endif",
            "pop {{r2, r3, r6, r7, r9, r10}}",
            inout("r0") blocks.len() * VECTOR => _,
            out("r1") _,
            inout("r2") entering => _,
            inout("r3") leaving => _,
            out("r4") _,
            out("r5") _,
            in("r8") !leaving,
            inout("r9") tracks => _,
            inout("r10") index => _,
            inout("r11") column => _,
            inout("r12") left => _,
            inout("lr") blocks.as_mut_ptr() => _,
            views = const V,
            fixed = const N,
            // To the next view's first block.
            back = const N.saturating_sub(1) * V * VECTOR,
            others = const VECTOR * (V - 1),
            vector = const VECTOR,
            tracks = const if N == 0 { 32 } else { 16 },
        );
    }
}

/// Half of a vector of [`prime`].
macro_rules! prime_half {
    ($a:literal, $b:literal) => {
        concat!(
            "ldr {x}, [{entering}], #4\nuqsub8 {y}, {x}, {center}\nuqsub8 {x}, {center}, {x}\norr {x}, {x}, {y}\n",
            concat!("uxtab16 ", $a, ", ", $a, ", {x}\nuxtab16 ", $b, ", ", $b, ", {x}, ror #8"),
        )
    };
}

/// Adds what enters to a column.
///
/// # Safety
/// The place has so many vectors in a view, not 0.
#[inline(always)]
unsafe fn prime<const V: usize>(place: Place<'_, Dsp, V>, vectors: usize) {
    let Place { center, index, tracks, column, .. } = place;
    unsafe {
        asm!(
            at_most!(400),
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
            ".endr",
            vectors = in(reg) vectors,
            index = in(reg) index,
            tracks = inout(reg) tracks => _,
            column = inout(reg) column => _,
            center = in(reg) splat(center.entering),
            entering = out(reg) _,
            n = out(reg) _,
            x = out(reg) _,
            y = out(reg) _,
            out("r0") _,
            out("r1") _,
            out("r2") _,
            out("r3") _,
            track = const size_of::<Track>(),
            views = const V,
            options(nostack),
        );
    }
}

/// [`Blocks::least`]. Generic, so that it is only compiled for processors that use it: this module is there for all of Arm's.
#[inline(never)]
fn least_of_vectors<const LANES: usize>(costs: &[[u32; 4]]) -> u16 {
    let mut least = U16x8([u32::MAX; 4]);
    for &costs in costs {
        least = least.min(U16x8(costs));
    }
    least.least()
}

impl Isa for Dsp {
    const LANES: usize = 8;
    const BATCH: usize = 1;
    type Samples = [u8; 8];
    type Sums = [u32; 4];
    type Column = U16x8;

    #[inline(always)]
    fn lane(index: usize) -> usize {
        // The lower two bits change places.
        index & !3 | index << 1 & 2 | index >> 1 & 1
    }

    #[inline(always)]
    fn load_column(self, sums: &[u32; 4]) -> U16x8 {
        U16x8(*sums)
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8; 8]) -> U16x8 {
        let [x, y] = words(view).map(|samples| differences(splat(center), samples));
        U16x8([uxtab16(0, x), uxtab16_high(0, x), uxtab16(0, y), uxtab16_high(0, y)])
    }

    #[inline(always)]
    fn advance(self, sums: U16x8, center: Change<u8>, view: Change<&[u8; 8]>) -> U16x8 {
        let entering = self.differences(center.entering, view.entering);
        let [x, y] = words(view.leaving).map(|samples| !differences(splat(center.leaving), samples));
        let kept = U16x8([uxtab16(0, x), uxtab16_high(0, x), uxtab16(0, y), uxtab16_high(0, y)]);
        Column::add(Column::add(sums, entering), kept)
    }

    fn bias(lines: u32) -> u16 {
        255u16.wrapping_mul(lines as u16)
    }

    #[inline(never)]
    fn prime<const V: usize>(self, steps: &mut Steps<'_, Self, V>) {
        let vectors = steps.vectors();
        if let Some(place) = steps.enter().filter(|_| vectors > 0) {
            unsafe { prime(place, vectors) }
        }
    }
}

impl Column for U16x8 {
    type Sums = [u32; 4];

    #[inline(always)]
    fn store(self, sums: &mut [u32; 4]) {
        *sums = self.0;
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, uadd16)
    }
}

impl Blocks<u16> for Dsp {
    type Costs = [u32; 4];
    type Block = U16x8;

    #[inline(always)]
    fn load_block(self, costs: &[u32; 4]) -> U16x8 {
        U16x8(*costs)
    }

    #[inline(always)]
    fn splat(self, cost: u16) -> U16x8 {
        U16x8([u32::from(cost) * 0x1_0001; 4])
    }

    #[inline(always)]
    fn position(self, costs: &[[u32; 4]], cost: u16) -> usize {
        if costs.is_empty() {
            return 0;
        }
        let (found, left): (u32, usize);
        unsafe {
            asm!(
                "2:",
                "ldm {costs}!, {{r0, r1, r2, r3}}",
                // A bit for each half that has it, since no cost is less.
                "usub16 r0, {cost}, r0",
                "sel r0, {ones}, {zero}",
                "usub16 r1, {cost}, r1",
                "sel r1, {ones}, {zero}",
                "usub16 r2, {cost}, r2",
                "sel r2, {ones}, {zero}",
                "usub16 r3, {cost}, r3",
                "sel r3, {ones}, {zero}",
                "orr r0, r0, r1, lsl #1",
                "orr r2, r2, r3, lsl #1",
                "orrs r0, r0, r2, lsl #4",
                "bne 3f",
                "subs {left}, {left}, #1",
                "bne 2b",
                "3:",
                costs = inout(reg) costs.as_ptr() => _,
                left = inout(reg) costs.len() => left,
                cost = in(reg) u32::from(cost) * 0x1_0001,
                ones = in(reg) 0x1_0001,
                zero = in(reg) 0,
                out("r0") found,
                out("r1") _,
                out("r2") _,
                out("r3") _,
                options(readonly, nostack),
            );
        }
        // In the order of the disparities; none without the cost.
        let lanes = found | found >> 14;
        8 * (costs.len() - left) + lanes.trailing_zeros() as usize
    }

    #[inline(never)]
    fn slide<const V: usize>(self, steps: &mut Steps<'_, Self, V>, blocks: &mut [[[u32; 4]; V]]) {
        if steps.vectors() != blocks.len() || blocks.is_empty() {
            return;
        }
        let Some(place) = steps.enter() else { return };
        unsafe {
            match blocks.len() {
                2 => slide::<V, 2>(place, blocks),
                4 => slide::<V, 4>(place, blocks),
                8 => slide::<V, 8>(place, blocks),
                _ => slide::<V, 0>(place, blocks),
            }
        }
    }

    #[inline(always)]
    fn slide_and_fuse<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        steps: &mut Steps<'_, Self, V>,
        blocks: &mut [[[u32; 4]; V]],
        masks: &[[[u32; 4]; V]],
        fused: &mut [[u32; 4]],
    ) -> u16 {
        let four = (blocks.len() == 4) & (masks.len() == 4) & (fused.len() == 4) & (steps.vectors() == 4);
        if V == 4 && rule == Rule::Min && four {
            let Some(place) = steps.enter() else { return u16::MAX };
            let least = unsafe {
                slide::<V, 4>(place, blocks);
                let (blocks, masks) = (blocks.as_ptr(), masks.as_ptr());
                match masked {
                    0 => least_of_all::<4>(blocks.cast(), fused),
                    1 => least_of_one_masked::<V, 0>(blocks, masks, fused),
                    2 => least_of_one_masked::<V, 1>(blocks, masks, fused),
                    4 => least_of_one_masked::<V, 2>(blocks, masks, fused),
                    8 => least_of_one_masked::<V, 3>(blocks, masks, fused),
                    _ => least_of_unmasked(blocks, masks, fused),
                }
            };
            return (least as u16).min((least >> 16) as u16);
        }
        Blocks::<u16>::slide(self, steps, blocks);
        self.fuse_by_masks(rule, masked, blocks, masks, fused)
    }

    #[inline(never)]
    fn fuse<const V: usize>(self, rule: Rule, blocks: &[[[u32; 4]; V]], fused: &mut [[u32; 4]]) -> u16 {
        if V != 4 || rule == Rule::Sum || blocks.len() != fused.len() || blocks.is_empty() {
            return fuse_generic(self, rule, blocks, fused);
        }
        let blocks = blocks.as_ptr().cast();
        let least = unsafe {
            match fused.len() {
                _ if rule == Rule::Heuristic => heuristic_of_all(blocks, fused),
                n if n % 4 == 0 => least_of_all::<4>(blocks, fused),
                _ => least_of_all::<1>(blocks, fused),
            }
        };
        (least as u16).min((least >> 16) as u16)
    }

    #[inline(never)]
    fn fuse_masked<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        blocks: &[[[u32; 4]; V]],
        masks: &[[[u32; 4]; V]],
        fused: &mut [[u32; 4]],
    ) -> u16 {
        let fits = blocks.len() == fused.len() && masks.len() == fused.len() && !fused.is_empty();
        let least = match rule {
            Rule::Min if fits => unsafe {
                let (blocks, masks) = (blocks.as_ptr(), masks.as_ptr());
                match (masked, fused.len()) {
                    (1, 4) => least_of_one_masked::<V, 0>(blocks, masks, fused),
                    (2, 4) if V > 1 => least_of_one_masked::<V, 1>(blocks, masks, fused),
                    (4, 4) if V > 2 => least_of_one_masked::<V, 2>(blocks, masks, fused),
                    (8, 4) if V > 3 => least_of_one_masked::<V, 3>(blocks, masks, fused),
                    _ => least_of_unmasked(blocks, masks, fused),
                }
            },
            Rule::Heuristic if fits && V == 4 => unsafe {
                heuristic_of_unmasked(blocks.as_ptr().cast(), masks.as_ptr().cast(), fused)
            },
            _ => return fuse_masked_generic(self, rule, blocks, masks, fused),
        };
        (least as u16).min((least >> 16) as u16)
    }

    #[inline(always)]
    fn least(self, costs: &[[u32; 4]]) -> u16 {
        least_of_vectors::<{ Dsp::LANES }>(costs)
    }
}

impl Block<u16> for U16x8 {
    type Costs = [u32; 4];
    type Column = U16x8;

    #[inline(always)]
    fn store(self, costs: &mut [u32; 4]) {
        *costs = self.0;
    }

    #[inline(always)]
    fn slide(self, entering: U16x8, leaving: U16x8) -> Self {
        Column::add(self, entering).sub(leaving)
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, uqadd16)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if_not_less(a, b, b, a))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if_not_less(a, b, a, b))
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        let choose = |word: usize| if_not_less(other.0[word], self.0[word], otherwise.0[word], then.0[word]);
        U16x8([choose(0), choose(1), choose(2), choose(3)])
    }

    #[inline(always)]
    fn least(self) -> u16 {
        let [a, b, c, d] = self.0;
        let (a, b) = (if_not_less(a, b, b, a), if_not_less(c, d, d, c));
        let least = if_not_less(a, b, b, a);
        (least as u16).min((least >> 16) as u16)
    }
}

impl U16x8 {
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, usub16)
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(u32, u32) -> u32) -> Self {
        let word = |word: usize| f(self.0[word], other.0[word]);
        U16x8([word(0), word(1), word(2), word(3)])
    }
}

impl Blocks<u32> for Dsp {
    type Costs = [u32; 8];
    type Block = U32x8;

    #[inline(always)]
    fn load_block(self, costs: &[u32; 8]) -> U32x8 {
        U32x8(*costs)
    }

    #[inline(always)]
    fn splat(self, cost: u32) -> U32x8 {
        U32x8([cost; 8])
    }

    #[inline(always)]
    fn position(self, costs: &[[u32; 8]], cost: u32) -> usize {
        let lanes = costs.iter().flat_map(|&[a, c, b, d, e, g, f, h]| [a, b, c, d, e, f, g, h]);
        lanes.enumerate().find(|&(_, lane)| lane == cost).map_or(8 * costs.len(), |(index, _)| index)
    }
}

impl Block<u32> for U32x8 {
    type Costs = [u32; 8];
    type Column = U16x8;

    #[inline(always)]
    fn store(self, costs: &mut [u32; 8]) {
        *costs = self.0;
    }

    #[inline(always)]
    fn slide(self, entering: U16x8, leaving: U16x8) -> Self {
        let growth = entering.sub(leaving).0;
        let [low, high] = [growth.map(|word| word as i16 as u32), growth.map(|word| (word as i32 >> 16) as u32)];
        let lanes = [low[0], high[0], low[1], high[1], low[2], high[2], low[3], high[3]];
        self.zip(U32x8(lanes), u32::wrapping_add)
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, u32::wrapping_add)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, u32::min)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, u32::max)
    }

    #[inline(always)]
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self {
        let choose = |lane: usize| {
            // Of eight: so no bound is checked, even where this is a loop.
            let lane = lane % 8;
            if self.0[lane] > other.0[lane] { then.0[lane] } else { otherwise.0[lane] }
        };
        U32x8([0, 1, 2, 3, 4, 5, 6, 7].map(choose))
    }

    #[inline(always)]
    fn least(self) -> u32 {
        self.0.into_iter().fold(u32::MAX, u32::min)
    }
}

impl U32x8 {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(u32, u32) -> u32) -> Self {
        let lane = |lane: usize| f(self.0[lane % 8], other.0[lane % 8]);
        U32x8([0, 1, 2, 3, 4, 5, 6, 7].map(lane))
    }
}
