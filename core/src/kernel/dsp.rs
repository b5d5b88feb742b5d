//! The operations in the packed instructions of Arm's DSP extension, as Cortex-M4, M7 and M33 have them.
//!
//! Bytes are compared four at a time, and what is wider is in words of two halves. A word of bytes becomes two words of halves by
//! taking every other byte, so the lanes lie in memory as the disparities 0, 2, 1, 3.
//!
//! An instruction is only assembled for a processor that has it, and works on registers alone.
#![allow(unsafe_code, clippy::undocumented_unsafe_blocks)]

use core::arch::asm;

use super::{
    Block, Blocks, Change, Column, Isa, Rule, Steps, fuse_generic, fuse_masked_generic,
    steps::{Place, Track},
};

/// The DSP extension: four lanes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Dsp;

/// Four lanes of 16 bits.
#[derive(Clone, Copy, Debug)]
pub struct U16x4([u32; 2]);

/// Four lanes of 32 bits.
#[derive(Clone, Copy, Debug)]
pub struct U32x4([u32; 4]);

/// Bytes of a vector of 16-bit lanes.
const VECTOR: usize = size_of::<[u32; 2]>();

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

/// A vector of [`slide`]. The frame pointer is one of its registers, or they would not suffice.
macro_rules! slide_vector {
    () => {
        // 255 - |a - b| is what neither of 255 - a + b, saturated, and b - a, saturated, takes away.
        "
        ldr {x}, [{entering}], #4
        ldr {y}, [{leaving}], #4
        uqsub8 {a}, {x}, {center}
        uqsub8 {x}, {center}, {x}
        orr {x}, {x}, {a}
        ldrd {a}, r7, [{column}]
        uxtab16 {a}, {a}, {x}
        uxtab16 r7, r7, {x}, ror #8
        uqadd8 {x}, {inverse}, {y}
        uqsub8 {y}, {y}, {center_left}
        bic {x}, {x}, {y}
        uxtab16 {a}, {a}, {x}
        uxtab16 r7, r7, {x}, ror #8
        strd {a}, r7, [{column}], #8
        ldrd {x}, {y}, [{left}], #8
        usub16 {a}, {a}, {x}
        usub16 r7, r7, {y}
        ldrd {x}, {y}, [{block}]
        uadd16 {a}, {a}, {x}
        uadd16 r7, r7, {y}
        strd {a}, r7, [{block}], #{stride}
        "
    };
}

/// The same byte four times.
#[inline(always)]
fn splat(byte: u8) -> u32 {
    u32::from(byte) * 0x0101_0101
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
}

