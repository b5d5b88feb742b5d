//! Compares the operations on 8-bit costs: on random vectors, and on paths through runs of pixels.

use multiscopic_core::{
    PathPenalties, SemiGlobalParams,
    kernel::{
        BackwardRun, ByteVector, Bytes, Divisor, ForwardRun, Kernel, PixelLoops, RunPenalties, Slot, Step, as_vectors,
        as_vectors_mut,
    },
};

use super::{
    operations::{MAX_RUN, TRIALS, vector},
    twin::{Difference, LANES, Twin, Xorshift, same},
};

/// The costs of a pixel, at most.
const MAX_DEPTH: usize = MAX_RUN * LANES;
/// The pixels of a run, at most.
const MAX_PIXELS: usize = 5;
/// The costs of each, at most, and the bytes of its slot.
const RUN_DEPTH: usize = 5 * LANES;
const RUN_STRIDE: usize = Slot::bytes(RUN_DEPTH);

/// Compares all operations.
#[inline(never)]
pub fn compare_bytes<K: Kernel>(kernel: K, random: &mut Xorshift) -> Result<(), Difference> {
    for trial in 0..TRIALS {
        compare_vectors(kernel, random)?;
        compare_distances::<K, 2>(kernel, random)?;
        compare_distances::<K, 3>(kernel, random)?;
        compare_distances::<K, 4>(kernel, random)?;
        let depth = (1 + trial % MAX_RUN) * LANES;
        compare_divisions(kernel, random, depth)?;
        compare_winners(kernel, random, depth)?;
        compare_paths::<K, 1, false>(kernel, random, depth)?;
    }
    Ok(())
}

/// Compares the operations on vectors.
#[inline(never)]
fn compare_vectors<K: Kernel>(kernel: K, random: &mut Xorshift) -> Result<(), Difference> {
    let twin = Twin::default();
    let load = |lanes: &[u8; LANES]| kernel.load_bytes(&bytemuck::pod_read_unaligned(lanes));
    let [a, b, c, d] = [(); 4].map(|()| random.samples::<LANES>());
    let [of_a, of_b, of_c, of_d] = [a, b, c, d].map(|lanes| load(&lanes));
    same("loading and storing bytes", stored::<K>(of_a), a)?;
    same("the same byte in every lane", stored::<K>(kernel.splat_byte(a[0])), twin.splat_byte(a[0]))?;
    same("the index of each lane", stored::<K>(kernel.byte_indices()), twin.byte_indices())?;
    same("adding bytes", stored::<K>(of_a.add(of_b)), a.add(b))?;
    same("subtracting bytes", stored::<K>(of_a.sub(of_b)), ByteVector::sub(a, b))?;
    same("the lesser bytes", stored::<K>(of_a.min(of_b)), ByteVector::min(a, b))?;
    same("the greater bytes", stored::<K>(of_a.max(of_b)), ByteVector::max(a, b))?;
    same("choosing bytes", stored::<K>(of_a.if_greater(of_b, of_c, of_d)), a.if_greater(b, c, d))?;
    same("half of bytes", stored::<K>(of_a.halved()), a.halved())?;
    let small = a.map(|lane| lane & 127);
    same("a third of bytes", stored::<K>(load(&small).third()), small.third())?;
    same("the least byte", of_a.least(), a.least())
}

/// Compares Hamming distances of descriptors of `N` bytes.
#[inline(never)]
fn compare_distances<K: Kernel, const N: usize>(kernel: K, random: &mut Xorshift) -> Result<(), Difference> {
    let descriptor = [(); N].map(|()| random.number() as u8);
    let others = [(); N].map(|()| random.samples::<LANES>());
    let packed = others.map(|lanes| bytemuck::pod_read_unaligned::<K::Samples>(&lanes));
    let distances = stored::<K>(kernel.hamming_distances(descriptor, packed.each_ref()));
    same("Hamming distances", distances, Twin::default().hamming_distances(descriptor, others.each_ref()))
}

