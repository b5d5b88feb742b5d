//! Fused costs in MVE, with the least of all.
#![allow(unsafe_code)]

use super::isa::VECTOR;

/// Loads the costs of a view into `q\q`, if there is such a view, raised to their mask.
///
/// Arithmetic stands between the loads of two views: vector instructions overlap only if they take different
/// pipelines.
macro_rules! load_view {
    () => {
        ".if \\q < {views}
        vldrh.u16 q\\q, [{block}], #16
        .if ({masked} >> \\q) & 1
        vldrh.u16 q5, [{mask}, #16 * \\q]
        vorr q\\q, q\\q, q5
        .endif
        .endif
        "
    };
}

/// Advances to the masks of the next vector.
macro_rules! to_next_masks {
    () => {
        ".if {masked}
        add {mask}, {mask}, #{stride}
        .endif
        "
    };
}

/// The minimum of views, those whose bits are set in `MASKED` being masked. Returns the least fused cost.
///
/// # Safety
/// There are as many blocks as fused costs, not 0, and as many masks unless `MASKED` is 0.
#[inline(always)]
pub(super) unsafe fn min<const V: usize, const MASKED: u8>(
    blocks: *const [[u16; 8]; V],
    masks: *const [[u16; 8]; V],
    fused: &mut [[u16; 8]],
) -> u16 {
    let mut least = u32::from(u16::MAX);
    // SAFETY: reads as many blocks, and masks if there are any, as it writes fused costs. Every register that
    // changes is an output.
    unsafe {
        asm_up_to!(100 bytes,
            "dls lr, {n}",
            "2:",
            ".irp q, 0, 1, 2, 3",
            load_view!(),
            ".if \\q && (\\q < {views})",
            "vmin.u16 q0, q0, q\\q",
            ".endif",
            ".endr",
            to_next_masks!(),
            "vstrh.16 q0, [{fused}], #16",
            "vminv.u16 {least}, q0",
            "le lr, 2b";
            n = in(reg) fused.len(),
            block = inout(reg) blocks => _,
            mask = inout(reg) masks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q5") _,
            views = const V,
            masked = const MASKED,
            stride = const V * VECTOR,
            options(nostack, preserves_flags),
        );
    }
    least as u16
}

/// The heuristic rule over three or four views, those whose bits are set in `MASKED` being masked. Returns
/// the least fused cost.
///
/// # Safety
/// There are as many blocks as fused costs, not 0, and as many masks unless `MASKED` is 0.
#[inline(always)]
pub(super) unsafe fn heuristic<const V: usize, const MASKED: u8>(
    blocks: *const [[u16; 8]; V],
    masks: *const [[u16; 8]; V],
    fused: &mut [[u16; 8]],
) -> u16 {
    let mut least = u32::from(u16::MAX);
    // SAFETY: reads as many blocks, and masks if there are any, as it writes fused costs. Every register that
    // changes is an output; the predicate, of which the compiler is not told, is restored.
    unsafe {
        asm_up_to!(200 bytes,
            "vmrs {before}, p0",
            "dls lr, {n}",
            "2:",
            ".irp q, 0, 1",
            load_view!(),
            ".endr",
            "vmin.u16 q4, q0, q1",
            ".irp q, 2",
            load_view!(),
            ".endr",
            "vmax.u16 q0, q0, q1",
            // Without a fourth view, its cost is the greatest.
            ".if {views} < 4",
            "vmov.i8 q3, #255",
            ".endif",
            ".irp q, 3",
            load_view!(),
            ".endr",
            to_next_masks!(),
            "vmin.u16 q1, q2, q3",
            "vmax.u16 q2, q2, q3",
            // The second and the third lie between the greater minimum and the lesser maximum.
            "vmax.u16 q3, q4, q1",
            "vmin.u16 q4, q4, q1",
            "vmin.u16 q0, q0, q2",
            "vmin.u16 q1, q3, q0",
            "vmax.u16 q3, q3, q0",
            // The sums of two and of three, and three times the second.
            "vqadd.u16 q4, q4, q1",
            "vqadd.u16 q0, q4, q3",
            "vqadd.u16 q2, q1, q1",
            "vqadd.u16 q2, q2, q1",
            "vqadd.u16 q1, q4, q4",
            "vqadd.u16 q4, q4, q1",
            "vqadd.u16 q0, q0, q0",
            "vcmp.u16 hi, q3, q2",
            "vpsel q0, q4, q0",
            "vstrh.16 q0, [{fused}], #16",
            "vminv.u16 {least}, q0",
            "le lr, 2b",
            "vmsr p0, {before}";
            n = in(reg) fused.len(),
            block = inout(reg) blocks => _,
            mask = inout(reg) masks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            before = out(reg) _,
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _,
            views = const V,
            masked = const MASKED,
            stride = const V * VECTOR,
            options(nostack, preserves_flags),
        );
    }
    least as u16
}

/// The sum of two to four views, those whose bits are set in `MASKED` being masked: on the scale of
/// [`Rule::fuse_masked`](crate::kernel::rule::Rule::fuse_masked) if there are any. Returns the least fused cost.
///
/// # Safety
/// There are as many blocks as fused costs, not 0, and as many masks unless `MASKED` is 0.
#[inline(always)]
pub(super) unsafe fn sum<const V: usize, const MASKED: u8>(
    blocks: *const [[u16; 8]; V],
    masks: *const [[u16; 8]; V],
    fused: &mut [[u16; 8]],
) -> u16 {
    let mut least = u32::from(u16::MAX);
    // SAFETY: reads as many blocks, and masks if there are any, as it writes fused costs. Every register that
    // changes is an output; the predicate, of which the compiler is not told, is restored.
    unsafe {
        asm_up_to!(300 bytes,
            "vmrs {before}, p0",
            "dls lr, {n}",
            "2:",
            // Less 1 for each view that is hidden.
            ".if {masked}",
            "vmov.i32 q4, #0",
            ".endif",
            ".irp q, 0, 1, 2, 3",
            ".if \\q < {views}",
            "vldrh.u16 q\\q, [{block}], #16",
            ".if ({masked} >> \\q) & 1",
            "vldrh.u16 q5, [{mask}, #16 * \\q]",
            "vbic q\\q, q\\q, q5",
            "vadd.i16 q4, q4, q5",
            ".endif",
            ".if \\q",
            "vqadd.u16 q0, q0, q\\q",
            ".endif",
            ".endif",
            ".endr",
            to_next_masks!(),
            ".if {masked}",
            ".if {views} == 2",
            "vmov q1, q0",
            ".elseif {views} == 3",
            "vqadd.u16 q1, q0, q0",
            "vqadd.u16 q0, q1, q1",
            ".else",
            "vmov q1, q0",
            "vqadd.u16 q0, q0, q0",
            "vqadd.u16 q0, q0, q1",
            ".endif",
            "vpt.i16 ne, q4, zr",
            "vqaddt.u16 q0, q0, q1",
            ".endif",
            ".if {masked} & ({masked} - 1)",
            // Of four views, 4 times the sum becomes 6 times.
            ".if {views} == 4",
            "vptt.s16 le, q4, {two_hidden}",
            "vqaddt.u16 q0, q0, q1",
            "vqaddt.u16 q0, q0, q1",
            ".endif",
            // All but one view are hidden: 12 times.
            ".if {views} > 2",
            "vpt.s16 le, q4, {all_but_one_hidden}",
            "vqaddt.u16 q0, q0, q0",
            ".endif",
            "vpt.i16 eq, q4, {all_hidden}",
            "vmvnt.i32 q0, #0",
            ".endif",
            "vstrh.16 q0, [{fused}], #16",
            "vminv.u16 {least}, q0",
            "le lr, 2b",
            "vmsr p0, {before}";
            n = in(reg) fused.len(),
            block = inout(reg) blocks => _,
            mask = inout(reg) masks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            least = inout(reg) least,
            before = out(reg) _,
            two_hidden = in(reg) -2,
            all_but_one_hidden = in(reg) 1 - (V as i32),
            all_hidden = in(reg) -(V as i32),
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _,
            views = const V,
            masked = const MASKED,
            stride = const V * VECTOR,
            options(nostack, preserves_flags),
        );
    }
    least as u16
}
