//! Paths through many pixels of 32 disparities, unrolled, in MVE: from the left and from above, then from the right.
#![allow(unsafe_code)]

use super::{
    Mve,
    pixel::{self, AT_ONCE, MOST_PATHS},
};
use crate::kernel::bytes::{BackwardRun, ForwardRun, PixelPaths, Slot, backward_loop, forward_loop};

/// Disparities of a pixel: two vectors of 16.
const DEPTH: usize = 32;

/// Bytes of a slot.
const STRIDE: usize = Slot::bytes(DEPTH);

const _: () = assert!(DEPTH == AT_ONCE);

/// Extends a path by a pixel, from the slot at `$slot` to the one `$to` bytes from there, which may be the
/// same.
///
/// P2 is in q0. The least cost is in the register `$least` before and after. What the path adds to the costs
/// goes through `$first` and `$second`, which leave the path's costs in q5 and q7.
#[rustfmt::skip]
macro_rules! extend_unrolled {
    ($slot:literal, $to:literal, $least:literal, $first:expr, $second:expr) => {
        concat!(
            "vldrb.u8 q5, [", $slot, ", #({lead} - 1)]\n",
            "vldrb.u8 q6, [", $slot, ", #({lead} + 1)]\n",
            "vmin.u8 q5, q5, q6\n",
            "vqadd.u8 q5, q5, {p1}\n",
            "vldrb.u8 q6, [", $slot, ", #{lead}]\n",
            "vmin.u8 q5, q5, q6\n",
            // The least is taken away first, so that P2 does not have to be added to it.
            "vqsub.u8 q5, q5, ", $least, "\n",
            $first,
            // The last of the first vector's costs is read before they are overwritten.
            "vldrb.u8 q7, [", $slot, ", #({lead} + 15)]\n",
            "vstrb.8 q5, [", $slot, ", #({lead} + ", $to, ")]\n",
            "vldrb.u8 q6, [", $slot, ", #({lead} + 17)]\n",
            "vmin.u8 q7, q7, q6\n",
            "vqadd.u8 q7, q7, {p1}\n",
            "vldrb.u8 q6, [", $slot, ", #({lead} + 16)]\n",
            "vmin.u8 q7, q7, q6\n",
            "vqsub.u8 q7, q7, ", $least, "\n",
            $second,
            "vstrb.8 q7, [", $slot, ", #({lead} + 16 + ", $to, ")]\n",
            "vmin.u8 q7, q7, q5\n",
            "mov ", $least, ", #255\n",
            "vminv.u8 ", $least, ", q7\n",
        )
    };
}

/// Pixels whose penalties are looked up before the loops in assembly, and whose winners are found before any is handed over.
const PIXELS: usize = 32;

/// [`RunLoops::extend_forward`](crate::kernel::RunLoops::extend_forward).
#[inline]
pub(super) fn forward(mve: Mve, run: ForwardRun<'_, '_>) {
    let pixels = run.costs.len() / DEPTH;
    let fits = run.depth == DEPTH
        && run.costs.len() == pixels * DEPTH
        && run.excess.len() == run.costs.len()
        && run.along[0].len() == STRIDE
        && run.from_above.iter().all(|slots| slots.len() == (pixels + 1) * STRIDE);
    if !fits {
        return forward_loop(mve, run);
    }
    let ForwardRun { start, costs, excess, along, mut from_above, penalties, .. } = run;
    if let Some(p2) = penalties.constant_p2() {
        if pixels > 0 {
            // SAFETY: `fits`.
            unsafe { forward_unrolled::<false>(pixels, penalties.p1, &[p2], costs, excess, along[0], from_above) }
        }
        return;
    }
    let mut p2 = [[0; 4]; PIXELS];
    let parts = costs.chunks(PIXELS * DEPTH).zip(excess.chunks_mut(PIXELS * DEPTH));
    for ((costs, excess), first) in parts.zip((0..).step_by(PIXELS)) {
        let pixels = costs.len() / DEPTH;
        for (p2, u) in p2.iter_mut().zip(start + first..start + first + pixels) {
            *p2 = penalties.forward_p2(u);
        }
        let slots = from_above.each_mut().map(|slots| slots.get_mut(first * STRIDE..).unwrap_or_default());
        // SAFETY: `fits`, for some of the pixels.
        unsafe { forward_unrolled::<true>(pixels, penalties.p1, p2.as_flattened(), costs, excess, along[0], slots) }
    }
}

/// The first path of a pixel: what it adds to the costs goes into q3 and q4. Costs are in q1 and q2.
macro_rules! extend_first {
    ($slot:literal, $to:literal, $least:literal) => {
        extend_unrolled!(
            $slot,
            $to,
            $least,
            "vmin.u8 q3, q5, q0
            vqadd.u8 q5, q3, q1\n",
            "vmin.u8 q4, q7, q0
            vqadd.u8 q7, q4, q2\n"
        )
    };
}

