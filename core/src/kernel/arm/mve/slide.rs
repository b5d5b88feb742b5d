//! Column sums move down, and blocks slide, in MVE. With four vectors in a view they slide and are fused to the minimum at once,
//! unrolled.
//!
//! Loads and arithmetic take turns wherever registers allow: vector instructions overlap only if they take different
//! pipelines.
#![allow(unsafe_code)]

use core::arch::asm;

use super::Mve;
use crate::kernel::{
    bytes::Divisor,
    isa::Lane,
    rule::Rule,
    steps::{RawStep, Steps},
};

/// Loads the addresses of the next view's samples at the column: in r2 those that enter, in r3 those that
/// leave.
macro_rules! track {
    () => {
        "ldm {tracks}!, {{r2, r3, r4}}
        mla r2, r4, {index}, r2
        mla r3, r4, {index}, r3"
    };
}

/// Moves vector `j` of view `k` of the entering column down. Leaves its difference to the leaving column in
/// q0, and the block's vector in q1.
macro_rules! advance_column {
    () => {
        "vldrb.u16 q0, [r2, #(8 * \\j)]
        vabd.u16 q0, q0, q2
        vldrh.u16 q1, [{column}, #(16 * ({vectors} * \\k + \\j))]
        vadd.i16 q0, q0, q1
        vldrb.u16 q1, [r3, #(8 * \\j)]
        vabd.u16 q1, q1, q3
        vsub.i16 q0, q0, q1
        vstrh.16 q0, [{column}, #(16 * ({vectors} * \\k + \\j))]
        vldrh.u16 q1, [{leaving_column}, #(16 * ({vectors} * \\k + \\j))]
        vsub.i16 q0, q0, q1
        vldrh.u16 q1, [{block}, #(16 * ({views} * \\j + \\k))]"
    };
}

/// Adds the line that enters to the sums of a column.
///
/// # Safety
/// The step has `vectors` vectors in a view, at least one.
#[inline(always)]
pub(super) unsafe fn prime<const V: usize>(step: RawStep<'_, Mve, V>, vectors: usize) {
    let RawStep { center, index, tracks, entering, .. } = step;
    // SAFETY: the step has samples and sums of `V` views in that many vectors. Every register that changes is
    // an output.
    unsafe {
        asm!(
            "vdup.16 q1, r2",
            "2:",
            "ldm {tracks}!, {{r2, r3, r4}}",
            "mla r2, r4, {index}, r2",
            "dls lr, {n}",
            "3:",
            "vldrb.u16 q0, [r2], #8",
            "vabd.u16 q0, q0, q1",
            "vldrh.u16 q2, [{column}]",
            "vadd.i16 q0, q0, q2",
            "vstrh.16 q0, [{column}], #16",
            "le lr, 3b",
            "cmp {tracks}, {end}",
            "bne 2b",
            n = in(reg) vectors,
            tracks = inout(reg) tracks => _,
            end = in(reg) tracks.wrapping_add(V),
            column = inout(reg) entering => _,
            index = in(reg) index,
            inout("r2") u32::from(center.entering) => _,
            out("r3") _, out("r4") _, out("lr") _, out("q0") _, out("q1") _, out("q2") _,
            options(nostack),
        );
    }
}

/// Adds the differences in q0 to block sums of 32 bits: the even lanes, and the odd ones.
macro_rules! slide_wide {
    ($block:literal) => {
        concat!(
            "vmovlb.s16 q1, q0
            vld20.32 {{q4, q5}}, [",
            $block,
            "]
            vmovlt.s16 q0, q0
            vld21.32 {{q4, q5}}, [",
            $block,
            "]
            vadd.i32 q4, q4, q1
            vadd.i32 q5, q5, q0
            vst20.32 {{q4, q5}}, [",
            $block,
            "]
            vst21.32 {{q4, q5}}, [",
            $block,
            "]"
        )
    };
}

/// [`slide`] with `N` vectors in a view, unrolled: at most 16 in all.
///
/// # Safety
/// The step has as many vectors in a view as there are blocks: `N`.
#[inline(always)]
pub(super) unsafe fn slide_unrolled<L: Lane, const V: usize, const N: usize>(
    step: RawStep<'_, Mve, V>,
    blocks: &mut [[[L; 8]; V]],
) {
    let RawStep { center, index, tracks, entering, leaving, .. } = step;
    // SAFETY: the step has samples and sums of `V` views in that many vectors. Every register that changes is
    // an output.
    unsafe {
        asm_up_to!(1600 bytes,
            "vdup.16 q2, r2",
            "vdup.16 q3, r3",
            ".irp k, 0, 1, 2, 3, 4, 5, 6, 7",
            ".if \\k < {views}",
            track!(),
            ".irp j, 0, 1, 2, 3, 4, 5, 6, 7",
            ".if \\j < {vectors}",
            "vldrb.u16 q0, [r2, #(8 * \\j)]",
            "vabd.u16 q0, q0, q2",
            "vldrb.u16 q1, [r3, #(8 * \\j)]",
            "vabd.u16 q1, q1, q3",
            "vldrh.u16 q4, [{column}, #(16 * ({vectors} * \\k + \\j))]",
            "vsub.i16 q0, q0, q1",
            "vldrh.u16 q1, [{leaving_column}, #(16 * ({vectors} * \\k + \\j))]",
            "vadd.i16 q0, q0, q4",
            "vstrh.16 q0, [{column}, #(16 * ({vectors} * \\k + \\j))]",
            "vsub.i16 q0, q0, q1",
            ".if {bits} == 16",
            "vldrh.u16 q1, [{block}, #(16 * ({views} * \\j + \\k))]",
            "vadd.i16 q0, q0, q1",
            "vstrh.16 q0, [{block}, #(16 * ({views} * \\j + \\k))]",
            ".else",
            "add.w r4, {block}, #(32 * ({views} * \\j + \\k))",
            slide_wide!("r4"),
            ".endif",
            ".endif",
            ".endr",
            ".endif",
            ".endr";
            index = in(reg) index,
            tracks = inout(reg) tracks => _,
            column = in(reg) entering,
            leaving_column = in(reg) leaving,
            block = in(reg) blocks.as_mut_ptr(),
            // Loads that widen take their addresses from low registers.
            inout("r2") u32::from(center.entering) => _,
            inout("r3") u32::from(center.leaving) => _,
            out("r4") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _,
            bits = const 8 * size_of::<L>(),
            views = const V,
            vectors = const N,
            options(nostack),
        );
    }
}

/// Moves a column down by a line and slides the blocks by it.
///
/// # Safety
/// The step has as many vectors in a view as there are blocks, at least one.
#[inline(always)]
pub(super) unsafe fn slide<L: Lane, const V: usize>(step: RawStep<'_, Mve, V>, blocks: &mut [[[L; 8]; V]]) {
    let RawStep { center, index, tracks, entering, leaving, .. } = step;
    // SAFETY: the step has samples and sums of `V` views in that many vectors. Every register that changes is
    // an output.
    unsafe {
        asm!(
            "vdup.16 q2, r2",
            "vdup.16 q3, r3",
            "2:",
            track!(),
            "dls lr, {n}",
            "3:",
            "vldrb.u16 q0, [r2], #8",
            "vabd.u16 q0, q0, q2",
            "vldrb.u16 q1, [r3], #8",
            "vabd.u16 q1, q1, q3",
            "vldrh.u16 q4, [{column}]",
            "vsub.i16 q0, q0, q1",
            "vldrh.u16 q1, [{leaving_column}], #16",
            "vadd.i16 q0, q0, q4",
            "vstrh.16 q0, [{column}], #16",
            "vsub.i16 q0, q0, q1",
            ".if {bits} == 16",
            "vldrh.u16 q1, [{block}]",
            "vadd.i16 q0, q0, q1",
            "vstrh.16 q0, [{block}], #{stride}",
            ".else",
            slide_wide!("{block}"),
            "add {block}, {block}, #{stride}",
            ".endif",
            "le lr, 3b",
            "sub {block}, {block}, {to_next_view}",
            "cmp {tracks}, {end}",
            "bne 2b",
            n = in(reg) blocks.len(),
            index = in(reg) index,
            tracks = inout(reg) tracks => _,
            end = in(reg) tracks.wrapping_add(V),
            column = inout(reg) entering => _,
            leaving_column = inout(reg) leaving => _,
            block = inout(reg) blocks.as_mut_ptr() => _,
            to_next_view = in(reg) size_of_val(blocks) - size_of::<[L; 8]>(),
            // Loads that widen take their addresses from low registers.
            inout("r2") u32::from(center.entering) => _,
            inout("r3") u32::from(center.leaving) => _,
            out("r4") _, out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _,
            bits = const 8 * size_of::<L>(),
            stride = const size_of::<[[L; 8]; V]>(),
            options(nostack),
        );
    }
}

/// True if the loops that fuse are made for a step: the minimum of four views, and four vectors of each.
#[inline(always)]
pub(super) fn suits<const V: usize>(
    rule: Rule,
    steps: &Steps<'_, Mve, V>,
    blocks: &[[[u16; 8]; V]],
    masks: &[[[u16; 8]; V]],
) -> bool {
    V == 4 && rule == Rule::Min && (blocks.len() == 4) & (masks.len() == 4) & (steps.vectors() == 4)
}

/// Calls a function with the views that are masked as a constant: none, one, or any.
macro_rules! by_mask {
    ($masked:expr, $module:ident::$function:ident::<$($generic:ident),+>($($argument:expr),*)) => {
        match $masked {
            0 => $module::$function::<$($generic),+, 0>($($argument),*),
            1 => $module::$function::<$($generic),+, 1>($($argument),*),
            2 => $module::$function::<$($generic),+, 2>($($argument),*),
            4 => $module::$function::<$($generic),+, 4>($($argument),*),
            8 => $module::$function::<$($generic),+, 8>($($argument),*),
            _ => $module::$function::<$($generic),+, 15>($($argument),*),
        }
    };
}

/// Raises costs to their masks, if their view has any: vector `j` of view `k`.
macro_rules! mask_view {
    ($costs:literal) => {
        concat!(
            ".if ({masked} >> \\k) & 1\n",
            "vldrh.u16 q1, [{mask}, #(16 * ({views} * \\j + \\k))]\n",
            concat!("vorr ", $costs, ", ", $costs, ", q1\n"),
            ".endif"
        )
    };
}

/// Moves a column down by a line, slides the blocks by it, and leaves the minimum of their sums in q4 to q7.
macro_rules! slide_to_min {
    () => {
        concat!(
            "vdup.16 q2, r2
            vdup.16 q3, r3
            .irp k, 0, 1, 2, 3
            .if \\k < {views}\n",
            track!(),
            "\n.irp j, 0, 1, 2, 3\n",
            advance_column!(),
            "\n.irp to, 4, 5, 6, 7
            .if \\to == \\j + 4
            .if \\k
            vadd.i16 q0, q0, q1
            vstrh.16 q0, [{block}, #(16 * ({views} * \\j + \\k))]\n",
            mask_view!("q0"),
            "\nvmin.u16 q\\to, q\\to, q0
            .else
            vadd.i16 q\\to, q0, q1
            vstrh.16 q\\to, [{block}, #(16 * ({views} * \\j + \\k))]\n",
            mask_view!("q\\to"),
            "\n.endif
            .endif
            .endr
            .endr
            .endif
            .endr\n"
        )
    };
}

/// `asm!` that begins with [`slide_to_min`], as [`asm_up_to`].
macro_rules! slide_to_min_and {
    ($step:ident, $blocks:ident, $masks:ident, $($template:literal),+; $($operands:tt)*) => {
        asm_up_to!(1200 bytes, slide_to_min!(), $($template),+;
            index = in(reg) $step.index,
            tracks = inout(reg) $step.tracks => _,
            column = in(reg) $step.entering,
            leaving_column = in(reg) $step.leaving,
            block = in(reg) $blocks.as_mut_ptr(),
            mask = in(reg) $masks.as_ptr(),
            // Loads that widen take their addresses from low registers.
            inout("r2") u32::from($step.center.entering) => _,
            inout("r3") u32::from($step.center.leaving) => _,
            out("r4") _,
            out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _, out("q6") _, out("q7") _,
            views = const V,
            vectors = const 4,
            masked = const MASKED,
            $($operands)*
        )
    };
}

/// Moves a column down by a line, slides the blocks by it, and fuses their sums to the minimum, those of the
/// views whose bits are set in `MASKED` being masked. Returns the least fused cost.
///
/// # Safety
/// The step has four vectors in a view, and there are four blocks, masks and fused costs.
#[inline(always)]
pub(super) unsafe fn slide_to_min<const V: usize, const MASKED: u8>(
    step: RawStep<'_, Mve, V>,
    blocks: &mut [[[u16; 8]; V]],
    masks: &[[[u16; 8]; V]],
    fused: &mut [[u16; 8]],
) -> u16 {
    let mut least = u32::from(u16::MAX);
    // SAFETY: the step has samples and sums of `V` views in that many vectors. Every register that changes is
    // an output.
    unsafe {
        slide_to_min_and!(step, blocks, masks,
            ".irp from, 4, 5, 6, 7",
            "vstrh.16 q\\from, [{fused}, #(16 * (\\from - 4))]",
            "vminv.u16 {least}, q\\from",
            ".endr";
            fused = in(reg) fused.as_mut_ptr(),
            least = inout(reg) least,
            options(nostack),
        );
    }
    least as u16
}

/// [`slide_to_min`], with the fused costs divided by `2^shift`.
///
/// # Safety
/// The step has four vectors in a view, and there are four blocks and masks, and 32 quotients.
#[inline(always)]
pub(super) unsafe fn slide_to_quotients<const V: usize, const MASKED: u8>(
    step: RawStep<'_, Mve, V>,
    blocks: &mut [[[u16; 8]; V]],
    masks: &[[[u16; 8]; V]],
    shift: u32,
    quotients: &mut [u8],
) {
    // SAFETY: the step has samples and sums of `V` views in that many vectors. Every register that changes is
    // an output.
    unsafe {
        slide_to_min_and!(step, blocks, masks,
            "movs r2, #{limit}",
            "vdup.16 q0, r2",
            ".irp from, 4, 5, 6, 7",
            "vshl.u16 q\\from, {left}",
            "vmin.u16 q\\from, q\\from, q0",
            "vstrb.16 q\\from, [r0, #(8 * (\\from - 4))]",
            ".endr";
            left = in(reg) (shift as i32).wrapping_neg(),
            limit = const Divisor::LIMIT,
            // Stores that narrow take their addresses from low registers.
            in("r0") quotients.as_mut_ptr(),
            options(nostack),
        );
    }
}
