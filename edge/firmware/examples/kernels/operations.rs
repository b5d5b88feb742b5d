//! Compares single operations on random vectors, with the costs at which fusion changes its mind.

use core::fmt::Debug;
use multiscopic_core::kernel::{Block, Blocks, Change, Column, Isa, Lane, Native, Rule};

use super::twin::{Difference, LANES, Twin, Xorshift, same};

/// The number of trials of each operation.
pub const TRIALS: usize = 1000;
/// The most products in a sum, a multiple of 4.
const MOST_PRODUCTS: usize = 48;
/// The most vectors in a run.
pub const MAX_RUN: usize = 8;

/// Packs lanes, given in the order of the disparities, into a vector of the kernel.
pub fn vector<L: Lane, T: bytemuck::Pod>(lanes: &[L; LANES]) -> T {
    let mut ordered = [L::default(); LANES];
    for (index, &lane) in lanes.iter().enumerate() {
        ordered[Native::lane(index)] = lane;
    }
    bytemuck::pod_read_unaligned(bytemuck::cast_slice(&ordered))
}

/// Unpacks the lanes of a vector of the kernel, in the order of the disparities.
fn lanes<L: Lane, T: bytemuck::Pod>(vector: &T) -> [L; LANES] {
    let ordered: &[L] = bytemuck::cast_slice(core::slice::from_ref(vector));
    core::array::from_fn(|index| ordered[Native::lane(index)])
}

/// Compares the operations on column sums.
pub fn compare_columns<K: Isa>(kernel: K, random: &mut Xorshift) -> Result<(), Difference> {
    let twin = Twin::default();
    let stored = |column: K::Column| {
        let mut sums = bytemuck::Zeroable::zeroed();
        column.store(&mut sums);
        lanes::<u16, K::Sums>(&sums)
    };
    let packed = |samples: &[u8; LANES]| bytemuck::pod_read_unaligned::<K::Samples>(samples);
    for _ in 0..TRIALS {
        let (a, b) = (random.lanes(0xffff, |lane| lane as u16), random.lanes(0xffff, |lane| lane as u16));
        let [of_a, of_b] = [a, b].map(|lanes| kernel.load_column(&vector(&lanes)));
        same("loading and storing column sums", stored(of_a), a)?;
        same("adding column sums", stored(of_a.add(of_b)), Column::add(a, b))?;
        let center = Change { entering: random.samples::<LANES>()[0], leaving: random.samples::<LANES>()[0] };
        let (entering, leaving) = (random.samples(), random.samples());
        let differences = stored(kernel.differences(center.entering, &packed(&entering)));
        same("the differences", differences, twin.differences(center.entering, &entering))?;
        let view = Change { entering: &packed(&entering), leaving: &packed(&leaving) };
        let moved = stored(kernel.advance(of_a, center, view)).map(|sum| sum.wrapping_sub(K::bias(1)));
        let view = Change { entering: &entering, leaving: &leaving };
        same("moving a column", moved, twin.advance(a, center, view))?;
    }
    Ok(())
}

/// Compares sums of products.
// A function of its own, so that its vectors are on the stack only meanwhile.
#[inline(never)]
pub fn compare_products<K: Isa>(kernel: K, random: &mut Xorshift) -> Result<(), Difference> {
    let twin = Twin::default();
    for trial in 0..TRIALS {
        let weights = random.samples::<MOST_PRODUCTS>();
        let inputs = [(); 4].map(|()| random.samples::<MOST_PRODUCTS>().map(|input| input >> 1));
        let sums = [(); 4].map(|()| i32::from_le_bytes(random.samples()));
        let count = trial % (MOST_PRODUCTS / 4 + 1) * 4;
        let (weights, inputs) = (&weights[..count], inputs.each_ref().map(|inputs| &inputs[..count]));
        same("sums of products", kernel.add_products(sums, weights, inputs), twin.add_products(sums, weights, inputs))?;
    }
    Ok(())
}

