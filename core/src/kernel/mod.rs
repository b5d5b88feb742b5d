//! The inner loops of the matcher, along the disparities: one definition over the vectors of any instruction set.
//!
//! An instruction set is a type that implements [`Isa`] and [`Blocks`] with the few operations that the loops are made of. [`Portable`] does so in plain Rust
//! and is the definition of what they mean.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;

use core::{fmt::Debug, ops::Range};

#[cfg(target_arch = "x86_64")]
pub use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub use avx512::Avx512;
pub use portable::Portable;

use crate::Fusion;

/// A set of vector instructions, as a token: who has one may use them.
///
/// Vectors are loaded from the first [`LANES`](Isa::LANES) elements of a slice and stored there; a shorter slice gives zeros and takes
/// nothing. Lanes past the last disparity hold anything, so arithmetic wraps.
pub trait Isa: Copy + Debug {
    /// Disparities at a time, at least 1. The number of disparities is rounded up to a multiple.
    const LANES: usize;
    /// A vector of sums of absolute differences down a column of the block, each at most 21 x 255.
    type Column: Column;

    /// Column sums from memory.
    fn load_column(self, sums: &[u16]) -> Self::Column;
    /// The absolute differences between a sample of the centre and the samples of a view.
    fn differences(self, center: u8, view: &[u8]) -> Self::Column;
}

/// Vectors of block sums in lanes of type `L`.
pub trait Blocks<L>: Isa {
    /// A vector of sums of absolute differences over the block, or of costs fused of them.
    type Block: Block<L, Column = Self::Column>;

    /// Costs from memory.
    fn load_block(self, costs: &[L]) -> Self::Block;
    /// The same cost in every lane.
    fn splat(self, cost: L) -> Self::Block;
}

/// What is done with a vector of column sums.
pub trait Column: Copy {
    /// Puts the sums into memory.
    fn store(self, sums: &mut [u16]);
    /// Lane by lane, wrapping.
    fn add(self, other: Self) -> Self;
    /// Lane by lane, wrapping.
    fn sub(self, other: Self) -> Self;
}

/// What is done with a vector of block sums or costs.
pub trait Block<L>: Copy {
    /// The vector of column sums with as many lanes.
    type Column: Column;

    /// Puts the costs into memory.
    fn store(self, costs: &mut [L]);
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
pub trait Lane: Copy + Ord + Default + bytemuck::Pod {
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

impl<T> Change<T> {
    #[inline(always)]
    pub fn each_ref(&self) -> Change<&T> {
        Change { entering: &self.entering, leaving: &self.leaving }
    }

    #[inline(always)]
    pub fn map<U>(self, f: impl Fn(T) -> U) -> Change<U> {
        Change { entering: f(self.entering), leaving: f(self.leaving) }
    }
}

/// The step of a column of the block by a line, in one view.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step<'a> {
    /// The centre's samples.
    pub center: Change<u8>,
    /// The view's samples at every disparity.
    pub view: Change<&'a [u8]>,
}

impl Step<'_> {
    /// The vectors of the view's samples that enter and leave.
    #[inline(always)]
    fn vectors<I: Isa>(&self) -> impl Iterator<Item = Change<&[u8]>> {
        let leaving = self.view.leaving.chunks_exact(I::LANES);
        self.view.entering.chunks_exact(I::LANES).zip(leaving).map(|(entering, leaving)| Change { entering, leaving })
    }

    /// The sums of a column with the differences that enter and without those that leave.
    #[inline(always)]
    fn applied<I: Isa>(&self, isa: I, sums: &[u16], view: Change<&[u8]>) -> I::Column {
        let entering = isa.differences(self.center.entering, view.entering);
        let leaving = isa.differences(self.center.leaving, view.leaving);
        isa.load_column(sums).add(entering).sub(leaving)
    }
}

/// Adds to each disparity's column sum the difference that enters and takes away the one that leaves.
#[inline(always)]
pub(crate) fn update<I: Isa>(isa: I, column: &mut [u16], step: Step<'_>) {
    for (sums, view) in column.chunks_exact_mut(I::LANES).zip(step.vectors::<I>()) {
        step.applied(isa, sums, view).store(sums);
    }
}

