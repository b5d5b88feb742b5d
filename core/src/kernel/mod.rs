//! The inner loops of the matcher, along the disparities: one definition over the vectors of any instruction set.
//!
//! An instruction set is a type that implements [`Isa`] and [`Blocks`] with the few operations that the loops are made of. [`Portable`] does so in plain Rust
//! and is the definition of what they mean.

#[cfg(target_arch = "arm")]
#[macro_use]
mod assembly;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod batch;
#[cfg(target_arch = "arm")]
mod dsp;
#[cfg(target_arch = "arm")]
mod mve;
#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
mod neon;
mod portable;
#[cfg(any(target_arch = "x86_64", all(target_arch = "aarch64", target_feature = "neon")))]
mod registers;
mod steps;
mod winners;

use core::fmt::Debug;

use bytemuck::Pod;

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub use avx512::Avx512;
pub(crate) use batch::order;
pub use batch::{Batch, Masks};
#[cfg(target_arch = "arm")]
pub use dsp::Dsp;
#[cfg(target_arch = "arm")]
pub use mve::Mve;
#[cfg(all(target_arch = "aarch64", target_feature = "neon"))]
pub use neon::Neon;
pub use portable::Portable;
pub use steps::Steps;
pub use winners::Winners;

use crate::Fusion;

/// A set of vector instructions, as a token: who has one may use them.
///
/// Lanes past the last disparity hold anything, so arithmetic wraps.
pub trait Isa: Copy + Debug {
    /// Disparities at a time, at least 1. The number of disparities is rounded up to a multiple.
    const LANES: usize;
    /// Pixels whose costs are fused before their disparities are selected, at least 1 and at most [`Winners::MAX`]: selecting takes long, but that of
    /// one pixel does not wait for another's.
    const BATCH: usize;
    /// As many samples, in memory.
    type Samples: Pod;
    /// As many column sums, in memory.
    type Sums: Pod;
    /// A vector of sums of absolute differences down a column of the block, each at most 21 x 255.
    type Column: Column<Sums = Self::Sums>;

    /// The lane in memory that holds the disparity at `index` of a vector, in sums and in costs.
    fn lane(index: usize) -> usize {
        index
    }

    /// Does what is compiled for the instruction set.
    #[inline(always)]
    fn compiled<W: Work>(self, work: W) {
        work.run();
    }

    /// Column sums from memory.
    fn load_column(self, sums: &Self::Sums) -> Self::Column;
    /// The absolute differences between a sample of the centre and the samples of a view.
    fn differences(self, center: u8, view: &Self::Samples) -> Self::Column;
    /// A column's sums moved down: with the differences that enter, and without those that leave. Wraps.
    ///
    /// It may add [`bias`](Isa::bias) too.
    fn advance(self, sums: Self::Column, center: Change<u8>, view: Change<&Self::Samples>) -> Self::Column;

    /// What every column sum has too much after it has been moved down by so many lines. It leaves the blocks as it has entered.
    fn bias(_lines: u32) -> u16 {
        0
    }

    /// Adds what enters to the sums of the next column.
    #[inline(always)]
    fn prime<const V: usize>(self, steps: &mut Steps<'_, Self, V>) {
        let Some(step) = steps.next() else { return };
        for (column, view) in step.column.chunks_exact_mut(step.vectors.max(1)).zip(step.views) {
            for (sums, samples) in column.iter_mut().zip(view.entering) {
                self.load_column(sums).add(self.differences(step.center.entering, samples)).store(sums);
            }
        }
    }
}

/// Something to do that is compiled for an instruction set, if that is more than the compiler may use elsewhere.
pub trait Work {
    /// Does it. To be inlined.
    fn run(self);
}

/// Vectors of block sums in lanes of type `L`.
pub trait Blocks<L: Lane>: Isa {
    /// As many costs, in memory.
    type Costs: Pod;
    /// A vector of sums of absolute differences over the block, or of costs fused of them.
    type Block: Block<L, Costs = Self::Costs, Column = Self::Column>;

    /// Costs from memory.
    fn load_block(self, costs: &Self::Costs) -> Self::Block;
    /// The same cost in every lane.
    fn splat(self, cost: L) -> Self::Block;
    /// The index of the first disparity with this cost; any that is no disparity's if none has it. Where pixels go in batches, the costs are in the
    /// order of the disparities.
    fn position(self, costs: &[Self::Costs], cost: L) -> usize;

