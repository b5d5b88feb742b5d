//! From the block sums of a pixel to its disparity.

use core::slice;

use crate::{
    Disparity, MatchingCost, Params,
    availability::Availability,
    disparity::Around,
    kernel::{self, Block, Blocks, Lane, Rule, Steps, Winners},
};

const BATCH: usize = Winners::<()>::MAX;

/// The choice of a disparity by fused costs in lanes.
///
/// A lane that holds [`Lane::MAX`] has saturated, or belongs to no candidate.
pub(crate) struct Selection<'a, L: Lane, I: Blocks<L>> {
    isa: I,
    params: &'a Params,
    pub rule: Rule,
    /// The index of each lane of a vector.
    pub indices: I::Costs,
    /// If the last vector has lanes too many: zero in those that belong to a disparity, and the greatest cost in the others.
    pub excess: Option<I::Costs>,
    /// Disparities that have one on both sides.
    inner: usize,
}

impl<'a, L: Lane, I: Blocks<L>> Selection<'a, L, I> {
    pub fn new(isa: I, params: &'a Params, rule: Rule) -> Selection<'a, L, I> {
        let mut indices = <I::Costs as bytemuck::Zeroable>::zeroed();
        let mut excess = indices;
        for index in 0..I::LANES {
            if let Some(lane) = lanes_mut::<L, _>(&mut indices).get_mut(I::lane(index)) {
                *lane = L::from_index(index);
            }
            let is_excess = index > (params.num_disparities() - 1) % I::LANES;
            if let Some(lane) = lanes_mut::<L, _>(&mut excess).get_mut(I::lane(index)).filter(|_| is_excess) {
                *lane = L::MAX;
            }
        }
        let excess = (!params.num_disparities().is_multiple_of(I::LANES)).then_some(excess);
        Selection { isa, params, rule, indices, excess, inner: params.num_disparities().saturating_sub(2) }
    }

    /// The views that masks hide where these are incomplete.
    pub fn masked(&self, incomplete: u8) -> u8 {
        // Masks hide lanes that are too many in every view.
        if incomplete != 0 && self.excess.is_some() { u8::MAX } else { incomplete }
    }

    /// Goes to the next pixel and fuses its costs, those that masks leave in the `masked` views, and returns the least.
    #[inline(always)]
    pub fn slide_and_fuse<const V: usize>(
        &self,
        masked: u8,
        steps: &mut Steps<'_, I, V>,
        blocks: &mut [[I::Costs; V]],
        masks: &[[I::Costs; V]],
        fused: &mut [I::Costs],
    ) -> L {
        let least = self.isa.slide_and_fuse(self.rule, masked, steps, blocks, masks, fused);
        if masked == 0 && self.excess.is_some() { self.least(fused) } else { least }
    }

    /// Fuses the costs of a pixel segment by segment, and returns the least.
    #[cfg_attr(target_arch = "arm", inline(never))]
    #[cfg_attr(not(any(target_arch = "arm", debug_assertions)), inline(always))]
    pub fn fuse_segments<const V: usize>(
        &self,
        availability: &Availability<'_>,
        blocks: &[[I::Costs; V]],
        fused: &mut [I::Costs],
    ) -> L {
        for segment in availability.segments() {
            // Each segment is followed by the next, so that lanes past its end do not matter; of its first vector the lanes before its start
            // are kept.
            let (first, end) = (segment.start / I::LANES, segment.end.div_ceil(I::LANES));
            let (Some(blocks), Some(fused)) = (blocks.get(first..end), fused.get_mut(first..end)) else { continue };
            let before = fused.first().copied();
            self.isa.fuse_available(self.rule, segment.views, blocks, fused);
            let kept = segment.start - first * I::LANES;
            if let (Some(before), Some(costs)) = (before.filter(|_| kept > 0), fused.first_mut()) {
                let (before, after) = (self.isa.load_block(&before), self.isa.load_block(costs));
                let kept = self.isa.splat(L::from_index(kept));
                kept.if_greater(self.isa.load_block(&self.indices), before, after).store(costs);
            }
        }
        self.least(fused)
    }

    /// The least of a pixel's fused costs, in which lanes too many do not count.
    #[inline(always)]
    fn least(&self, fused: &mut [I::Costs]) -> L {
        kernel::hide_excess(self.isa, &self.excess, fused);
        self.isa.least(fused)
    }

    /// The disparities of a batch of pixels, refined between neighbours; those by [`Exact`] costs where lanes do not tell.
    ///
    /// Step by step for all pixels: each step takes long, but does not wait for that of another pixel.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn disparities<'e, const V: usize>(
        &self,
        winners: &Winners<L>,
        pixels: &mut [Option<Disparity>],
        exact: impl Fn(usize) -> Exact<'e, L, I, V>,
    ) where
        I: 'e,
    {
        let mut around = Around { d: [0; BATCH], before: [0; BATCH], at: [0; BATCH], after: [0; BATCH] };
        let mut unclear = [false; BATCH];
        for (i, unclear) in unclear.iter_mut().enumerate() {
            let (index, at, before, after) = (winners.indices[i], winners.costs[i], winners.before[i], winners.after[i]);
            // At the ends of the search the disparity is left as it is.
            let inner = index.wrapping_sub(1) < self.inner as u32;
            *unclear = (at == L::MAX) | (inner & ((before == L::MAX) | (after == L::MAX)));
            around.d[i] = self.params.min_disparity().wrapping_add(index as i16);
            around.before[i] = if inner { before } else { at }.widen();
            around.at[i] = at.widen();
            around.after[i] = if inner { after } else { at }.widen();
        }
        let refined = Disparity::refine_all(&around);
        match <&mut [_; BATCH]>::try_from(&mut *pixels) {
            Ok(pixels) => *pixels = refined,
            Err(_) => pixels.iter_mut().zip(refined).for_each(|(pixel, refined)| *pixel = refined),
        }
        if unclear != [false; BATCH] {
            for ((i, pixel), _) in pixels.iter_mut().enumerate().zip(unclear).filter(|(_, unclear)| *unclear) {
                *pixel = match (self.rule, winners.costs[i] == L::MAX) {
                    // A cost of one view does not saturate: there is no candidate.
                    (Rule::Min, true) => None,
                    (Rule::Min, false) => Disparity::whole(around.d[i]),
                    (_, true) => exact(i).disparity(),
                    (_, false) => exact(i).refined(winners.indices[i] as usize),
                };
            }
        }
    }

