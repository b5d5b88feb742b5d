//! The inner loops of the matcher, along the disparities: one definition over the vectors of any instruction set.
//!
//! An instruction set is a type that implements [`Isa`] and [`Blocks`] with the few operations that the loops are made of. [`Portable`] does so in plain Rust
//! and is the definition of what they mean.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;

use core::fmt::Debug;

use bytemuck::Pod;

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub use avx512::Avx512;
pub use portable::Portable;

use crate::Fusion;

/// A set of vector instructions, as a token: who has one may use them.
///
/// Lanes past the last disparity hold anything, so arithmetic wraps.
pub trait Isa: Copy + Debug {
    /// Disparities at a time, at least 1. The number of disparities is rounded up to a multiple.
    const LANES: usize;
    /// As many samples, in memory.
    type Samples: Pod;
    /// As many column sums, in memory.
    type Sums: Pod;
    /// A vector of sums of absolute differences down a column of the block, each at most 21 x 255.
    type Column: Column<Sums = Self::Sums>;

    /// Column sums from memory.
    fn load_column(self, sums: &Self::Sums) -> Self::Column;
    /// The absolute differences between a sample of the centre and the samples of a view.
    fn differences(self, center: u8, view: &Self::Samples) -> Self::Column;
}

/// Vectors of block sums in lanes of type `L`.
pub trait Blocks<L>: Isa {
    /// As many costs, in memory.
    type Costs: Pod;
    /// A vector of sums of absolute differences over the block, or of costs fused of them.
    type Block: Block<L, Costs = Self::Costs, Column = Self::Column>;

    /// Costs from memory.
    fn load_block(self, costs: &Self::Costs) -> Self::Block;
    /// The same cost in every lane.
    fn splat(self, cost: L) -> Self::Block;
}

/// What is done with a vector of column sums.
pub trait Column: Copy {
    /// As many sums, in memory.
    type Sums: Pod;

    /// Puts the sums into memory.
    fn store(self, sums: &mut Self::Sums);
    /// Lane by lane, wrapping.
    fn add(self, other: Self) -> Self;
    /// Lane by lane, wrapping.
    fn sub(self, other: Self) -> Self;
}

/// What is done with a vector of block sums or costs.
pub trait Block<L>: Copy {
    /// As many costs, in memory.
    type Costs: Pod;
    /// The vector of column sums with as many lanes.
    type Column: Column;

    /// Puts the costs into memory.
    fn store(self, costs: &mut Self::Costs);
    /// The block moved on by a column.
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
    /// The first lane with this cost, if any has it.
    fn position(self, cost: L) -> Option<usize>;
}

/// A block's sum: 16 bits where the largest block sum fits below [`Lane::MAX`], 32 bits otherwise.
pub trait Lane: Copy + Ord + Default + Pod {
    /// The value at which fused costs saturate. No cost of a single view reaches it.
    const MAX: Self;
    /// This sum in 32 bits.
    fn widen(self) -> u32;
}

impl Lane for u16 {
    const MAX: u16 = u16::MAX;

    #[inline(always)]
    fn widen(self) -> u32 {
        self.into()
    }
}

impl Lane for u32 {
    const MAX: u32 = u32::MAX;

    #[inline(always)]
    fn widen(self) -> u32 {
        self
    }
}

/// What enters the block, and what leaves it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Change<T> {
    pub entering: T,
    pub leaving: T,
}

/// What a column of the block gains and loses in `V` views by a step down.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step<'a, I: Isa, const V: usize> {
    /// The centre's samples.
    pub center: Change<u8>,
    /// Each view's samples at every disparity.
    pub views: [Change<&'a [I::Samples]>; V],
}

impl<I: Isa, const V: usize> Step<'_, I, V> {
    /// Whether there are samples for `vectors` vectors of disparities.
    #[inline(always)]
    pub fn covers(&self, vectors: usize) -> bool {
        self.views.iter().all(|view| view.entering.len() == vectors && view.leaving.len() == vectors)
    }
}