    /// Moves the next column down, and the blocks on by it.
    #[inline(always)]
    fn slide<const V: usize>(self, steps: &mut Steps<'_, Self, V>, blocks: &mut [[Self::Costs; V]]) {
        let Some(step) = steps.next() else { return };
        let columns = step.column.chunks_exact_mut(step.vectors.max(1)).zip(step.left.chunks_exact(step.vectors.max(1)));
        for (k, ((column, left), view)) in columns.zip(step.views).enumerate() {
            let samples = view.entering.iter().zip(view.leaving);
            for (((sums, left), block), (entering, leaving)) in column.iter_mut().zip(left).zip(&mut *blocks).zip(samples) {
                let moved = self.advance(self.load_column(sums), step.center, Change { entering, leaving });
                moved.store(sums);
                self.load_block(&block[k]).slide(moved, self.load_column(left)).store(&mut block[k]);
            }
        }
    }

    /// Fuses the costs of blocks whose views are all available, and returns the least.
    #[inline(always)]
    fn fuse<const V: usize>(self, rule: Rule, blocks: &[[Self::Costs; V]], fused: &mut [Self::Costs]) -> L {
        fuse_generic(self, rule, blocks, fused)
    }

    /// Fuses the costs of blocks as if those under a mask of [`Lane::MAX`] were that; under a mask of zero they are as they are. Returns the
    /// least. Only the views whose bits are set in `masked` have a mask that is not zero.
    #[inline(always)]
    fn fuse_masked<const V: usize>(
        self,
        rule: Rule,
        _masked: u8,
        blocks: &[[Self::Costs; V]],
        masks: &[[Self::Costs; V]],
        fused: &mut [Self::Costs],
    ) -> L {
        fuse_masked_generic(self, rule, blocks, masks, fused)
    }

    /// As [`fuse_masked`](Blocks::fuse_masked), also where no view has a mask.
    #[inline(always)]
    fn fuse_by_masks<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        blocks: &[[Self::Costs; V]],
        masks: &[[Self::Costs; V]],
        fused: &mut [Self::Costs],
    ) -> L {
        match masked {
            0 => self.fuse(rule, blocks, fused),
            _ => self.fuse_masked(rule, masked, blocks, masks, fused),
        }
    }

    /// Moves the next column down, and the blocks on by it, and fuses their costs: as if those under a mask of [`Lane::MAX`] were that. Returns the
    /// least. Only the views whose bits are set in `masked` have a mask that is not zero.
    #[inline(always)]
    fn slide_and_fuse<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        steps: &mut Steps<'_, Self, V>,
        blocks: &mut [[Self::Costs; V]],
        masks: &[[Self::Costs; V]],
        fused: &mut [Self::Costs],
    ) -> L {
        self.slide(steps, blocks);
        self.fuse_by_masks(rule, masked, blocks, masks, fused)
    }

    /// Goes over a batch of pixels.
    #[inline(always)]
    fn batch<const V: usize>(self, batch: Batch<'_, L, Self, V>, steps: &mut Steps<'_, Self, V>) {
        batch.run(self, steps);
    }

    /// Fuses the costs of blocks in the `available` views, whose bits are set, on one scale for every number of them. Where there are
    /// none, they are [`Lane::MAX`].
    #[inline(always)]
    fn fuse_available<const V: usize>(self, rule: Rule, available: u8, blocks: &[[Self::Costs; V]], fused: &mut [Self::Costs]) {
        for (fused, block) in fused.iter_mut().zip(blocks) {
            fuse_available(self, rule, available, block).store(fused);
        }
    }

    /// The least of costs.
    #[inline(always)]
    fn least(self, costs: &[Self::Costs]) -> L {
        let mut least = self.splat(L::MAX);
        for costs in costs {
            least = least.min(self.load_block(costs));
        }
        least.least()
    }
}

/// What is done with a vector of column sums.
pub trait Column: Copy {
    /// As many sums, in memory.
    type Sums: Pod;

    /// Puts the sums into memory.
    fn store(self, sums: &mut Self::Sums);
    /// Lane by lane, wrapping.
    fn add(self, other: Self) -> Self;
}

/// What is done with a vector of block sums or costs.
pub trait Block<L>: Copy {
    /// As many costs, in memory.
    type Costs: Pod;
    /// The vector of column sums with as many lanes.
    type Column: Column;