    /// The disparity of a pixel by its least cost.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn disparity<'e, const V: usize>(
        &self,
        cost: L,
        fused: &[I::Costs],
        exact: impl FnOnce() -> Exact<'e, L, I, V>,
    ) -> Option<Disparity>
    where
        I: 'e,
    {
        if cost == L::MAX {
            return exact().disparity();
        }
        let index = self.isa.position(fused, cost);
        let d = self.params.min_disparity() + index as i16;
        let before = index.wrapping_sub(1);
        if before >= self.inner {
            return Disparity::whole(d);
        }
        let lanes: &[L] = bytemuck::try_cast_slice(fused).unwrap_or_default();
        match (lanes.get(kernel::lane::<I>(before)), lanes.get(kernel::lane::<I>(index + 1))) {
            (Some(&before), Some(&after)) if before.max(after) != L::MAX => {
                Disparity::refine(d, before.widen(), cost.widen(), after.widen())
            }
            _ => exact().refined(index),
        }
    }
}

/// A vector's lanes.
fn lanes_mut<L: Lane, T: bytemuck::Pod>(vector: &mut T) -> &mut [L] {
    bytemuck::try_cast_slice_mut(slice::from_mut(vector)).unwrap_or_default()
}

/// The exact fused costs of a pixel, one by one: for where lanes have saturated, and next to disparities at which no view is available.
pub(crate) struct Exact<'a, L: Lane, I: Blocks<L>, const V: usize> {
    pub params: &'a Params,
    /// The pixel.
    pub u: usize,
    pub v: usize,
    /// The sums of its block.
    pub blocks: &'a [[I::Costs; V]],
}

impl<L: Lane, I: Blocks<L>, const V: usize> Exact<'_, L, I, V> {
    /// The existing candidate of least fused cost, the smallest of several, refined between its neighbours.
    #[cold]
    pub fn disparity(&self) -> Option<Disparity> {
        let availability = Availability::new(self.params, self.u, self.v);
        if availability.is_empty() {
            return None;
        }
        let all = 0..self.params.num_disparities();
        let costs = all.filter_map(|index| Some((self.cost(&availability, index)?, index)));
        let (_, index) = costs.min_by_key(|&(cost, _)| cost)?;
        self.refined(index)
    }

    /// The disparity at `index`, refined if both neighbours exist.
    #[cold]
    pub fn refined(&self, index: usize) -> Option<Disparity> {
        let availability = Availability::new(self.params, self.u, self.v);
        let cost = |index| self.cost(&availability, index);
        let d = self.params.min_disparity() + index as i16;
        match (cost(index.wrapping_sub(1)), cost(index), cost(index + 1)) {
            (Some(before), Some(at), Some(after)) => Disparity::refine(d, before, at, after),
            _ => Disparity::whole(d),
        }
    }

    /// The fused cost of a candidate, if it exists.
    fn cost(&self, availability: &Availability<'_>, index: usize) -> Option<u32> {
        let available = availability.views_at(index);
        let views = self.blocks.get(index / I::LANES)?;
        let mut costs = [u32::NONE; V];
        for (_, (cost, sums)) in costs.iter_mut().zip(views).enumerate().filter(|(k, _)| available >> k & 1 != 0) {
            let lanes: &[L] = bytemuck::try_cast_slice(slice::from_ref(sums)).ok()?;
            *cost = lanes.get(I::lane(index % I::LANES))?.widen();
        }
        Some(self.params.fusion().fuse(costs)).filter(|cost| cost.exists())
    }
}
