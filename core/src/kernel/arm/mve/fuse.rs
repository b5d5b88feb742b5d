//! Fused costs in MVE, with the least of all.
#![allow(unsafe_code)]

use crate::kernel::isa::Lane;

/// [`asm_up_to!`] for a loop over the blocks of a pixel, with the operands that all of them have: `{n}` blocks from `{block}`
/// on, their masks from `{mask}` on, the costs to be written from `{fused}` on, and the `{least}` of them. Those of one
/// loop alone follow.
macro_rules! fuse_blocks {
    ([$blocks:ident $(, $masks:ident)? -> $fused:ident, $least:ident] $bytes:literal bytes, $($template:expr),+; $($operands:tt)*) => {
        asm_up_to!($bytes bytes, $($template),+;
            n = in(reg) $fused.len(),
            block = inout(reg) $blocks => _,
            $(mask = inout(reg) $masks => _,)?
            fused = inout(reg) $fused.as_mut_ptr() => _,
            least = inout(reg) $least,
            $($operands)*
        )
    };
}

/// A loop over the vectors of fused costs, whose lanes have `{bits}` bits: eight lanes are one vector or two.
macro_rules! for_each_vector {
    ($($body:expr),+) => {
        concat!(
            "dls lr, {n}
            2:
            .irp half, 0, 1
            .if \\half < {bits} / 16\n",
            $($body, "\n",)+
            ".endif
            .endr
            le lr, 2b"
        )
    };
}

/// Loads a vector that is aligned to its lanes.
macro_rules! load {
    ($q:literal, $from:literal) => {
        concat!(".if {bits} == 16\nvldrh.u16 ", $q, ", ", $from, "\n.else\nvldrw.u32 ", $q, ", ", $from, "\n.endif\n")
    };
}

/// Adds costs, if `$then` is "t" where the predicate says so. Lanes of 16 bits saturate.
macro_rules! add {
    ($then:literal, $to:literal, $a:literal, $b:literal) => {
        concat!(
            concat!(".if {bits} == 16\nvqadd", $then, ".u16 ", $to, ", ", $a, ", ", $b),
            concat!("\n.else\nvadd", $then, ".i32 ", $to, ", ", $a, ", ", $b, "\n.endif")
        )
    };
    ($to:literal, $a:literal, $b:literal) => {
        add!("", $to, $a, $b)
    };
}

/// Loads the costs of a view into `q\q`, if there is such a view, and applies its mask by way of q5: raises costs to it, or does
/// what is given.
///
/// Eight lanes take as many bytes as a lane has bits. After the last view, the next vector is at the first or follows this one.
///
/// Arithmetic stands between the loads of two views: vector instructions overlap only if they take different
/// pipelines.
macro_rules! load_view {
    ($($mask:literal),+) => {
        concat!(
            ".if \\q < {views}
            .if \\q < {views} - 1\n",
            load!("q\\q", "[{block}], #{bits}"),
            ".elseif \\half + 1 < {bits} / 16\n",
            load!("q\\q", "[{block}], #(16 - {bits} * ({views} - 1))"),
            ".else\n",
            load!("q\\q", "[{block}], #16"),
            ".endif
            .if ({masked} >> \\q) & 1\n",
            load!("q5", "[{mask}, #({bits} * \\q)]"),
            $($mask, "\n",)+
            ".endif
            .endif"
        )
    };
    () => { load_view!("vorr q\\q, q\\q, q5") };
}

/// Advances to the masks of the next vector, stores fused costs, and takes the least of them.
macro_rules! finish_vector {
    () => {
        ".if {masked}
        .if \\half + 1 < {bits} / 16
        add {mask}, {mask}, #16
        .else
        add {mask}, {mask}, #({bits} * ({views} - 1) + 16)
        .endif
        .endif
        .if {bits} == 16
        vstrh.16 q0, [{fused}], #16
        .else
        vstrw.32 q0, [{fused}], #16
        .endif
        vminv.u{bits} {least}, q0"
    };
}

