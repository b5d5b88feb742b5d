//! From the block sums of a pixel to its disparity.

use core::ops::Range;

use crate::{
    Disparity, Params,
    availability::{Segment, Segments},
    kernel::{self, Blocks, Lane, Rule},
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
    pub fn disparity<I: Blocks<L>>(&self, isa: I, fused: &mut [L]) -> Option<Disparity> {
        let mut best: Option<(u32, usize)> = None;
        let mut last = 0..0;
        let mut factor = 0;
        for segment in self.segments.iter().filter(|segment| segment.views != 0) {
            let (rule, views, count) = self.available(segment);
            last = segment.start..segment.end;
            factor = rule.factor(self.params.fusion(), count);
            let (least, index) = kernel::winner(isa, rule, views.get(..count).unwrap_or_default(), last.clone(), fused);
            let candidate = if least == L::MAX { self.search(last.clone()) } else { (least.widen() * factor, index) };
            if best.is_none_or(|best| candidate.0 < best.0) {
                best = Some(candidate);
            }
        }
        let (cost, index) = best?;
        // The lanes still hold the costs of the last segment.
        let neighbor = |index: usize| match fused.get(index) {
            Some(&lane) if lane != L::MAX && last.contains(&index) => Some(lane.widen() * factor),
            _ => self.cost(index),
        };
        let d = self.params.min_disparity() + index as i16;
        match (index.checked_sub(1).and_then(neighbor), neighbor(index + 1)) {
            (Some(before), Some(after)) => Disparity::refine(d, before, cost, after),
            _ => Disparity::whole(d),
        }
    }

    /// The block sums of the views in which a segment is available, how many they are, and the rule by which they are fused.
    #[inline(always)]
    fn available(&self, segment: &Segment) -> (Rule, [&[L]; 4], usize) {
        let mut views: [&[L]; 4] = [&[]; 4];
        let mut count = 0;
        for (k, sums) in self.sums().enumerate() {
            if let Some(view) = views.get_mut(count).filter(|_| segment.views >> k & 1 != 0) {
                *view = sums;
                count += 1;
            }
        }
        (Rule::new(self.params.fusion(), count), views, count)
    }

    /// The least exact cost of a segment and its first index: for the rare pixel where all lanes have saturated.
    fn search(&self, segment: Range<usize>) -> (u32, usize) {
        let costs = segment.clone().filter_map(|index| Some((self.cost(index)?, index)));
        costs.min_by_key(|&(cost, _)| cost).unwrap_or((u32::MAX, segment.start))
    }

    /// The exact fused cost of a candidate, if it exists.
    fn cost(&self, index: usize) -> Option<u32> {
        let available = self.segments.views_at(index);
        let mut costs = [0; 4];
        let mut count = 0;
        for (k, sums) in self.sums().enumerate() {
            if let Some(cost) = costs.get_mut(count).filter(|_| available >> k & 1 != 0) {
                *cost = sums.get(index).map_or(0, |sum| sum.widen());
                count += 1;
            }
        }
        self.params.fusion().fuse(costs.get_mut(..count).unwrap_or_default())
    }

    /// The block sums of each view.
    #[inline(always)]
    fn sums(&self) -> impl Iterator<Item = &[L]> {
        (0..self.params.views().len()).map(|k| self.blocks.get(k * self.depth..(k + 1) * self.depth).unwrap_or_default())
    }
}