/// Compares the operations on block sums and costs of at most `most`.
pub fn compare_costs<L: Lane + Debug, K: Blocks<L>>(kernel: K, random: &mut Xorshift, most: u32) -> Result<(), Difference>
where
    Twin: Blocks<L, Costs = [L; LANES], Block = [L; LANES]>,
    [L; LANES]: Block<L, Column = [u16; LANES]>,
{
    let twin = Twin::default();
    let stored = |block: K::Block| {
        let mut costs = bytemuck::Zeroable::zeroed();
        block.store(&mut costs);
        lanes::<L, K::Costs>(&costs)
    };
    for trial in 0..TRIALS {
        let mut block = || random.lanes::<L, LANES>(most, narrow);
        let [a, b, c, d] = [block(), block(), block(), block()];
        let [of_a, of_b, of_c, of_d] = [a, b, c, d].map(|lanes| kernel.load_block(&vector(&lanes)));
        same("loading and storing costs", stored(of_a), a)?;
        same("the same cost in every lane", stored(kernel.splat(a[0])), twin.splat(a[0]))?;
        same("adding costs", stored(of_a.add(of_b)), a.add(b))?;
        same("the lesser costs", stored(of_a.min(of_b)), Block::min(a, b))?;
        same("the greater costs", stored(of_a.max(of_b)), Block::max(a, b))?;
        same("choosing costs", stored(of_a.if_greater(of_b, of_c, of_d)), a.if_greater(b, c, d))?;
        same("the least lane", of_a.least(), a.least())?;
        // Column sums up to those of a block of 21 rows.
        let mut sums = || random.lanes(0xffff, |sum| (sum % (21 * 255 + 1)) as u16);
        let (entering, leaving) = (sums(), sums());
        let [of_entering, of_leaving] = [entering, leaving].map(|sums| kernel.load_column(&vector(&sums)));
        same("sliding a block", stored(of_a.slide(of_entering, of_leaving)), a.slide(entering, leaving))?;
        compare_runs::<L, K, 1>(kernel, random, most, trial)?;
        compare_runs::<L, K, 2>(kernel, random, most, trial)?;
        compare_runs::<L, K, 3>(kernel, random, most, trial)?;
        compare_runs::<L, K, 4>(kernel, random, most, trial)?;
    }
    Ok(())
}

/// A lane from a number that fits it.
fn narrow<L: Lane>(number: u32) -> L {
    bytemuck::pod_read_unaligned(&number.to_le_bytes()[..size_of::<L>()])
}

