//! The inner loops over the disparities of a pixel.
//!
//! Block matching spends its time here. For the next pixel, in each view and at each disparity:
//!
//! ```text
//! column   = column + |c - s| - |c' - s'|     // c, s enter at the bottom of the column, c', s' leave at its top
//! block    = block + column - leaving_column  // columns enter on the right and leave on the left
//! fused    = rule(block of view 0, block of view 1, ...), raised to MAX where a mask is MAX
//! least    = min(least, fused)
//! ```
//!
//! So a candidate costs two differences and four additions per view, whatever the size of the block. Column sums carry
//! over from line to line and block sums from pixel to pixel; both wrap, since additions and subtractions cancel.
//! Column sums are 16 bits wide; block sums are 16 or 32, the [`Lane`].
//!
//! Data layout: a vector holds [`LANES`](Isa::LANES) neighbouring disparities of one view. A block is `[[Costs; V]]`, the
//! vectors of all views at the same disparities side by side, because fusion needs them together. Columns and samples are
//! view by view, because they come from different tracks.
//!
//! The provided methods are the definition. An instruction set overrides what it can do better: Arm's DSP and MVE have
//! [`slide_and_fuse`](Blocks::slide_and_fuse) in assembly, and instruction sets with many registers keep the blocks of a
//! [batch](super::Batch) in them.

use core::{ops::Range, slice};

use bytemuck::Pod;

use super::{
    isa::{Block, Change, Column, Isa, Lane},
    rule::Rule,
    steps::Steps,
};
use crate::{availability::Availability, params::PriorLine};

/// An instruction set with vectors of block sums in lanes of type `L`, and the inner loops over them.
///
/// The provided loops are their definition. An instruction set that overrides one computes the same.
pub trait Blocks<L: Lane>: Isa {
    /// True if batches keep the sums of a block in registers, if it has one vector or two in each view.
    const IN_REGISTERS: bool = false;
    /// The most views that masks hide from [`Rule::Sum`] of two to four at a pixel: up to these,
    /// [`fuse_masked`](Blocks::fuse_masked) is faster than [`fuse_available`](Blocks::fuse_available), run by run.
    const MOST_MASKED_OF_SUM: u32 = 0;
    /// True if [`Rule::Half`] of three or four views is fused in lanes. Otherwise exact costs do, one by one.
    const FUSES_HALF: bool = Rule::HAS_HALF;
    /// A vector of costs in memory.
    type Costs: Pod;
    /// A vector of block sums, or of costs fused from them.
    type Block: Block<L, Costs = Self::Costs, Column = Self::Column>;

    /// Loads costs.
    fn load_block(self, costs: &Self::Costs) -> Self::Block;
    /// The same cost in every lane.
    fn splat(self, cost: L) -> Self::Block;
    /// The index of the first disparity with a cost, and one past all disparities if there is none. If pixels
    /// go in batches, the costs are in the order of the disparities.
    fn position(self, costs: &[Self::Costs], cost: L) -> usize;

    /// Adds the line that enters to the sums of the next column.
    #[inline(always)]
    fn prime<const V: usize>(self, steps: &mut Steps<'_, Self, V>) {
        let Some(step) = steps.next() else { return };
        for (column, view) in step.entering.chunks_exact_mut(step.vectors.max(1)).zip(step.views) {
            for (sums, samples) in column.iter_mut().zip(view.entering) {
                self.load_column(sums).add(self.differences(step.center.entering, samples)).store(sums);
            }
        }
    }

    /// Moves the next column down by a line, and slides the block by that column.
    #[inline(always)]
    fn slide<const V: usize>(self, steps: &mut Steps<'_, Self, V>, blocks: &mut [[Self::Costs; V]]) {
        slide_loop::<L, Self, V>(self, steps, blocks);
    }

    /// Fuses block sums, all views being available, and returns the least fused cost.
    #[inline(always)]
    fn fuse<const V: usize>(self, rule: Rule, blocks: &[[Self::Costs; V]], fused: &mut [Self::Costs]) -> L {
        fuse_loop(self, rule, blocks, fused)
    }