    /// Puts the costs into memory.
    fn store(self, costs: &mut Self::Costs);
    /// The block moved on by a column. What enters less what leaves, in 16 bits with a sign, is what the block grows by.
    fn slide(self, entering: Self::Column, leaving: Self::Column) -> Self;
    /// Lane by lane. 16 bits saturate; 32 bits never have to.
    fn add(self, other: Self) -> Self;
    /// Lane by lane.
    fn min(self, other: Self) -> Self;
    /// Lane by lane.
    fn max(self, other: Self) -> Self;
    /// Lane by lane `then` where `self > other`, and `otherwise` elsewhere.
    fn if_greater(self, other: Self, then: Self, otherwise: Self) -> Self;
    /// The least of all lanes.
    fn least(self) -> L;

    /// The lanes in the order of the disparities, where pixels go in batches.
    #[inline(always)]
    fn ordered(self) -> Self {
        self
    }
}

/// A block's sum: 16 bits where the largest block sum fits below [`Lane::MAX`], 32 bits otherwise.
pub trait Lane: Copy + Ord + Default + Pod {
    /// The value at which fused costs saturate. No cost of a single view reaches it.
    const MAX: Self;
    /// This sum in 32 bits.
    fn widen(self) -> u32;
    /// The index of a lane as a cost.
    fn from_index(index: usize) -> Self;
}

impl Lane for u16 {
    const MAX: u16 = u16::MAX;

    #[inline(always)]
    fn widen(self) -> u32 {
        self.into()
    }

    #[inline(always)]
    fn from_index(index: usize) -> u16 {
        index as u16
    }
}

impl Lane for u32 {
    const MAX: u32 = u32::MAX;

    #[inline(always)]
    fn widen(self) -> u32 {
        self
    }

    #[inline(always)]
    fn from_index(index: usize) -> u32 {
        index as u32
    }
}

/// What enters the block, and what leaves it.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Change<T> {
    /// What enters.
    pub entering: T,
    /// What leaves.
    pub leaving: T,
}

/// How the costs of the views are fused in lanes.
///
/// Costs are on a scale that keeps them small where all views are available: a factor common to all candidates of a pixel changes
/// neither which is the least, nor where between its neighbours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// The least.
    Min,
    /// The sum.
    Sum,
    /// Six times the mean of the least three or two, of three views or four.
    Heuristic,
}

impl Rule {
    /// The rule for `views` views, one to four.
    pub const fn new(fusion: Fusion, views: usize) -> Rule {
        match (fusion, views) {
            (Fusion::Min, _) | (_, ..=1) => Rule::Min,
            (Fusion::Mean, _) | (Fusion::Heuristic, 2) => Rule::Sum,
            (Fusion::Heuristic, _) => Rule::Heuristic,
        }
    }

    /// Whether views can be hidden where they are not available, by the greatest cost, if `incomplete` of `views` views are not available at all
    /// disparities. A hidden cost is that of no view, but for the heuristic rule where one view is left.
    pub const fn masks(self, views: usize, incomplete: usize) -> bool {
        match self {
            Rule::Min => true,
            Rule::Sum => false,
            Rule::Heuristic => views >= incomplete + 2,
        }
    }
}

/// Where the lane of a disparity is among those of a pixel.
#[inline(always)]
pub(crate) fn lane<I: Isa>(index: usize) -> usize {
    index / I::LANES * I::LANES + I::lane(index % I::LANES)
}

/// Takes the lanes that are too many out of a pixel's fused costs, if there are any: `excess` is the least that costs in the last vector may be.
#[inline(always)]
pub(crate) fn hide_excess<L: Lane, I: Blocks<L>>(isa: I, excess: &Option<I::Costs>, fused: &mut [I::Costs]) {
    if let (Some(excess), Some(last)) = (excess, fused.last_mut()) {
        isa.load_block(last).max(isa.load_block(excess)).store(last);
    }
}

/// Fuses the costs of blocks, vector by vector, and returns the least. On Arm a function of its own, so that the loops for the common rules, which are
/// in assembly there, need fewer registers.
#[cfg_attr(target_arch = "arm", inline(never))]
#[cfg_attr(not(target_arch = "arm"), inline(always))]
fn fuse_generic<L: Lane, I: Blocks<L>, const V: usize>(
    isa: I,
    rule: Rule,
    blocks: &[[I::Costs; V]],
    fused: &mut [I::Costs],
) -> L {
    let mut least = isa.splat(L::MAX);
    for (fused, block) in fused.iter_mut().zip(blocks) {
        let mut costs = [least; V];
        for k in 0..V {
            costs[k] = isa.load_block(&block[k]);
        }
        let costs = fuse(rule, costs);
        costs.store(fused);
        least = least.min(costs);
    }
    least.least()
}

