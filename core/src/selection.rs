//! From the block sums of a pixel to its disparity.

use crate::{
    Disparity, Params,
    availability::{Segment, Segments},
    kernel::{Kernel, Lane, Rule},
};

/// The block sums of one pixel, and how its disparity is chosen by them.
pub(crate) struct Selection<'a, L> {
    pub params: &'a Params,
    pub segments: &'a Segments,
    /// For each view, `depth` sums.
    pub blocks: &'a [L],
    pub depth: usize,
}

impl<L: Lane> Selection<'_, L> {
    /// The existing candidate of least fused cost, the smallest of several, refined between its neighbours.
    #[inline(always)]
    pub fn disparity<K: Kernel<L>>(&self, kernel: K, fused: &mut [L]) -> Option<Disparity> {
        let mut best: Option<(u32, usize)> = None;
        for segment in self.segments.iter().filter(|segment| segment.views != 0) {
            let candidate = self.winner(kernel, segment, fused);
            if best.is_none_or(|best| candidate.0 < best.0) {
                best = Some(candidate);
            }
        }
        let (cost, index) = best?;
        let d = self.params.min_disparity() + index as i16;
        match (index.checked_sub(1).and_then(|before| self.cost(before)), self.cost(index + 1)) {
            (Some(before), Some(after)) => Disparity::refine(d, before, cost, after),
            _ => Disparity::whole(d),
        }
    }

    /// The least fused cost of a segment and its first index.
    #[inline(always)]
    fn winner<K: Kernel<L>>(&self, kernel: K, segment: &Segment, fused: &mut [L]) -> (u32, usize) {
        let mut views: [&[L]; 4] = [&[]; 4];
        let available = self.blocks.chunks_exact(self.depth.max(1)).zip(0..).filter(|(_, k)| segment.views >> k & 1 != 0);
        let count = views.iter_mut().zip(available).map(|(view, (block, _))| *view = block).count();
        let (rule, factor) = Rule::new(self.params.fusion(), count);
        let (least, index) = kernel.winner(rule, views.get(..count).unwrap_or_default(), segment.start..segment.end, fused);
        if least != L::MAX {
            return (least.widen() * factor, index);
        }
        // Every sum saturated: rare, and so searched again without lanes.
        let costs = (segment.start..segment.end).filter_map(|index| Some((self.cost(index)?, index)));
        costs.min_by_key(|&(cost, _)| cost).unwrap_or((u32::MAX, segment.start))
    }

    /// The exact fused cost of a candidate, if it exists.
    #[inline(always)]
    fn cost(&self, index: usize) -> Option<u32> {
        let views = self.segments.views_at(index);
        let mut costs = [0; 4];
        let available = self.blocks.chunks_exact(self.depth.max(1)).zip(0..).filter(|(_, k)| views >> k & 1 != 0);
        let count = costs
            .iter_mut()
            .zip(available)
            .map(|(cost, (block, _))| *cost = block.get(index).map_or(0, |sum| sum.widen()))
            .count();
        self.params.fusion().fuse(costs.get_mut(..count).unwrap_or_default())
    }
}