/// Any other path of a pixel: what it adds to the costs is added to q3 and q4.
macro_rules! extend_next {
    ($slot:literal, $to:literal, $least:literal) => {
        extend_unrolled!(
            $slot,
            $to,
            $least,
            "vmin.u8 q5, q5, q0
            vqadd.u8 q3, q3, q5
            vqadd.u8 q5, q5, q1\n",
            "vmin.u8 q7, q7, q0
            vqadd.u8 q4, q4, q7
            vqadd.u8 q7, q7, q2\n"
        )
    };
}

/// The next pixel of a path from above, whose slot is at `$slot` when it is done.
macro_rules! extend_from_above {
    ($slot:literal) => {
        concat!(
            "ldrb {scratch}, [",
            $slot,
            ", #{stride}]!\n",
            extend_next!($slot, "-{stride}", "{scratch}"),
            "strb {scratch}, [",
            $slot,
            ", #-{stride}]\n",
        )
    };
}

/// Loads P2 of the next path, if it depends on the brightness.
macro_rules! next_p2 {
    () => {
        ".if {edges}
        ldrb {scratch}, [{p2}], #1
        vdup.8 q0, {scratch}
        .endif\n"
    };
}

/// Extends the paths from the left and from above through a run of pixels. P2 is a single one, or if `EDGES`
/// is set, those of each pixel's four paths.
///
/// # Safety
/// There are [`DEPTH`] costs and excess for each of the `pixels`, at least one; `along` is a slot, and
/// `from_above` are a slot more than pixels.
#[inline(always)]
unsafe fn forward_unrolled<const EDGES: bool>(
    pixels: usize,
    p1: u8,
    p2: &[u8],
    costs: &[u8],
    excess: &mut [u8],
    along: &mut [u8],
    from_above: [&mut [u8]; 3],
) {
    let [a, b, c] = from_above.map(|slots| slots.as_mut_ptr());
    let mut least = along.first().copied().map_or(0, u32::from);
    // SAFETY: for each pixel, reads its penalties and costs, writes as much excess, and reads and writes the
    // slots. Every register that changes is an output.
    unsafe {
        asm_up_to!(500 bytes,
            "ldrb {scratch}, [{p2}]",
            "vdup.8 q0, {scratch}",
            "dls lr, lr",
            "2:",
            "vldrb.u8 q1, [{costs}], #16",
            "vldrb.u8 q2, [{costs}], #16",
            next_p2!(),
            extend_first!("{along}", "0", "{least}"),
            next_p2!(),
            extend_from_above!("{a}"),
            next_p2!(),
            extend_from_above!("{b}"),
            next_p2!(),
            extend_from_above!("{c}"),
            "vstrb.8 q3, [{excess}], #16",
            "vstrb.8 q4, [{excess}], #16",
            "le lr, 2b";
            p1 = in(reg) u32::from(p1),
            p2 = inout(reg) p2.as_ptr() => _,
            scratch = out(reg) _,
            costs = inout(reg) costs.as_ptr() => _,
            excess = inout(reg) excess.as_mut_ptr() => _,
            along = in(reg) along.as_mut_ptr(),
            least = inout(reg) least,
            a = inout(reg) a => _,
            b = inout(reg) b => _,
            c = inout(reg) c => _,
            inout("lr") pixels => _,
            out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _, out("q6") _, out("q7") _,
            lead = const Slot::LEAD,
            stride = const STRIDE,
            edges = const EDGES as u8,
            options(nostack, preserves_flags),
        );
    }
    along.iter_mut().take(1).for_each(|slot| *slot = least as u8);
}