    /// Fuses block sums, each raised to [`Lane::MAX`] where its mask is that; elsewhere the mask is zero.
    /// Returns the least fused cost. Only the views whose bits are set in `masked` have a mask that is not
    /// zero.
    #[inline(always)]
    fn fuse_masked<const V: usize>(
        self,
        rule: Rule,
        masked: u8,
        blocks: &[[Self::Costs; V]],
        masks: &[[Self::Costs; V]],
        fused: &mut [Self::Costs],
    ) -> L {
        match masked {
            0 => self.fuse(rule, blocks, fused),
            _ => fuse_masked_loop(self, rule, blocks, masks, fused),
        }
    }

    /// [`slide`](Blocks::slide) and [`fuse_masked`](Blocks::fuse_masked) in one.
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
        self.fuse_masked(rule, masked, blocks, masks, fused)
    }

    /// Fuses the block sums of the `available` views, a bit for each, on one scale whatever their number;
    /// [`Lane::MAX`] if there is none.
    #[inline(always)]
    fn fuse_available<const V: usize>(self, rule: Rule, available: u8, blocks: &[[Self::Costs; V]], fused: &mut [Self::Costs]) {
        for (fused, block) in fused.iter_mut().zip(blocks) {
            let mut costs = [self.splat(rule.neutral()); V];
            for k in 0..V {
                if available >> k & 1 != 0 {
                    costs[k] = self.load_block(&block[k]);
                }
            }
            rule.fuse_available(available, costs, self.splat(L::MAX)).store(fused);
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

    /// Puts costs from the order of the lanes into that of the disparities.
    #[inline(always)]
    fn order(self, costs: &mut [Self::Costs]) {
        for costs in costs {
            self.load_block(costs).ordered().store(costs);
        }
    }
}

/// The properties of [`Blocks`] that unsafe code relies on.
pub(super) const fn assert_costs<L: Lane, I: Blocks<L>>() {
    assert!(size_of::<I::Costs>() == I::LANES * size_of::<L>(), "costs are not one lane for each disparity");
}

/// Moves a column and slides the block vector by vector.
#[inline(always)]
pub(super) fn slide_loop<L: Lane, I: Blocks<L>, const V: usize>(
    isa: I,
    steps: &mut Steps<'_, I, V>,
    blocks: &mut [[I::Costs; V]],
) {
    let Some(step) = steps.next() else { return };
    let vectors = step.vectors.max(1);
    let columns = step.entering.chunks_exact_mut(vectors).zip(step.leaving.chunks_exact(vectors));
    for (k, ((column, leaving_column), view)) in columns.zip(step.views).enumerate() {
        let samples = view.entering.iter().zip(view.leaving);
        for (((sums, leaving_sums), block), (entering, leaving)) in
            column.iter_mut().zip(leaving_column).zip(&mut *blocks).zip(samples)
        {
            let moved = isa.advance(isa.load_column(sums), step.center, Change { entering, leaving });
            moved.store(sums);
            let Some(block) = block.get_mut(k) else { return };
            isa.load_block(block).slide(moved, isa.load_column(leaving_sums)).store(block);
        }
    }
}

/// Fuses vector by vector, and returns the least fused cost.
///
/// On Arm it is a function of its own: the loops for the usual rules, in assembly, then need fewer registers. It has a
/// loop for the sum, which is the only rule that comes here often.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
pub(super) fn fuse_loop<L: Lane, I: Blocks<L>, const V: usize>(
    isa: I,
    rule: Rule,
    blocks: &[[I::Costs; V]],
    fused: &mut [I::Costs],
) -> L {
    match rule {
        Rule::Sum if cfg!(target_os = "none") => fuse_by_rule(isa, Rule::Sum, blocks, fused),
        _ => fuse_by_rule(isa, rule, blocks, fused),
    }
}

#[inline(always)]
fn fuse_by_rule<L: Lane, I: Blocks<L>, const V: usize>(
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
        let costs = rule.fuse(costs);
        costs.store(fused);
        least = least.min(costs);
    }
    least.least()
}

