//! A batch of pixels: along the sums, to their fused costs.

use core::ops::Range;

use super::{Block, Blocks, Lane, Rule, Steps};
use crate::availability::Availability;

/// Pixels next to each other in a line.
#[derive(Debug)]
pub struct Batch<'a, L: Lane, I: Blocks<L>, const V: usize> {
    /// How the views' costs become one.
    pub rule: Rule,
    /// The sums of the block before these pixels, and after them.
    pub blocks: &'a mut [[I::Costs; V]],
    /// What hides them where views are not available, if there are such pixels.
    pub masks: Option<Masks<'a, L, I, V>>,
    /// The sums of each pixel's block; none by the rule of the least cost, with which they are not looked at again.
    pub each: &'a mut [[I::Costs; V]],
    /// The fused costs of each pixel, in the order of the disparities.
    pub fused: &'a mut [I::Costs],
}

/// What hides the sums of a block where views are not available.
#[derive(Debug)]
pub struct Masks<'a, L: Lane, I: Blocks<L>, const V: usize> {
    /// The greatest cost where a view is not available, and zero elsewhere.
    pub lanes: &'a mut [[I::Costs; V]],
    /// The index of each lane of a vector.
    pub indices: I::Costs,
    /// Where the views are available to the first pixel.
    pub(crate) availability: Availability<'a>,
    /// The columns of the pixels.
    pub columns: Range<usize>,
    /// Whether it is the same at all of them.
    pub is_uniform: bool,
}

impl<L: Lane, I: Blocks<L>, const V: usize> Batch<'_, L, I, V> {
    /// Goes over the pixels one after the other.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub(super) fn run(self, isa: I, steps: &mut Steps<'_, I, V>) {
        let Batch { rule, blocks, mut masks, each, fused } = self;
        let mut each = each.chunks_exact_mut(blocks.len().max(1));
        for (i, fused) in fused.chunks_exact_mut(blocks.len().max(1)).enumerate() {
            isa.slide(steps, blocks);
            match &mut masks {
                Some(masks) => isa.fuse_masked(rule, u8::MAX, blocks, masks.of_pixel(isa, i), fused),
                None => isa.fuse(rule, blocks, fused),
            };
            if let Some(each) = each.next() {
                each.copy_from_slice(blocks);
            }
            order(isa, fused);
        }
    }
}

impl<L: Lane, I: Blocks<L>, const V: usize> Masks<'_, L, I, V> {
    /// Those of the next pixel, the `i`-th, in vectors.
    #[inline(always)]
    pub(super) fn of_pixel(&mut self, isa: I, i: usize) -> &[[I::Costs; V]] {
        if i == 0 || !self.is_uniform {
            self.availability.enter(self.columns.start + i);
            let (indices, shown, hidden) = (isa.load_block(&self.indices), isa.splat(L::default()), isa.splat(L::MAX));
            for (k, range) in self.availability.ranges::<V>().enumerate() {
                for (j, masks) in self.lanes.iter_mut().enumerate() {
                    let from = |index: u16| isa.splat(L::from_index(usize::from(index).saturating_sub(j * I::LANES)));
                    let before = from(range.start).if_greater(indices, hidden, shown);
                    from(range.end).if_greater(indices, before, hidden).store(&mut masks[k]);
                }
            }
        }
        self.lanes
    }
}

/// Puts costs from lanes into the order of the disparities.
#[inline(always)]
pub(crate) fn order<L: Lane, I: Blocks<L>>(isa: I, fused: &mut [I::Costs]) {
    for costs in fused {
        isa.load_block(costs).ordered().store(costs);
    }
}
