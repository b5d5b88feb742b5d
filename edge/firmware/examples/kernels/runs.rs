//! Compares paths through runs of pixels.

use multiscopic_core::{
    PathPenalties, SemiGlobalParams,
    kernel::{BackwardRun, ForwardRun, Kernel, RunPenalties, Slot},
};

use super::{
    bytes::{costs, slot},
    operations::TRIALS,
    twin::{Difference, LANES, Twin, Xorshift, same},
};

const MAX_PIXELS: usize = 5;
const MAX_DEPTH: usize = 5 * LANES;
const MAX_STRIDE: usize = Slot::bytes(MAX_DEPTH);

/// The data that runs read and write, with space for the longest. Costs begin at words, as they do in a matcher.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(4))]
struct Buffers {
    costs: [u8; MAX_PIXELS * MAX_DEPTH],
    excess: [u8; MAX_PIXELS * MAX_DEPTH],
    along: [u8; MAX_STRIDE],
    from_above: [[u8; (MAX_PIXELS + 1) * MAX_STRIDE]; 3],
    winners: [(u16, usize); MAX_PIXELS],
}

/// The size of a run, and its penalties.
#[derive(Clone, Copy)]
struct Run {
    pixels: usize,
    depth: usize,
    p1: u8,
    p2: [u8; 256],
    lines: [[u8; MAX_PIXELS]; 2],
}

/// Compares runs of paths.
#[inline(never)]
pub fn compare_runs<K: Kernel>(kernel: K, random: &mut Xorshift) -> Result<(), Difference> {
    for trial in 0..TRIALS {
        let [greater, less] = [(); 2].map(|()| (random.number() >> 3) as u8 % (PathPenalties::MAX + 1));
        // Half of the penalties do not depend on the brightness.
        let edge = if trial % 2 == 0 { 256 } else { 20 };
        let mut p2 = [greater.max(less); 256];
        p2.iter_mut().skip(edge).for_each(|p2| *p2 = greater.min(less));
        let (pixels, depth) = (1 + trial % MAX_PIXELS, (1 + trial / MAX_PIXELS % 5) * LANES);
        let run = Run { pixels, depth, p1: less.min(greater), p2, lines: [random.samples(), random.samples()] };
        let mut found = buffers(random, run);
        let mut expected = found;
        run.forward(kernel, &mut found);
        run.forward(Twin::default(), &mut expected);
        same("paths forward", &found, &expected)?;
        run.backward(kernel, &mut found);
        run.backward(Twin::default(), &mut expected);
        same("a path backward", &found, &expected)?;
    }
    Ok(())
}

/// Random costs and slots.
#[inline(never)]
fn buffers(random: &mut Xorshift, Run { depth, pixels, .. }: Run) -> Buffers {
    let mut buffers = Buffers {
        costs: [0; MAX_PIXELS * MAX_DEPTH],
        excess: [0; MAX_PIXELS * MAX_DEPTH],
        along: [u8::MAX; MAX_STRIDE],
        from_above: [[u8::MAX; (MAX_PIXELS + 1) * MAX_STRIDE]; 3],
        winners: [(0, 0); MAX_PIXELS],
    };
    for pixel in buffers.costs.chunks_exact_mut(depth).take(pixels) {
        pixel.copy_from_slice(&costs(random)[..depth]);
    }
    let stride = Slot::bytes(depth);
    let slots = buffers.from_above.iter_mut().flat_map(|slots| slots.chunks_exact_mut(stride).take(pixels + 1));
    for to in slots.chain([&mut buffers.along[..stride]]) {
        to.copy_from_slice(&slot(random, depth)[..stride]);
    }
    buffers
}

impl Run {
    fn penalties(&self) -> RunPenalties<'_> {
        let Run { p1, p2, lines: [here, above], .. } = self;
        RunPenalties { p1: *p1, p2, here, above }
    }

    #[inline(never)]
    fn forward<K: Kernel>(&self, kernel: K, buffers: &mut Buffers) {
        let (bytes, stride) = (self.pixels * self.depth, Slot::bytes(self.depth));
        let mut spare = [u8::MAX; MAX_STRIDE];
        let along = &mut [&mut buffers.along[..stride], &mut spare[..stride]];
        kernel.extend_forward(ForwardRun {
            start: 0,
            depth: self.depth,
            costs: &buffers.costs[..bytes],
            excess: &mut buffers.excess[..bytes],
            along,
            from_above: buffers.from_above.each_mut().map(|slots| &mut slots[..(self.pixels + 1) * stride]),
            penalties: self.penalties(),
        });
        let last: [u8; MAX_STRIDE] = core::array::from_fn(|i| along[0].get(i).copied().unwrap_or_default());
        buffers.along = last;
    }

    #[inline(never)]
    fn backward<K: Kernel>(&self, kernel: K, buffers: &mut Buffers) {
        let (bytes, stride) = (self.pixels * self.depth, Slot::bytes(self.depth));
        let mut spare = [u8::MAX; MAX_STRIDE];
        let along = &mut [&mut buffers.along[..stride], &mut spare[..stride]];
        let run = BackwardRun {
            depth: self.depth,
            costs: &buffers.costs[..bytes],
            excess: &mut buffers.excess[..bytes],
            along,
            penalties: self.penalties(),
        };
        kernel.extend_backward(SemiGlobalParams::PATHS as u16, run, |pixel| buffers.winners[pixel.column] = pixel.winner);
        let last: [u8; MAX_STRIDE] = core::array::from_fn(|i| along[0].get(i).copied().unwrap_or_default());
        buffers.along = last;
    }
}