/// As [`update`]; then slides the block sums on: the column enters, `trailing` leaves.
#[inline(always)]
pub(crate) fn advance<L, I: Blocks<L>>(isa: I, column: &mut [u16], trailing: &[u16], block: &mut [L], step: Step<'_>) {
    let sums = column.chunks_exact_mut(I::LANES).zip(trailing.chunks_exact(I::LANES)).zip(block.chunks_exact_mut(I::LANES));
    for (((sums, trailing), block), view) in sums.zip(step.vectors::<I>()) {
        let entering = step.applied(isa, sums, view);
        entering.store(sums);
        isa.load_block(block).slide(entering, isa.load_column(trailing)).store(block);
    }
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

/// Fuses the views' costs into `fused` by `rule`, saturating at [`Lane::MAX`], sets what lies outside `valid` to that
/// too, and returns the least cost with its first index.
///
/// If the least is [`Lane::MAX`], the index means nothing: all that is valid has saturated.
#[inline(always)]
pub(crate) fn winner<L: Lane, I: Blocks<L>>(
    isa: I,
    rule: Rule,
    views: &[&[L]],
    valid: Range<usize>,
    fused: &mut [L],
) -> (L, usize) {
    match (rule, views) {
        (_, &[a]) => fuse(isa, [a], fused, |[a]| a),
        (Rule::Min, &[a, b]) => fuse(isa, [a, b], fused, |[a, b]| a.min(b)),
        (Rule::Min, &[a, b, c]) => fuse(isa, [a, b, c], fused, |[a, b, c]| a.min(b).min(c)),
        (Rule::Min, &[a, b, c, d]) => fuse(isa, [a, b, c, d], fused, |[a, b, c, d]| a.min(b).min(c.min(d))),
        (Rule::Sum, &[a, b]) => fuse(isa, [a, b], fused, |[a, b]| a.add(b)),
        (Rule::Sum, &[a, b, c]) => fuse(isa, [a, b, c], fused, |[a, b, c]| a.add(b).add(c)),
        (Rule::Sum, &[a, b, c, d]) => fuse(isa, [a, b, c, d], fused, |[a, b, c, d]| a.add(b).add(c).add(d)),
        (Rule::Heuristic, &[a, b, c]) => fuse(isa, [a, b, c], fused, |[a, b, c]| {
            let (low, high) = (a.min(b), a.max(b));
            heuristic(low.min(c), low.max(c).min(high), high.max(c))
        }),
        (Rule::Heuristic, &[a, b, c, d]) => fuse(isa, [a, b, c, d], fused, |[a, b, c, d]| {
            let ((a, b), (c, d)) = ((a.min(b), a.max(b)), (c.min(d), c.max(d)));
            // Second and third are the greater of the lower ones and the lesser of the upper ones.
            let (x, y) = (a.max(c), b.min(d));
            heuristic(a.min(c), x.min(y), x.max(y))
        }),
        _ => fused.fill(L::MAX),
    }
    mask(fused, valid);
    let vectors = || fused.chunks_exact(I::LANES).map(|costs| isa.load_block(costs));
    let least = vectors().fold(isa.splat(L::MAX), I::Block::min).least();
    let position = vectors().enumerate().find_map(|(i, costs)| Some(i * I::LANES + costs.position(least)?));
    (least, position.unwrap_or_default())
}

/// Sets the costs outside `valid` to the greatest.
#[inline(always)]
fn mask<L: Lane>(costs: &mut [L], valid: Range<usize>) {
    if valid == (0..costs.len()) {
        return;
    }
    for (index, cost) in costs.iter_mut().enumerate() {
        if !valid.contains(&index) {
            *cost = L::MAX;
        }
    }
}

#[inline(always)]
fn fuse<L, I: Blocks<L>, const V: usize>(isa: I, views: [&[L]; V], fused: &mut [L], rule: impl Fn([I::Block; V]) -> I::Block) {
    for (i, fused) in fused.chunks_exact_mut(I::LANES).enumerate() {
        rule(views.map(|costs| isa.load_block(costs.get(i * I::LANES..).unwrap_or_default()))).store(fused);
    }
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