/// Compares divisions of fused sums.
#[inline(never)]
fn compare_divisions<K: Kernel>(kernel: K, random: &mut Xorshift, depth: usize) -> Result<(), Difference> {
    // The largest block has a shift of 5, and a mean of four views divides by 12.
    let divisor = Divisor { shift: random.number() >> 3 & 7, by_three: random.number() >> 3 & 1 != 0 };
    let most = 0xffff >> (random.number() >> 3 & 7);
    let sums: [[u16; LANES]; MAX_RUN] = core::array::from_fn(|_| random.lanes(most, |lane| lane as u16));
    let packed = sums.map(|lanes| vector::<u16, <K as multiscopic_core::kernel::Blocks<u16>>::Costs>(&lanes));
    let [mut quotients, mut expected] = [[0; MAX_DEPTH]; 2];
    kernel.divide(divisor, &packed[..depth / LANES], &mut quotients[..depth]);
    Twin::default().divide(divisor, &sums[..depth / LANES], &mut expected[..depth]);
    same("dividing fused sums", quotients, expected)
}

/// Compares winners.
#[inline(never)]
fn compare_winners<K: Kernel>(kernel: K, random: &mut Xorshift, depth: usize) -> Result<(), Difference> {
    const PATHS: u16 = SemiGlobalParams::PATHS as u16;
    let (costs, excess) = (costs(random), random.samples::<MAX_DEPTH>());
    // Often with ties.
    let excess = if random.number() >> 31 != 0 { excess } else { excess.map(|excess| excess & 1) };
    let (costs, excess) = (&costs[..depth], &excess[..depth]);
    let found = kernel.winner(PATHS, as_vectors::<K>(costs), as_vectors::<K>(excess));
    same("the winner", found, Twin::default().winner(PATHS, as_vectors::<Twin>(costs), as_vectors::<Twin>(excess)))
}

/// Compares extending `N` paths.
#[inline(never)]
fn compare_paths<K: Kernel, const N: usize, const FIRST: bool>(
    kernel: K,
    random: &mut Xorshift,
    depth: usize,
) -> Result<(), Difference> {
    let costs = costs(random);
    let p2 = [(); N].map(|()| (random.number() >> 3) as u8 % (PathPenalties::MAX + 1));
    let p1 = p2.into_iter().fold(PathPenalties::MAX, u8::min);
    let p1 = (random.number() >> 3) as u8 % (p1 + 1);
    let before = [(); N].map(|()| slot(random, depth));
    let excess = random.lanes::<u8, MAX_DEPTH>(204, |excess| excess as u8);
    let [mut found, mut expected] = [(excess, before); 2];
    let steps = step(&before, &mut found.1, &p2, depth);
    kernel.extend::<N, FIRST>(as_vectors::<K>(&costs[..depth]), steps, p1, as_vectors_mut::<K>(&mut found.0[..depth]));
    let steps = step(&before, &mut expected.1, &p2, depth);
    let excess = as_vectors_mut::<Twin>(&mut expected.0[..depth]);
    Twin::default().extend::<N, FIRST>(as_vectors::<Twin>(&costs[..depth]), steps, p1, excess);
    same("what paths add", found.0, expected.0)?;
    same("the paths", found.1, expected.1)
}

/// A slot of any depth.
type AnySlot = [u8; Slot::bytes(MAX_DEPTH)];

/// The steps of `N` paths from slot to slot, of this depth.
fn step<'a, const N: usize>(before: &'a [AnySlot; N], after: &'a mut [AnySlot; N], p2: &[u8; N], depth: usize) -> [Step<'a>; N] {
    let mut steps = before.iter().zip(after).zip(p2);
    [(); N].map(|()| {
        let Some(((before, after), &p2)) = steps.next() else { return Step { before: &[], after: &mut [], p2: 0 } };
        Step { before: &before[..Slot::bytes(depth)], after: &mut after[..Slot::bytes(depth)], p2 }
    })
}