/// As [`fuse_generic`], of what masks leave.
#[cfg_attr(target_arch = "arm", inline(never))]
#[cfg_attr(not(target_arch = "arm"), inline(always))]
fn fuse_masked_generic<L: Lane, I: Blocks<L>, const V: usize>(
    isa: I,
    rule: Rule,
    blocks: &[[I::Costs; V]],
    masks: &[[I::Costs; V]],
    fused: &mut [I::Costs],
) -> L {
    let mut least = isa.splat(L::MAX);
    for ((fused, block), mask) in fused.iter_mut().zip(blocks).zip(masks) {
        let mut costs = [least; V];
        for k in 0..V {
            costs[k] = isa.load_block(&block[k]).max(isa.load_block(&mask[k]));
        }
        let costs = fuse(rule, costs);
        costs.store(fused);
        least = least.min(costs);
    }
    least.least()
}

/// Fuses the costs of views that are all available.
#[inline(always)]
pub(crate) fn fuse<L: Lane, B: Block<L>, const V: usize>(rule: Rule, costs: [B; V]) -> B {
    match (rule, &costs[..]) {
        (Rule::Sum, &[a, b]) => a.add(b),
        (Rule::Sum, &[a, b, c]) => a.add(b).add(c),
        (Rule::Sum, &[a, b, c, d]) => a.add(b).add(c).add(d),
        (Rule::Heuristic, &[a, b, c]) => {
            let (low, high) = (a.min(b), a.max(b));
            heuristic(low.min(c), low.max(c).min(high), high.max(c))
        }
        (Rule::Heuristic, &[a, b, c, d]) => {
            let ((a, b), (c, d)) = ((a.min(b), a.max(b)), (c.min(d), c.max(d)));
            // Second and third are the greater of the lower ones and the lesser of the upper ones.
            let (x, y) = (a.max(c), b.min(d));
            heuristic(a.min(c), x.min(y), x.max(y))
        }
        _ => {
            let mut least = costs[0];
            for &cost in costs.iter().skip(1) {
                least = least.min(cost);
            }
            least
        }
    }
}

/// Fuses the costs of the `available` views, at least one, whose bits are set, on one scale for every number of them.
#[inline(always)]
fn fuse_available<L: Lane, I: Blocks<L>, const V: usize>(isa: I, rule: Rule, available: u8, costs: &[I::Costs; V]) -> I::Block {
    // In place of a view that is not available, a cost that changes nothing.
    let nothing = isa.splat(if rule == Rule::Sum { L::default() } else { L::MAX });
    let mut of_available = [nothing; V];
    for k in 0..V {
        if available >> k & 1 != 0 {
            of_available[k] = isa.load_block(&costs[k]);
        }
    }
    match (rule, available.count_ones()) {
        (_, 0) => isa.splat(L::MAX),
        (Rule::Min, _) => fuse(Rule::Min, of_available),
        (Rule::Heuristic, 1) => six_times(fuse(Rule::Min, of_available)),
        (Rule::Heuristic, _) => fuse(Rule::Heuristic, of_available),
        (Rule::Sum, count) => {
            let sum = fuse(Rule::Sum, of_available);
            match (V, count) {
                (2, 2) => sum,
                (2, _) => sum.add(sum),
                (_, 4) => sum.add(sum).add(sum),
                (_, 3) => sum.add(sum).add(sum.add(sum)),
                (_, 2) => six_times(sum),
                (_, _) => six_times(sum.add(sum)),
            }
        }
    }
}

/// Six times the mean of `c1 <= c2 <= c3`, or of the first two if `c3 > 3 c2`.
///
/// In 16 bits nothing but the result is changed by saturation: where three times `c2` saturates, no `c3` is greater either way. Nor is it by
/// a third cost of [`Lane::MAX`] that stands for no view: then that of the first two has saturated too.
#[inline(always)]
fn heuristic<L, B: Block<L>>(c1: B, c2: B, c3: B) -> B {
    let two = c1.add(c2);
    let three = two.add(c3);
    c3.if_greater(c2.add(c2).add(c2), two.add(two).add(two), three.add(three))
}

#[inline(always)]
fn six_times<L, B: Block<L>>(cost: B) -> B {
    let twice = cost.add(cost);
    twice.add(twice).add(twice)
}