/// The minimum of up to four views, those whose bits are set in `MASKED` being masked. Returns the least fused cost.
///
/// # Safety
/// There are as many blocks as fused costs, not 0, and as many masks unless `MASKED` is 0.
#[inline(always)]
pub(super) unsafe fn min<L: Lane, const V: usize, const MASKED: u8>(
    blocks: *const [[L; 8]; V],
    masks: *const [[L; 8]; V],
    fused: &mut [[L; 8]],
) -> L {
    let mut least = L::MAX.widen();
    // SAFETY: reads as many blocks, and masks if there are any, as it writes fused costs. Every register that
    // changes is an output.
    unsafe {
        fuse_blocks!([blocks, masks -> fused, least] 200 bytes,
            for_each_vector!(
                ".irp q, 0, 1, 2, 3",
                load_view!(),
                ".if \\q && (\\q < {views})",
                "vmin.u{bits} q0, q0, q\\q",
                ".endif",
                ".endr",
                finish_vector!()
            );
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q5") _,
            bits = const 8 * size_of::<L>(),
            views = const V,
            masked = const MASKED,
            options(nostack, preserves_flags),
        );
    }
    L::from_index(least as usize)
}

/// Loads the costs of the next view into `$q`, raised by way of `$masks` to their mask if the views are masked.
#[rustfmt::skip]
macro_rules! load_next_view {
    ($q:literal, $masks:literal) => {
        concat!(
            "vldrh.u16 ", $q, ", [{block}], #16\n",
            ".if {masked}\n",
            "vldrh.u16 ", $masks, ", [{mask}], #16\n",
            "vorr ", $q, ", ", $q, ", ", $masks, "\n",
            ".endif\n",
        )
    };
}

/// The minimum of eight views, masked if `MASKED` is set. Returns the least fused cost.
///
/// # Safety
/// There are as many blocks as fused costs, not 0, and as many masks if `MASKED` is set.
#[inline(always)]
pub(super) unsafe fn min_of_eight<const MASKED: bool>(
    blocks: *const [[u16; 8]; 8],
    masks: *const [[u16; 8]; 8],
    fused: &mut [[u16; 8]],
) -> u16 {
    let mut least = u32::from(u16::MAX);
    // SAFETY: reads as many blocks, and masks if there are any, as it writes fused costs. Every register that
    // changes is an output.
    unsafe {
        fuse_blocks!([blocks, masks -> fused, least] 200 bytes,
            "dls lr, {n}",
            "2:",
            load_next_view!("q0", "q3"),
            ".rept 3",
            load_next_view!("q1", "q3"),
            "vmin.u16 q0, q0, q1",
            load_next_view!("q2", "q3"),
            "vmin.u16 q0, q0, q2",
            ".endr",
            load_next_view!("q1", "q3"),
            "vmin.u16 q0, q0, q1",
            "vstrh.16 q0, [{fused}], #16",
            "vminv.u16 {least}, q0",
            "le lr, 2b";
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _,
            masked = const MASKED as u8,
            options(nostack, preserves_flags),
        );
    }
    least as u16
}

/// Loads the costs of three or four views. Leaves the least in q4, the second in q1, and the third as the greater of q0 and q3.
macro_rules! sort_least_two {
    () => {
        concat!(
            ".irp q, 0, 1\n",
            load_view!(),
            "\n.endr
            vmin.u{bits} q4, q0, q1
            .irp q, 2\n",
            load_view!(),
            // Without a fourth view, its cost is the greatest.
            "\n.endr
            vmax.u{bits} q0, q0, q1
            .if {views} < 4
            vmov.i8 q3, #255
            .endif
            .irp q, 3\n",
            load_view!(),
            // The second and the third lie between the greater minimum and the lesser maximum.
            "\n.endr
            vmin.u{bits} q1, q2, q3
            vmax.u{bits} q2, q2, q3
            vmax.u{bits} q3, q4, q1
            vmin.u{bits} q4, q4, q1
            vmin.u{bits} q0, q0, q2
            vmin.u{bits} q1, q3, q0"
        )
    };
}