/// [`fuse_loop`] with masks.
#[cfg_attr(target_os = "none", inline(never))]
#[cfg_attr(not(target_os = "none"), inline(always))]
pub(super) fn fuse_masked_loop<L: Lane, I: Blocks<L>, const V: usize>(
    isa: I,
    rule: Rule,
    blocks: &[[I::Costs; V]],
    masks: &[[I::Costs; V]],
    fused: &mut [I::Costs],
) -> L {
    let maximum = isa.splat(L::MAX);
    let mut least = maximum;
    for ((fused, block), mask) in fused.iter_mut().zip(blocks).zip(masks) {
        let mut costs = [least; V];
        for k in 0..V {
            costs[k] = isa.load_block(&block[k]).max(isa.load_block(&mask[k]));
        }
        let costs = rule.fuse_masked(costs, maximum);
        costs.store(fused);
        least = least.min(costs);
    }
    least.least()
}

/// Masks for the block sums of a pixel: [`Lane::MAX`] where a view is not available, and in lanes past the
/// last disparity; zero elsewhere.
///
/// They follow the pixel lane by lane: at a border, few of them change from one pixel to the next.
#[derive(Debug)]
pub(crate) struct Masks<'a, L: Lane, I: Blocks<L>, const V: usize> {
    /// All [`Lane::MAX`] at first.
    pub vectors: &'a mut [[I::Costs; V]],
    pub availability: &'a mut Availability,
    /// Around which the line is searched.
    pub prior: Option<PriorLine<'a>>,
    /// True if there are lanes past the last disparity.
    pub padded: bool,
}

impl<L: Lane, I: Blocks<L>, const V: usize> Masks<'_, L, I, V> {
    /// Goes to pixel `(u, v)`.
    #[inline(always)]
    pub fn enter_line(&mut self, u: usize, v: usize) {
        self.availability.enter_line(u, v, self.prior, |k, index, available| set::<L, I, V>(self.vectors, k, index, available));
    }

    /// Goes to the pixel at `u`, to the right in the same line, and returns whether anything may have
    /// changed.
    #[inline(always)]
    pub fn enter(&mut self, u: usize) -> bool {
        self.availability.enter::<V>(u, self.prior, |k, index, available| set::<L, I, V>(self.vectors, k, index, available))
    }

    /// The views that are not available at all disparities in all of these columns of the line, as bits.
    #[inline(always)]
    pub fn incomplete_in(&self, columns: Range<usize>) -> u8 {
        self.availability.incomplete_in(columns, self.prior)
    }

    /// The views whose masks are not zero, as bits, or `None` if masks cannot hide views from `rule` here. If
    /// no view has to be hidden there are none: lanes past the last disparity are then left to the caller.
    #[inline(always)]
    pub fn masked(&self, rule: Rule) -> Option<u8> {
        let incomplete = self.availability.incomplete();
        let masked = if incomplete != 0 && self.padded { u8::MAX } else { incomplete };
        // Of a sum, padding takes as many masks as views that are not available.
        Self::can_hide(rule, if rule == Rule::Sum { masked } else { incomplete }).then_some(masked)
    }

    /// True if masks can hide `incomplete` views, a bit for each, from `rule`.
    #[inline(always)]
    pub fn can_hide(rule: Rule, incomplete: u8) -> bool {
        let masked_of_sum = (incomplete & (u8::MAX >> (8 - V))).count_ones();
        let hides_from_sum = const { I::MOST_MASKED_OF_SUM > 0 && V <= 4 } && rule == Rule::Sum;
        incomplete == 0
            || hides_from_sum && masked_of_sum <= I::MOST_MASKED_OF_SUM
            || rule.masks(V, incomplete.count_ones() as usize)
    }
}

/// Sets the mask of the `k`-th view at a disparity.
#[inline(always)]
fn set<L: Lane, I: Blocks<L>, const V: usize>(vectors: &mut [[I::Costs; V]], k: usize, index: usize, available: bool) {
    let vector = vectors.get_mut(index / I::LANES).and_then(|views| views.get_mut(k));
    let lanes = vector.and_then(|vector| bytemuck::try_cast_slice_mut::<_, L>(slice::from_mut(vector)).ok());
    if let Some(lane) = lanes.and_then(|lanes| lanes.get_mut(I::lane(index % I::LANES))) {
        *lane = if available { L::default() } else { L::MAX };
    }
}