/// Adds the entering line to vector `j` of a column of the block, in each view.
#[inline(always)]
pub(crate) fn prime<I: Isa, const V: usize>(isa: I, column: &mut [I::Sums; V], step: &Step<'_, I, V>, j: usize) {
    for (sums, view) in column.iter_mut().zip(&step.views) {
        isa.load_column(sums).add(isa.differences(step.center.entering, &view.entering[j])).store(sums);
    }
}

/// Moves vector `j` of a column of the block down, and the block on by it, in each view; `left` leaves the block. Returns the block's
/// sums.
#[inline(always)]
pub(crate) fn advance<L: Lane, I: Blocks<L>, const V: usize>(
    isa: I,
    column: &mut [I::Sums; V],
    left: &[I::Sums; V],
    block: &mut [I::Costs; V],
    step: &Step<'_, I, V>,
    j: usize,
) -> [I::Block; V] {
    let mut moved = [isa.splat(L::default()); V];
    for k in 0..V {
        let entering = isa.differences(step.center.entering, &step.views[k].entering[j]);
        let leaving = isa.differences(step.center.leaving, &step.views[k].leaving[j]);
        let sums = isa.load_column(&column[k]).add(entering).sub(leaving);
        sums.store(&mut column[k]);
        moved[k] = isa.load_block(&block[k]).slide(sums, isa.load_column(&left[k]));
        moved[k].store(&mut block[k]);
    }
    moved
}

/// How the costs of a pixel's available views are fused in lanes, less the constant factor that brings them to the
/// [scale](Fusion::scale) of the rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rule {
    /// The least.
    Min,
    /// The sum.
    Sum,
    /// Six times the mean of the least three or two, of three views or four.
    Heuristic,
}

impl Rule {
    /// The rule for `views` available views, one to four.
    pub const fn new(fusion: Fusion, views: usize) -> Rule {
        match (fusion, views) {
            (Fusion::Min, _) => Rule::Min,
            (Fusion::Mean, _) | (Fusion::Heuristic, ..=2) => Rule::Sum,
            (Fusion::Heuristic, _) => Rule::Heuristic,
        }
    }

    /// What its costs are multiplied by to be on the scale of `fusion`.
    pub const fn factor(self, fusion: Fusion, views: usize) -> u32 {
        match (self, views) {
            (Rule::Min | Rule::Heuristic, _) => 1,
            (Rule::Sum, ..=1) => fusion.scale(),
            (Rule::Sum, 2) => fusion.scale() / 2,
            (Rule::Sum, 3) => fusion.scale() / 3,
            (Rule::Sum, _) => fusion.scale() / 4,
        }
    }
}

/// Fuses the costs of one to four views by `rule`.
#[inline(always)]
pub(crate) fn fuse<L, B: Block<L>>(rule: Rule, costs: &[B]) -> Option<B> {
    Some(match (rule, costs) {
        (_, &[a]) => a,
        (Rule::Min, &[a, b]) => a.min(b),
        (Rule::Min, &[a, b, c]) => a.min(b).min(c),
        (Rule::Min, &[a, b, c, d]) => a.min(b).min(c.min(d)),
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
        _ => return None,
    })
}

/// Six times the mean of `c1 <= c2 <= c3`, or of the first two if `c3 > 3 c2`.
///
/// In 16 bits nothing but the result is changed by saturation: where three times `c2` saturates, no `c3` is greater either way.
#[inline(always)]
fn heuristic<L, B: Block<L>>(c1: B, c2: B, c3: B) -> B {
    let two = c1.add(c2);
    let three = two.add(c3);
    c3.if_greater(c2.add(c2).add(c2), two.add(two).add(two), three.add(three))
}

/// The first index of a cost, 0 if no lane has it.
#[inline(always)]
pub(crate) fn position<L: Copy, I: Blocks<L>>(isa: I, costs: &[I::Costs], cost: L) -> usize {
    for (j, costs) in costs.iter().enumerate() {
        if let Some(lane) = isa.load_block(costs).position(cost) {
            return j * I::LANES + lane;
        }
    }
    0
}