/// The heuristic rule over three or four views, those whose bits are set in `MASKED` being masked. Returns
/// the least fused cost.
///
/// # Safety
/// There are as many blocks as fused costs, not 0, and as many masks unless `MASKED` is 0.
#[inline(always)]
pub(super) unsafe fn heuristic<L: Lane, const V: usize, const MASKED: u8>(
    blocks: *const [[L; 8]; V],
    masks: *const [[L; 8]; V],
    fused: &mut [[L; 8]],
) -> L {
    let mut least = L::MAX.widen();
    // SAFETY: reads as many blocks, and masks if there are any, as it writes fused costs. Every register that
    // changes is an output; the predicate, of which the compiler is not told, is restored.
    unsafe {
        fuse_blocks!([blocks, masks -> fused, least] 400 bytes,
            "vmrs {before}, p0",
            for_each_vector!(
                sort_least_two!(),
                "vmax.u{bits} q3, q3, q0",
                // The sum of two, three times the second, and twice the third.
                add!("q4", "q4", "q1"),
                ".if {bits} == 16",
                add!("q2", "q1", "q1"),
                add!("q2", "q2", "q1"),
                ".else",
                "vmul.i32 q2, q1, {three}",
                ".endif",
                add!("q1", "q3", "q3"),
                "vcmp.u{bits} hi, q3, q2",
                // Three times the sum of two, or twice that of three.
                ".if {bits} == 16",
                add!("q0", "q4", "q4"),
                "vpsel q1, q4, q1",
                add!("q0", "q0", "q1"),
                ".else",
                "vpsel q0, q4, q1",
                "vmla.i32 q0, q4, {two}",
                ".endif",
                finish_vector!()
            ),
            "vmsr p0, {before}";
            before = out(reg) _,
            two = in(reg) 2,
            three = in(reg) 3,
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _,
            bits = const 8 * size_of::<L>(),
            views = const V,
            masked = const MASKED,
            options(nostack, preserves_flags),
        );
    }
    L::from_index(least as usize)
}

/// The sum of the least two of three or four views, those whose bits are set in `MASKED` being masked: of two or one that are
/// left, twice the least. Returns the least fused cost.
///
/// # Safety
/// There are as many blocks as fused costs, not 0, and as many masks unless `MASKED` is 0.
#[inline(always)]
pub(super) unsafe fn half<L: Lane, const V: usize, const MASKED: u8>(
    blocks: *const [[L; 8]; V],
    masks: *const [[L; 8]; V],
    fused: &mut [[L; 8]],
) -> L {
    let mut least = L::MAX.widen();
    // SAFETY: reads as many blocks, and masks if there are any, as it writes fused costs. Every register that
    // changes is an output; the predicate, of which the compiler is not told, is restored.
    unsafe {
        fuse_blocks!([blocks, masks -> fused, least] 400 bytes,
            "vmrs {before}, p0",
            for_each_vector!(
                sort_least_two!(),
                ".if {masked}",
                "vmax.u{bits} q3, q3, q0",
                "vcmp.i{bits} eq, q3, {maximum}",
                "vpsel q1, q4, q1",
                ".endif",
                "vqadd.u{bits} q0, q4, q1",
                finish_vector!()
            ),
            "vmsr p0, {before}";
            before = out(reg) _,
            maximum = in(reg) u32::MAX,
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _,
            bits = const 8 * size_of::<L>(),
            views = const V,
            masked = const MASKED,
            options(nostack, preserves_flags),
        );
    }
    L::from_index(least as usize)
}

/// The sum of two to four views, those whose bits are set in `MASKED` being masked: on the scale of
/// [`Rule::fuse_masked`](crate::kernel::rule::Rule::fuse_masked) if there are any. Returns the least fused cost.
///
/// # Safety
/// There are as many blocks as fused costs, not 0, and as many masks unless `MASKED` is 0.
#[inline(always)]
pub(super) unsafe fn sum<L: Lane, const V: usize, const MASKED: u8>(
    blocks: *const [[L; 8]; V],
    masks: *const [[L; 8]; V],
    fused: &mut [[L; 8]],
) -> L {
    let mut least = L::MAX.widen();
    // SAFETY: reads as many blocks, and masks if there are any, as it writes fused costs. Every register that
    // changes is an output; the predicate, of which the compiler is not told, is restored.
    unsafe {
        fuse_blocks!([blocks, masks -> fused, least] 600 bytes,
            "vmrs {before}, p0",
            for_each_vector!(
                // Less 1 for each view that is hidden.
                ".if {masked}",
                "vmov.i32 q4, #0",
                ".endif",
                ".irp q, 0, 1, 2, 3",
                load_view!("vbic q\\q, q\\q, q5", "vadd.i{bits} q4, q4, q5"),
                ".if \\q && (\\q < {views})",
                add!("q0", "q0", "q\\q"),
                ".endif",
                ".endr",
                ".if {masked}",
                ".if {views} == 2",
                "vmov q1, q0",
                ".elseif {views} == 3",
                add!("q1", "q0", "q0"),
                add!("q0", "q1", "q1"),
                ".else",
                "vmov q1, q0",
                add!("q0", "q0", "q0"),
                add!("q0", "q0", "q1"),
                ".endif",
                "vpt.i{bits} ne, q4, zr",
                add!("t", "q0", "q0", "q1"),
                ".endif",
                ".if {masked} & ({masked} - 1)",
                // Of four views, 4 times the sum becomes 6 times.
                ".if {views} == 4",
                "vptt.s{bits} le, q4, {two_hidden}",
                add!("t", "q0", "q0", "q1"),
                add!("t", "q0", "q0", "q1"),
                ".endif",
                // All but one view are hidden: 12 times.
                ".if {views} > 2",
                "vpt.s{bits} le, q4, {all_but_one_hidden}",
                add!("t", "q0", "q0", "q0"),
                ".endif",
                "vpt.i{bits} eq, q4, {all_hidden}",
                "vmvnt.i32 q0, #0",
                ".endif",
                finish_vector!()
            ),
            "vmsr p0, {before}";
            before = out(reg) _,
            two_hidden = in(reg) -2,
            all_but_one_hidden = in(reg) 1 - (V as i32),
            all_hidden = in(reg) -(V as i32),
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _,
            bits = const 8 * size_of::<L>(),
            views = const V,
            masked = const MASKED,
            options(nostack, preserves_flags),
        );
    }
    L::from_index(least as usize)
}

