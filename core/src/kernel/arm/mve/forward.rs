//! The paths from the left and from above, through many pixels, in MVE.
#![allow(unsafe_code)]

use super::{
    isa::Mve,
    unrolled::{DEPTH, STRIDE},
};
use crate::kernel::bytes::{ForwardRun, Slot, forward_loop};

/// Pixels whose penalties are looked up before the loop in assembly.
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
