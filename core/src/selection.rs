//! From the block sums of a pixel to its disparity.

use crate::{
    Disparity, Params,
    availability::{Segment, Segments},
    kernel::{self, Block, Blocks, Lane, Rule},
};

/// The choice of a disparity by the block sums of one pixel.
pub(crate) struct Selection<'a, L, I: Blocks<L>, const V: usize> {
    pub isa: I,
    pub params: &'a Params,
    pub segments: &'a Segments,
    pub blocks: &'a [[I::Costs; V]],
}

impl<L: Lane, I: Blocks<L>, const V: usize> Selection<'_, L, I, V> {
    /// The existing candidate of least fused cost, the smallest of several, refined between its neighbours.
    ///
    /// `fused` is a buffer for the costs of all candidates.
    #[inline(always)]
    pub fn disparity(&self, fused: &mut [I::Costs]) -> Option<Disparity> {
        let mut best: Option<(u32, usize)> = None;
        for segment in self.segments.iter().filter(|segment| segment.views != 0) {
            let candidate = self.winner(segment, fused);
            if best.is_none_or(|best| candidate.0 < best.0) {
                best = Some(candidate);
            }
        }
        let (cost, index) = best?;
        refined(self.params, index, self.cost(index.wrapping_sub(1)), cost, self.cost(index + 1))
    }

    /// As [`disparity`](Selection::disparity) where all views are available at all disparities and `fused` holds the costs by `rule`
    /// already, whose least in each lane is `least`. Nothing is known, `None`, if all have saturated.
    #[inline(always)]
    pub fn disparity_of_fused(&self, rule: Rule, fused: &[I::Costs], least: I::Block) -> Option<Option<Disparity>> {
        let least = least.least();
        if least == L::MAX {
            return None;
        }
        let index = kernel::position(self.isa, fused, least);
        let factor = rule.factor(self.params.fusion(), V);
        let lanes: &[L] = bytemuck::try_cast_slice(fused).unwrap_or_default();
        let before = self.cost_in_lanes(lanes, index.wrapping_sub(1), factor);
        let after = self.cost_in_lanes(lanes, index + 1, factor);
        Some(refined(self.params, index, before, least.widen() * factor, after))
    }

    /// The fused cost of a candidate from its lane, where that has not saturated.
    #[inline(always)]
    fn cost_in_lanes(&self, lanes: &[L], index: usize, factor: u32) -> Option<u32> {
        match lanes.get(index) {
            Some(&lane) if lane != L::MAX => Some(lane.widen() * factor),
            _ => self.cost(index),
        }
    }

    /// The least fused cost in a segment and its first index.
    #[inline(always)]
    fn winner(&self, segment: &Segment, fused: &mut [I::Costs]) -> (u32, usize) {
        let count = segment.views.count_ones() as usize;
        let rule = Rule::new(self.params.fusion(), count);
        // The vectors that the segment touches, of which the first and the last may be in part outside.
        let touched = segment.start / I::LANES..segment.end.div_ceil(I::LANES);
        let start = touched.start * I::LANES;
        let blocks = self.blocks.get(touched.clone()).unwrap_or_default();
        let fused = fused.get_mut(touched).unwrap_or_default();
        let mut costs = [self.isa.splat(L::MAX); V];
        for (fused, block) in fused.iter_mut().zip(blocks) {
            let mut available = costs.iter_mut();
            for (k, block) in block.iter().enumerate() {
                let available = if segment.views >> k & 1 != 0 { available.next() } else { None };
                if let Some(costs) = available {
                    *costs = self.isa.load_block(block);
                }
            }
            if let Some(costs) = costs.get(..count).and_then(|costs| kernel::fuse(rule, costs)) {
                costs.store(fused);
            }
        }
        let lanes: &mut [L] = bytemuck::try_cast_slice_mut(fused).unwrap_or_default();
        lanes.iter_mut().take(segment.start - start).for_each(|lane| *lane = L::MAX);
        lanes.iter_mut().skip(segment.end - start).for_each(|lane| *lane = L::MAX);
        let mut least = self.isa.splat(L::MAX);
        for costs in &*fused {
            least = least.min(self.isa.load_block(costs));
        }
        let least = least.least();
        if least == L::MAX {
            return self.search(segment);
        }
        (least.widen() * rule.factor(self.params.fusion(), count), start + kernel::position(self.isa, fused, least))
    }

    /// The least exact cost in a segment and its first index: for the rare one where all lanes have saturated.
    fn search(&self, segment: &Segment) -> (u32, usize) {
        let costs = (segment.start..segment.end).filter_map(|index| Some((self.cost(index)?, index)));
        costs.min_by_key(|&(cost, _)| cost).unwrap_or((u32::MAX, segment.start))
    }

    /// The exact fused cost of a candidate, if it exists.
    fn cost(&self, index: usize) -> Option<u32> {
        let available = self.segments.views_at(index);
        let block = self.blocks.get(index / I::LANES)?;
        let mut costs = [0; V];
        let mut count = 0;
        for (_, lanes) in block.iter().enumerate().filter(|(k, _)| available >> k & 1 != 0) {
            let lanes: &[L] = bytemuck::try_cast_slice(core::slice::from_ref(lanes)).unwrap_or_default();
            *costs.get_mut(count)? = lanes.get(index % I::LANES)?.widen();
            count += 1;
        }
        self.params.fusion().fuse(costs.get_mut(..count)?)
    }
}

/// The disparity of an index by its cost, refined if both neighbours exist and have one too.
#[inline(always)]
fn refined(params: &Params, index: usize, before: Option<u32>, cost: u32, after: Option<u32>) -> Option<Disparity> {
    let d = params.min_disparity() + index as i16;
    match (before, after) {
        (Some(before), Some(after)) => Disparity::refine(d, before, cost, after),
        _ => Disparity::whole(d),
    }
}