/// The path costs at a pixel: those of costs, with what a path may have added; or those where a path begins.
fn slot(random: &mut Xorshift, depth: usize) -> AnySlot {
    let mut slot = [u8::MAX; Slot::bytes(MAX_DEPTH)];
    if (random.number() >> 3).is_multiple_of(8) {
        Slot::begin(&mut slot, depth - random.number() as usize % LANES);
        return slot;
    }
    let added = random.lanes::<u8, MAX_DEPTH>(PathPenalties::MAX.into(), |added| added as u8 % (PathPenalties::MAX + 1));
    for ((slot, cost), added) in slot[Slot::LEAD..][..depth].iter_mut().zip(costs(random)).zip(added) {
        *slot = cost.saturating_add(added);
    }
    slot[0] = slot[Slot::LEAD..][..depth].iter().copied().fold(u8::MAX, u8::min);
    slot
}

/// Matching costs. Of some pixels all candidates exist, of others none or about half.
fn costs(random: &mut Xorshift) -> [u8; MAX_DEPTH] {
    let limit = SemiGlobalParams::MAX_COST;
    let missing = [0, 0, 0, 1, 2][random.number() as usize % 5];
    let costs = random.lanes::<u8, MAX_DEPTH>(limit.into(), |cost| cost as u8);
    costs.map(|cost| if random.number() >> 31 < missing { u8::MAX } else { cost })
}

/// A vector in memory.
fn stored<K: Kernel>(bytes: K::Bytes) -> [u8; LANES] {
    let mut memory = <K::Samples as bytemuck::Zeroable>::zeroed();
    bytes.store(&mut memory);
    bytemuck::pod_read_unaligned(bytemuck::bytes_of(&memory))
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

/// The data that runs read and write, with space for the longest. Costs begin at words, as they do in a matcher.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(4))]
struct Buffers {
    costs: [u8; MAX_PIXELS * RUN_DEPTH],
    excess: [u8; MAX_PIXELS * RUN_DEPTH],
    along: [u8; RUN_STRIDE],
    from_above: [[u8; (MAX_PIXELS + 1) * RUN_STRIDE]; 3],
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

/// Random costs and slots.
#[inline(never)]
fn buffers(random: &mut Xorshift, Run { depth, pixels, .. }: Run) -> Buffers {
    let mut buffers = Buffers {
        costs: [0; MAX_PIXELS * RUN_DEPTH],
        excess: [0; MAX_PIXELS * RUN_DEPTH],
        along: [u8::MAX; RUN_STRIDE],
        from_above: [[u8::MAX; (MAX_PIXELS + 1) * RUN_STRIDE]; 3],
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
        let mut spare = [u8::MAX; RUN_STRIDE];
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
        let last: [u8; RUN_STRIDE] = core::array::from_fn(|i| along[0].get(i).copied().unwrap_or_default());
        buffers.along = last;
    }

    #[inline(never)]
    fn backward<K: Kernel>(&self, kernel: K, buffers: &mut Buffers) {
        let (bytes, stride) = (self.pixels * self.depth, Slot::bytes(self.depth));
        let mut spare = [u8::MAX; RUN_STRIDE];
        let along = &mut [&mut buffers.along[..stride], &mut spare[..stride]];
        let run = BackwardRun {
            depth: self.depth,
            costs: &buffers.costs[..bytes],
            excess: &mut buffers.excess[..bytes],
            along,
            penalties: self.penalties(),
        };
        kernel.extend_backward(SemiGlobalParams::PATHS as u16, run, |pixel| buffers.winners[pixel.column] = pixel.winner);
        let last: [u8; RUN_STRIDE] = core::array::from_fn(|i| along[0].get(i).copied().unwrap_or_default());
        buffers.along = last;
    }
}