/// [`RunLoops::extend_backward`](crate::kernel::RunLoops::extend_backward).
#[inline(always)]
pub(super) fn backward(mve: Mve, paths: u16, run: BackwardRun<'_, '_>, mut reach: impl FnMut(PixelPaths<'_>)) {
    if run.depth != DEPTH || paths > MOST_PATHS || run.along[0].len() != STRIDE {
        return backward_loop(mve, paths, run, reach);
    }
    let BackwardRun { costs, excess, along, penalties, .. } = run;
    let (costs, excess) = (costs.as_chunks::<DEPTH>().0, excess.as_chunks_mut::<DEPTH>().0);
    let constant = penalties.constant_p2();
    let (mut p2, mut keys) = ([constant.unwrap_or_default(); PIXELS], [0; PIXELS]);
    let mut end = costs.len().min(excess.len());
    while end > 0 {
        let start = end.saturating_sub(PIXELS);
        let (Some(costs), Some(excess)) = (costs.get(start..end), excess.get_mut(start..end)) else { return };
        let (Some(p2), Some(keys)) = (p2.get_mut(..end - start), keys.get_mut(..end - start)) else { return };
        let (all_costs, all_excess) = (costs.as_flattened(), excess.as_flattened_mut());
        if constant.is_none() {
            p2.iter_mut().zip(start..).for_each(|(p2, u)| *p2 = penalties.backward_p2(u));
            // SAFETY: there are as many pixels as penalties and keys, not 0, and a slot.
            unsafe { backward_unrolled::<true>(paths, penalties.p1, p2, all_costs, all_excess, along[0], keys) }
        } else {
            // SAFETY: there are as many pixels as keys, not 0, and a slot.
            unsafe { backward_unrolled::<false>(paths, penalties.p1, p2, all_costs, all_excess, along[0], keys) }
        }
        for (i, ((costs, excess), &mut key)) in costs.iter().zip(&*excess).zip(keys).enumerate() {
            reach(PixelPaths { column: start + i, costs, excess, winner: pixel::unpack(key.into()) });
        }
        end = start;
    }
}
/// Extends the path from the right through pixels, the last first, and writes the [keys](super::pixel) of
/// their winners. P2 is a single one, or if `EDGES` is set, that of each pixel.
///
/// # Safety
/// There are [`DEPTH`] costs and excess for each key, at least one, and `along` is a slot. Paths are at most
/// [`MOST_PATHS`].
#[inline(always)]
unsafe fn backward_unrolled<const EDGES: bool>(
    paths: u16,
    p1: u8,
    p2: &[u8],
    costs: &[u8],
    excess: &mut [u8],
    along: &mut [u8],
    keys: &mut [u16],
) {
    let mut least = along.first().copied().map_or(0, u32::from);
    // SAFETY: for each key, reads the penalty and the costs of a pixel, reads and writes as much excess and the
    // slot. Every register that changes is an output.
    unsafe {
        asm_up_to!(300 bytes,
            "ldrb r2, [{p2}, #-1]",
            "vdup.8 q0, r2",
            "movs r2, #0",
            "vidup.u16 q4, r2, #1",
            "movs r2, #{depth}",
            "vdup.16 q2, r2",
            "dls lr, lr",
            "2:",
            ".if {edges}",
            "ldrb r2, [{p2}, #-1]!",
            "vdup.8 q0, r2",
            ".endif",
            extend_unrolled!(
                "{along}", "0", "{least}",
                "vmin.u8 q5, q5, q0
                vldrb.u8 q3, [r0, #-{depth}]!
                vldrb.u8 q1, [r1, #-{depth}]!
                vqadd.u8 q3, q3, q5
                vqadd.u8 q5, q5, q1
                vstrb.8 q3, [r0]\n",
                "vmin.u8 q7, q7, q0
                vldrb.u8 q3, [r0, #16]
                vldrb.u8 q1, [r1, #16]
                vqadd.u8 q3, q3, q7
                vqadd.u8 q7, q7, q1
                vstrb.8 q3, [r0, #16]\n"
            ),
            // The sums of eight disparities, times 32, and plus the index of the first of them.
            "vldrb.u16 q1, [r0]",
            "vldrb.u16 q3, [r1]",
            "vmla.i16 q1, q3, {paths}",
            "vmul.i16 q1, q1, q2",
            ".irp j, 8, 16, 24",
            "vldrb.u16 q3, [r0, #\\j]",
            "vldrb.u16 q5, [r1, #\\j]",
            "vmla.i16 q3, q5, {paths}",
            ".if \\j == 8",
            "vmlas.i16 q3, q2, {at8}",
            ".elseif \\j == 16",
            "vmlas.i16 q3, q2, {at16}",
            ".else",
            "vmlas.i16 q3, q2, {at24}",
            ".endif",
            "vmin.u16 q1, q1, q3",
            ".endr",
            "vadd.i16 q1, q1, q4",
            "movw r2, #0xffff",
            "vminv.u16 r2, q1",
            "strh r2, [{keys}, #-2]!",
            "le lr, 2b";
            p1 = in(reg) u32::from(p1),
            p2 = inout(reg) p2.as_ptr_range().end => _,
            paths = in(reg) u32::from(paths),
            at8 = in(reg) 8,
            at16 = in(reg) 16,
            at24 = in(reg) 24,
            along = in(reg) along.as_mut_ptr(),
            least = inout(reg) least,
            keys = inout(reg) keys.as_mut_ptr().wrapping_add(keys.len()) => _,
            // Loads that widen take their addresses from low registers, and indices count in even ones.
            inout("r0") excess.as_mut_ptr().wrapping_add(excess.len()) => _,
            inout("r1") costs.as_ptr().wrapping_add(costs.len()) => _,
            out("r2") _,
            inout("lr") keys.len() => _,
            out("q0") _, out("q1") _, out("q2") _, out("q3") _, out("q4") _, out("q5") _, out("q6") _, out("q7") _,
            lead = const Slot::LEAD,
            depth = const DEPTH,
            edges = const EDGES as u8,
            options(nostack),
        );
    }
    along.iter_mut().take(1).for_each(|slot| *slot = least as u8);
}