/// Compares the operations on runs of vectors, with `V` views.
#[inline(never)]
fn compare_runs<L: Lane + Debug, K: Blocks<L>, const V: usize>(
    kernel: K,
    random: &mut Xorshift,
    most: u32,
    trial: usize,
) -> Result<(), Difference>
where
    Twin: Blocks<L, Costs = [L; LANES], Block = [L; LANES]>,
    [L; LANES]: Block<L>,
{
    let twin = Twin::default();
    let mut twins = [[[L::default(); LANES]; V]; MAX_RUN];
    twins.as_flattened_mut().fill_with(|| random.lanes(most, narrow));
    let blocks = vectors::<L, K::Costs, V>(&twins);
    let length = 1 + trial % MAX_RUN;
    let rule = [Rule::Min, Rule::Sum, Rule::Heuristic][random.number() as usize % 3];
    let rule = if rule == Rule::Heuristic && V < 3 { Rule::Sum } else { rule };
    let mut fused = [<K::Costs as bytemuck::Zeroable>::zeroed(); MAX_RUN];
    let mut fused_by_twin = [[L::default(); LANES]; MAX_RUN];
    let least = kernel.fuse(rule, &blocks[..length], &mut fused[..length]);
    let least_of_twin = twin.fuse(rule, &twins[..length], &mut fused_by_twin[..length]);
    same("fusing costs", all_lanes(&fused), fused_by_twin)?;
    same("the least of fused costs", least, least_of_twin)?;
    same("the least of costs", kernel.least(&fused[..length]), twin.least(&fused_by_twin[..length]))?;
    let position = kernel.position(&fused[..length], least);
    same("the position of the least", position, twin.position(&fused_by_twin[..length], least))?;
    let masked = [random.number() as u8, 1 << (random.number() as usize % V)][trial % 2] % (1 << V);
    let mut masks_of_twin = [[[L::default(); LANES]; V]; MAX_RUN];
    for view in masks_of_twin.iter_mut().flat_map(|views| views.iter_mut().zip(0..)).filter(|(_, k)| masked >> k & 1 != 0) {
        view.0.fill_with(|| narrow(if random.number().is_multiple_of(4) { u32::MAX } else { 0 }));
    }
    let masks = vectors::<L, K::Costs, V>(&masks_of_twin);
    // Masked sums take the maximum for a view that is not available. No block sum reaches it.
    if rule == Rule::Sum {
        twins.as_flattened_mut().as_flattened_mut().iter_mut().for_each(|lane| *lane = Ord::min(*lane, narrow(u32::MAX - 1)));
    }
    let blocks = vectors::<L, K::Costs, V>(&twins);
    let least = kernel.fuse_masked(rule, masked, &blocks[..length], &masks[..length], &mut fused[..length]);
    let least_of_twin = twin.fuse_masked(rule, masked, &twins[..length], &masks_of_twin[..length], &mut fused_by_twin[..length]);
    same("fusing masked costs", all_lanes(&fused), fused_by_twin)?;
    same("the least of masked costs", least, least_of_twin)?;
    let available = random.number() as u8 % (1 << V);
    kernel.fuse_available(rule, available, &blocks[..length], &mut fused[..length]);
    twin.fuse_available(rule, available, &twins[..length], &mut fused_by_twin[..length]);
    same("fusing available costs", all_lanes(&fused), fused_by_twin)
}

/// Vectors from their lanes. A loop, since `map` is unrolled, and there are many of these functions.
#[inline(never)]
fn vectors<L: Lane, C: bytemuck::Pod, const V: usize>(lanes: &[[[L; LANES]; V]; MAX_RUN]) -> [[C; V]; MAX_RUN] {
    let mut vectors = [[<C as bytemuck::Zeroable>::zeroed(); V]; MAX_RUN];
    for (vector_of, lanes) in vectors.as_flattened_mut().iter_mut().zip(lanes.as_flattened()) {
        *vector_of = vector(lanes);
    }
    vectors
}

/// The lanes of vectors.
#[inline(never)]
fn all_lanes<L: Lane, C: bytemuck::Pod>(vectors: &[C; MAX_RUN]) -> [[L; LANES]; MAX_RUN] {
    let mut all = [[L::default(); LANES]; MAX_RUN];
    for (lanes_of, vector) in all.iter_mut().zip(vectors) {
        *lanes_of = lanes(vector);
    }
    all
}

impl Xorshift {
    /// A cost of at most `most`, often an extreme, or near three times or a third of the cost before.
    fn cost(&mut self, most: u32, before: u32) -> u32 {
        match self.number() >> 29 {
            0 => self.number() % 2,
            1 => most - self.number() % 2,
            2 => most / 2 + self.number() % 2,
            3 => before.saturating_mul(3).saturating_add(self.number() % 3).min(most),
            4 => before / 3,
            5 => self.number() % 64,
            _ => self.number() & most,
        }
    }

    /// A vector of costs of at most `most`.
    pub fn lanes<T: Copy + Default, const N: usize>(&mut self, most: u32, to: impl Fn(u32) -> T) -> [T; N] {
        let mut before = 0;
        core::array::from_fn(|_| {
            before = self.cost(most, before);
            to(before)
        })
    }

    /// A vector of samples.
    pub fn samples<const N: usize>(&mut self) -> [u8; N] {
        self.lanes(u8::MAX.into(), |sample| sample as u8)
    }
}