/// Fuses the costs of four views to the least, and returns the least of all.
///
/// # Safety
/// There are as many blocks as fused costs: a multiple of `UNROLLED`, not 0.
#[inline(always)]
unsafe fn least_of_all<const UNROLLED: usize>(blocks: *const [[u32; 2]; 4], fused: &mut [[u32; 2]]) -> u32 {
    let mut least = u32::MAX;
    unsafe {
        asm!(
            "2:",
            ".rept {unrolled}",
            "ldm {block}!, {{r0, r1, r2, r3, r4, r5, r8, r9}}",
            min!("r0", "r2"),
            min!("r1", "r3"),
            min!("r0", "r4"),
            min!("r1", "r5"),
            min!("r0", "r8"),
            min!("r1", "r9"),
            "strd r0, r1, [{fused}], #8",
            min!("{least}", "r0"),
            min!("{least}", "r1"),
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
unsafe fn heuristic_of_all(blocks: *const [[u32; 2]; 4], fused: &mut [[u32; 2]]) -> u32 {
    let mut least = u32::MAX;
    unsafe {
        asm!(
            "2:",
            "ldm {block}!, {{r0, r1, r2, r3, r4, r5, r8, r9}}",
            heuristic!("r0", "r2", "r4", "r8"),
            heuristic!("r1", "r3", "r5", "r9"),
            "strd r0, r1, [{fused}], #8",
            min!("{least}", "r0"),
            min!("{least}", "r1"),
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
unsafe fn heuristic_of_unmasked(blocks: *const [[u32; 2]; 4], masks: *const [[u32; 2]; 4], fused: &mut [[u32; 2]]) -> u32 {
    let mut least = u32::MAX;
    unsafe {
        asm!(
            "2:",
            // Word by word, for want of registers.
            ".irp next, 4, 28",
            "ldr {a}, [{block}]",
            "ldr {t}, [{mask}]",
            "orr {a}, {a}, {t}",
            "ldr {b}, [{block}, #8]",
            "ldr {t}, [{mask}, #8]",
            "orr {b}, {b}, {t}",
            "ldr {c}, [{block}, #16]",
            "ldr {t}, [{mask}, #16]",
            "orr {c}, {c}, {t}",
            "ldr {d}, [{block}, #24]",
            "ldr {t}, [{mask}, #24]",
            "orr {d}, {d}, {t}",
            "add {block}, {block}, #\\next",
            "add {mask}, {mask}, #\\next",
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
    blocks: *const [[u32; 2]; V],
    masks: *const [[u32; 2]; V],
    fused: &mut [[u32; 2]],
) -> u32 {
    let mut least = u32::MAX;
    unsafe {
        asm!(
            "2:",
            "ldrd {a}, {b}, [{block}], #8",
            "ldrd {c}, {d}, [{mask}], #8",
            "orr {a}, {a}, {c}",
            "orr {b}, {b}, {d}",
            ".rept {others}",
            "ldrd {c}, {d}, [{block}], #8",
            "ldrd {e}, {t}, [{mask}], #8",
            "orr {c}, {c}, {e}",
            "orr {d}, {d}, {t}",
            min!("{a}", "{c}"),
            min!("{b}", "{d}"),
            ".endr",
            "strd {a}, {b}, [{fused}], #8",
            min!("{least}", "{a}"),
            min!("{least}", "{b}"),
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
            others = const V - 1,
            options(nostack),
        );
    }
    least
}

/// As [`least_of_unmasked`], where only view `K` has masks.
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0, and a view `K`.
#[inline(always)]
unsafe fn least_of_one_masked<const V: usize, const K: usize>(
    blocks: *const [[u32; 2]; V],
    masks: *const [[u32; 2]; V],
    fused: &mut [[u32; 2]],
) -> u32 {
    let mut least = u32::MAX;
    unsafe {
        asm!(
            "2:",
            "ldrd {a}, {b}, [{mask}], #{stride}",
            "ldrd {c}, {d}, [{block}, #{masked}]",
            "orr {a}, {a}, {c}",
            "orr {b}, {b}, {d}",
            ".irp view, 0, 8, 16, 24",
            ".if (\\view < {stride}) && (\\view != {masked})",
            "ldrd {c}, {d}, [{block}, #\\view]",
            min!("{a}", "{c}"),
            min!("{b}", "{d}"),
            ".endif",
            ".endr",
            "add {block}, {block}, #{stride}",
            "strd {a}, {b}, [{fused}], #8",
            min!("{least}", "{a}"),
            min!("{least}", "{b}"),
            "subs {n}, {n}, #1",
            "bne 2b",
            n = inout(reg) fused.len() => _,
            block = inout(reg) blocks => _,
            mask = inout(reg) masks.cast::<[u32; 2]>().wrapping_add(K) => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            a = out(reg) _,
            b = out(reg) _,
            c = out(reg) _,
            d = out(reg) _,
            t = out(reg) _,
            masked = const K * VECTOR,
            stride = const V * VECTOR,
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
unsafe fn slide<const V: usize, const N: usize>(place: Place<'_, Dsp, V>, blocks: &mut [[[u32; 2]; V]]) {
    let Place { center, tracks, column, left, .. } = place;
    let (entering, leaving) = (splat(center.entering), splat(center.leaving));
    let end = tracks.wrapping_add(V);
    unsafe {
        asm!(
            // On the stack: the vectors, the tracks' end, the frame pointer, and the first block.
            "sub sp, sp, #16",
            "strd {n}, {x}, [sp]",
            "strd r7, {block}, [sp, #8]",
            "2:",
            "ldrd {entering}, {leaving}, [{tracks}]",
            "ldr {x}, [{tracks}, #8]",
            "add {y}, {entering}, {x}",
            "add {a}, {leaving}, {x}",
            "strd {y}, {a}, [{tracks}], #{track}",
            ".if {fixed}",
            ".rept {fixed}",
            slide_vector!(),
            ".endr",
            "sub {block}, {block}, #{back}",
            ".else",
            "ldr {n}, [sp]",
            "3:",
            slide_vector!(),
            "subs {n}, {n}, #1",
            "bne 3b",
            "ldr {block}, [sp, #12]",
            "add {block}, {block}, #{vector}",
            "str {block}, [sp, #12]",
            ".endif",
            "ldr {x}, [sp, #4]",
            "cmp {tracks}, {x}",
            "bne 2b",
            "ldr r7, [sp, #8]",
            "add sp, sp, #16",
            n = inout(reg) blocks.len() => _,
            x = inout(reg) end => _,
            tracks = inout(reg) tracks => _,
            column = inout(reg) column => _,
            left = inout(reg) left => _,
            block = inout(reg) blocks.as_mut_ptr() => _,
            center = in(reg) entering,
            center_left = in(reg) leaving,
            inverse = in(reg) !leaving,
            entering = out(reg) _,
            leaving = out(reg) _,
            a = out(reg) _,
            y = out(reg) _,
            fixed = const N,
            // To the next view's first block.
            back = const (N * V).saturating_sub(1) * VECTOR,
            vector = const VECTOR,
            stride = const VECTOR * V,
            track = const size_of::<Track>(),
        );
    }
}

/// Adds what enters to a column.
///
/// # Safety
/// The place has so many vectors in a view, not 0.
#[inline(always)]
unsafe fn prime<const V: usize>(place: Place<'_, Dsp, V>, vectors: usize) {
    let Place { center, tracks, column, .. } = place;
    unsafe {
        asm!(
            "2:",
            "ldr {entering}, [{tracks}]",
            "ldr {x}, [{tracks}, #8]",
            "add {x}, {x}, {entering}",
            "str {x}, [{tracks}], #{track}",
            "mov {n}, {vectors}",
            "3:",
            "ldr {x}, [{entering}], #4",
            "uqsub8 {a}, {x}, {center}",
            "uqsub8 {x}, {center}, {x}",
            "orr {x}, {x}, {a}",
            "ldrd {a}, {b}, [{column}]",
            "uxtab16 {a}, {a}, {x}",
            "uxtab16 {b}, {b}, {x}, ror #8",
            "strd {a}, {b}, [{column}], #8",
            "subs {n}, {n}, #1",
            "bne 3b",
            "cmp {tracks}, {end}",
            "bne 2b",
            vectors = in(reg) vectors,
            tracks = inout(reg) tracks => _,
            end = in(reg) tracks.wrapping_add(V),
            column = inout(reg) column => _,
            center = in(reg) splat(center.entering),
            entering = out(reg) _,
            n = out(reg) _,
            a = out(reg) _,
            b = out(reg) _,
            x = out(reg) _,
            track = const size_of::<Track>(),
            options(nostack),
        );
    }
}

impl Isa for Dsp {
    const LANES: usize = 4;
    const BATCH: usize = 1;
    type Samples = [u8; 4];
    type Sums = [u32; 2];
    type Column = U16x4;

    #[inline(always)]
    fn lane(index: usize) -> usize {
        // The lower two bits change places.
        index & !3 | index << 1 & 2 | index >> 1 & 1
    }

    #[inline(always)]
    fn samples(samples: &[u8]) -> &[[u8; 4]] {
        samples.as_chunks().0
    }

    #[inline(always)]
    fn load_column(self, sums: &[u32; 2]) -> U16x4 {
        U16x4(*sums)
    }

    #[inline(always)]
    fn differences(self, center: u8, view: &[u8; 4]) -> U16x4 {
        let differences = differences(splat(center), u32::from_le_bytes(*view));
        U16x4([uxtab16(0, differences), uxtab16_high(0, differences)])
    }

    #[inline(always)]
    fn advance(self, sums: U16x4, center: Change<u8>, view: Change<&[u8; 4]>) -> U16x4 {
        let entering = differences(splat(center.entering), u32::from_le_bytes(*view.entering));
        let kept = !differences(splat(center.leaving), u32::from_le_bytes(*view.leaving));
        let [a, b] = sums.0;
        U16x4([uxtab16(uxtab16(a, entering), kept), uxtab16_high(uxtab16_high(b, entering), kept)])
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

impl Column for U16x4 {
    type Sums = [u32; 2];

    #[inline(always)]
    fn store(self, sums: &mut [u32; 2]) {
        *sums = self.0;
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, uadd16)
    }
}

impl Blocks<u16> for Dsp {
    type Costs = [u32; 2];
    type Block = U16x4;

    #[inline(always)]
    fn load_block(self, costs: &[u32; 2]) -> U16x4 {
        U16x4(*costs)
    }

    #[inline(always)]
    fn splat(self, cost: u16) -> U16x4 {
        U16x4([u32::from(cost) * 0x1_0001; 2])
    }

    #[inline(always)]
    fn position(self, costs: &[[u32; 2]], cost: u16) -> usize {
        if costs.is_empty() {
            return 0;
        }
        let (a, b, left): (u32, u32, usize);
        unsafe {
            asm!(
                "2:",
                "ldrd {a}, {b}, [{costs}], #8",
                min!("{a}", "{b}", "{t}"),
                // Whether one of the halves has it, since no cost is less.
                "usub16 {t}, {cost}, {t}",
                "sel {t}, {ones}, {zero}",
                "cmp {t}, #0",
                "bne 3f",
                "subs {left}, {left}, #1",
                "bne 2b",
                "3:",
                costs = inout(reg) costs.as_ptr() => _,
                left = inout(reg) costs.len() => left,
                cost = in(reg) u32::from(cost) * 0x1_0001,
                ones = in(reg) u32::MAX,
                zero = in(reg) 0,
                a = out(reg) a,
                b = out(reg) b,
                t = out(reg) _,
                options(readonly, nostack),
            );
        }
        let lanes = [a as u16, b as u16, (a >> 16) as u16];
        let lane = lanes.iter().position(|&lane| lane == cost).unwrap_or(3);
        4 * (costs.len() - left) + lane
    }

    #[inline(never)]
    fn slide<const V: usize>(self, steps: &mut Steps<'_, Self, V>, blocks: &mut [[[u32; 2]; V]]) {
        if steps.vectors() != blocks.len() || blocks.is_empty() {
            return;
        }
        let Some(place) = steps.enter() else { return };
        unsafe {
            match blocks.len() {
                4 => slide::<V, 4>(place, blocks),
                8 => slide::<V, 8>(place, blocks),
                16 => slide::<V, 16>(place, blocks),
                _ => slide::<V, 0>(place, blocks),
            }
        }
    }

    #[inline(never)]
    fn fuse<const V: usize>(self, rule: Rule, blocks: &[[[u32; 2]; V]], fused: &mut [[u32; 2]]) -> u16 {
        if V != 4 || rule == Rule::Sum || blocks.len() != fused.len() || blocks.is_empty() {
            return self.fuse_others(rule, blocks, fused);
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
        blocks: &[[[u32; 2]; V]],
        masks: &[[[u32; 2]; V]],
        fused: &mut [[u32; 2]],
    ) -> u16 {
        let fits = blocks.len() == fused.len() && masks.len() == fused.len() && !fused.is_empty();
        let least = match rule {
            Rule::Min if fits => unsafe {
                let (blocks, masks) = (blocks.as_ptr(), masks.as_ptr());
                match masked {
                    1 => least_of_one_masked::<V, 0>(blocks, masks, fused),
                    2 if V > 1 => least_of_one_masked::<V, 1>(blocks, masks, fused),
                    4 if V > 2 => least_of_one_masked::<V, 2>(blocks, masks, fused),
                    8 if V > 3 => least_of_one_masked::<V, 3>(blocks, masks, fused),
                    _ => least_of_unmasked(blocks, masks, fused),
                }
            },
            Rule::Heuristic if fits && V == 4 => unsafe {
                heuristic_of_unmasked(blocks.as_ptr().cast(), masks.as_ptr().cast(), fused)
            },
            _ => return self.fuse_others_masked(rule, blocks, masks, fused),
        };
        (least as u16).min((least >> 16) as u16)
    }

    #[inline(never)]
    fn least(self, costs: &[[u32; 2]]) -> u16 {
        let mut least = U16x4([u32::MAX; 2]);
        for &costs in costs {
            least = least.min(U16x4(costs));
        }
        least.least()
    }
}

impl Block<u16> for U16x4 {
    type Costs = [u32; 2];
    type Column = U16x4;

    #[inline(always)]
    fn store(self, costs: &mut [u32; 2]) {
        *costs = self.0;
    }

    #[inline(always)]
    fn slide(self, entering: U16x4, leaving: U16x4) -> Self {
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
        let choose = |half: usize| if_not_less(other.0[half], self.0[half], otherwise.0[half], then.0[half]);
        U16x4([choose(0), choose(1)])
    }

    #[inline(always)]
    fn least(self) -> u16 {
        let [a, b] = self.0;
        let least = if_not_less(a, b, b, a);
        (least as u16).min((least >> 16) as u16)
    }
}

impl U16x4 {
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, usub16)
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(u32, u32) -> u32) -> Self {
        U16x4([f(self.0[0], other.0[0]), f(self.0[1], other.0[1])])
    }
}

impl Dsp {
    /// By the other rules. A function of its own, so that the common ones need fewer registers.
    #[inline(never)]
    fn fuse_others<const V: usize>(self, rule: Rule, blocks: &[[[u32; 2]; V]], fused: &mut [[u32; 2]]) -> u16 {
        fuse_generic(self, rule, blocks, fused)
    }

    /// As [`fuse_others`](Dsp::fuse_others), of what masks leave.
    #[inline(never)]
    fn fuse_others_masked<const V: usize>(
        self,
        rule: Rule,
        blocks: &[[[u32; 2]; V]],
        masks: &[[[u32; 2]; V]],
        fused: &mut [[u32; 2]],
    ) -> u16 {
        fuse_masked_generic(self, rule, blocks, masks, fused)
    }
}

impl Blocks<u32> for Dsp {
    type Costs = [u32; 4];
    type Block = U32x4;

    #[inline(always)]
    fn load_block(self, costs: &[u32; 4]) -> U32x4 {
        U32x4(*costs)
    }

    #[inline(always)]
    fn splat(self, cost: u32) -> U32x4 {
        U32x4([cost; 4])
    }

    #[inline(always)]
    fn position(self, costs: &[[u32; 4]], cost: u32) -> usize {
        let lanes = costs.iter().flat_map(|&[a, c, b, d]| [a, b, c, d]);
        lanes.enumerate().find(|&(_, lane)| lane == cost).map_or(4 * costs.len(), |(index, _)| index)
    }
}

impl Block<u32> for U32x4 {
    type Costs = [u32; 4];
    type Column = U16x4;

    #[inline(always)]
    fn store(self, costs: &mut [u32; 4]) {
        *costs = self.0;
    }

    #[inline(always)]
    fn slide(self, entering: U16x4, leaving: U16x4) -> Self {
        let [a, b] = entering.sub(leaving).0;
        self.zip(U32x4([a as i16 as u32, (a as i32 >> 16) as u32, b as i16 as u32, (b as i32 >> 16) as u32]), u32::wrapping_add)
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
        let choose = |lane: usize| if self.0[lane] > other.0[lane] { then.0[lane] } else { otherwise.0[lane] };
        U32x4([choose(0), choose(1), choose(2), choose(3)])
    }

    #[inline(always)]
    fn least(self) -> u32 {
        let [a, b, c, d] = self.0;
        a.min(b).min(c.min(d))
    }
}

impl U32x4 {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(u32, u32) -> u32) -> Self {
        let lane = |lane: usize| f(self.0[lane], other.0[lane]);
        U32x4([lane(0), lane(1), lane(2), lane(3)])
    }
}