/// The lesser lanes of two vectors in `$t`, and the greater ones in place of the first. The second is free.
macro_rules! exchange {
    ($a:literal, $b:literal, $t:literal) => {
        concat!("vmin.u16 ", $t, ", ", $a, ", ", $b, "\n", "vmax.u16 ", $a, ", ", $a, ", ", $b, "\n")
    };
}

/// Sorts four vectors, lane by lane: `$d` then has the least, and `$c`, `$t` and `$a` follow. `$b` is free.
macro_rules! sort_four {
    ($a:literal, $b:literal, $c:literal, $d:literal, $t:literal) => {
        concat!(exchange!($a, $b, $t), exchange!($c, $d, $b), exchange!($t, $b, $d), exchange!($a, $c, $b), exchange!($t, $b, $c))
    };
}

/// The sum of the least half of eight views. Returns the least fused cost.
///
/// # Safety
/// There are as many blocks as fused costs, not 0.
#[inline(always)]
pub(super) unsafe fn half_of_eight(blocks: *const [[u16; 8]; 8], fused: &mut [[u16; 8]]) -> u16 {
    let mut least = u32::from(u16::MAX);
    // SAFETY: reads as many blocks as it writes fused costs. Every register that changes is an output.
    unsafe {
        fuse_blocks!([blocks -> fused, least] 300 bytes,
            "dls lr, {n}",
            "2:",
            "vldrh.u16 q0, [{block}], #16",
            "vldrh.u16 q1, [{block}], #16",
            "vldrh.u16 q2, [{block}], #16",
            "vldrh.u16 q3, [{block}], #16",
            sort_four!("q0", "q1", "q2", "q3", "q4"),
            // All eight registers are taken: the greatest of the first four waits where the fused costs will be.
            "vstrh.16 q0, [{fused}]",
            "vldrh.u16 q1, [{block}], #16",
            "vldrh.u16 q5, [{block}], #16",
            "vldrh.u16 q6, [{block}], #16",
            "vldrh.u16 q7, [{block}], #16",
            sort_four!("q1", "q5", "q6", "q7", "q0"),
            // The least four are the lesser of each cost in one and its counterpart in the other, counted from the end.
            "vldrh.u16 q5, [{fused}]",
            "vmin.u16 q3, q3, q1",
            "vmin.u16 q2, q2, q0",
            "vmin.u16 q4, q4, q6",
            "vmin.u16 q5, q5, q7",
            "vqadd.u16 q3, q3, q2",
            "vqadd.u16 q4, q4, q5",
            "vqadd.u16 q0, q3, q4",
            "vstrh.16 q0, [{fused}], #16",
            "vminv.u16 {least}, q0",
            "le lr, 2b";
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _, out("q6") _,
            out("q7") _,
            options(nostack, preserves_flags),
        );
    }
    least as u16
}

/// Loads the costs of the next view into `$q`, raised to their masks, which pass through q4. Takes 1 off q5 where the
/// view is hidden.
#[rustfmt::skip]
macro_rules! load_masked {
    ($q:literal) => {
        concat!(
            "vldrh.u16 q4, [{mask}], #16\n",
            "vadd.i16 q5, q5, q4\n",
            "vldrh.u16 ", $q, ", [{block}], #16\n",
            "vorr ", $q, ", ", $q, ", q4\n",
        )
    };
}

/// The mean of the least half of those of eight views that masks do not hide, on the scale of
/// [`Rule::fuse_available`](crate::kernel::rule::Rule::fuse_available). Returns the least fused cost.
///
/// # Safety
/// There are as many blocks and masks as fused costs, not 0.
#[inline(always)]
pub(super) unsafe fn half_of_eight_masked(
    blocks: *const [[u16; 8]; 8],
    masks: *const [[u16; 8]; 8],
    fused: &mut [[u16; 8]],
) -> u16 {
    let mut least = u32::from(u16::MAX);
    let mut spilled = [[0u16; 8]; 2];
    // SAFETY: reads as many blocks and masks as it writes fused costs. Every register that changes is an output; the
    // predicate, of which the compiler is not told, is restored.
    unsafe {
        asm_up_to!(500 bytes,
            "vmrs {before}, p0",
            "dls lr, {n}",
            "2:",
            "vmov.i32 q5, #0",
            load_masked!("q0"),
            load_masked!("q1"),
            load_masked!("q2"),
            load_masked!("q3"),
            sort_four!("q0", "q1", "q2", "q3", "q4"),
            "vstrh.16 q4, [{spilled}]",
            "vstrh.16 q0, [{spilled}, #16]",
            load_masked!("q0"),
            load_masked!("q1"),
            load_masked!("q6"),
            load_masked!("q7"),
            sort_four!("q0", "q1", "q6", "q7", "q4"),
            // The least four are the lesser of each cost in one and its counterpart in the other, counted from the end.
            "vmin.u16 q3, q3, q0",
            "vldrh.u16 q0, [{spilled}, #16]",
            "vmin.u16 q2, q2, q4",
            "vldrh.u16 q1, [{spilled}]",
            "vmin.u16 q1, q1, q6",
            "vmin.u16 q0, q0, q7",
            // Sorted: q0, q4, q1, q3.
            exchange!("q3", "q1", "q4"),
            exchange!("q2", "q0", "q1"),
            exchange!("q4", "q1", "q0"),
            exchange!("q3", "q2", "q1"),
            // The sums of one to four, times 12, 6, 4 and 3.
            "vqadd.u16 q4, q0, q4",
            "vqadd.u16 q1, q4, q1",
            "vqadd.u16 q3, q1, q3",
            "vqadd.u16 q2, q3, q3",
            "vqadd.u16 q3, q2, q3",
            "vqadd.u16 q1, q1, q1",
            "vqadd.u16 q1, q1, q1",
            "vqadd.u16 q2, q4, q4",
            "vqadd.u16 q4, q2, q4",
            "vqadd.u16 q4, q4, q4",
            "vqadd.u16 q2, q0, q0",
            "vqadd.u16 q0, q2, q0",
            "vqadd.u16 q0, q0, q0",
            "vqadd.u16 q0, q0, q0",
            "vcmp.s16 le, q5, {two_hidden}",
            "vpsel q3, q1, q3",
            "vcmp.s16 le, q5, {four_hidden}",
            "vpsel q3, q4, q3",
            "vcmp.s16 le, q5, {six_hidden}",
            "vpsel q3, q0, q3",
            "vpt.i16 eq, q5, {all_hidden}",
            "vmvnt.i32 q3, #0",
            "vstrh.16 q3, [{fused}], #16",
            "vminv.u16 {least}, q3",
            "le lr, 2b",
            "vmsr p0, {before}";
            n = in(reg) fused.len(),
            block = inout(reg) blocks => _,
            mask = inout(reg) masks => _,
            fused = inout(reg) fused.as_mut_ptr() => _,
            spilled = in(reg) spilled.as_mut_ptr(),
            least = inout(reg) least,
            before = out(reg) _,
            two_hidden = in(reg) -2,
            four_hidden = in(reg) -4,
            six_hidden = in(reg) -6,
            all_hidden = in(reg) -8,
            out("lr") _, out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _, out("q6") _,
            out("q7") _,
            options(nostack, preserves_flags),
        );
    }
    least as u16
}
