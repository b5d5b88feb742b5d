//! Winner-takes-all, and sub-pixel refinement.
//!
//! ```text
//! for each pixel, with its block sums and the views that see each candidate:
//!     fused = the rule over the available views, vector by vector
//!     fused[lanes past the last disparity] = MAX
//!     least = min(fused);  index = first lane that holds it
//!     if least == MAX:                      disparity and peak by exact costs
//!     else if index is an end of the search: disparity = min_disparity + index
//!     else if a neighbour's cost is MAX:    refine by exact costs
//!     else:                                 refine by the costs at index - 1, index, index + 1
//! ```
//!
//! Lanes are 16 or 32 bits wide and saturate, and their scale depends on the views that are available. `MAX` therefore
//! stands for three things that lanes cannot tell apart: a cost that has saturated, a candidate that no view sees, and
//! padding. Wherever it could change the result, [`Exact`] computes the pixel again in 32 bits. That is rare, at borders
//! and in noise; so lanes decide nearly all pixels, and the result is the one that exact costs define.
//!
//! Two ways lead here. [`Selection::slide_and_fuse`] and [`Selection::disparity`] take a pixel at a time, for small
//! processors, which have the least cost in a register still. [`Selection::disparities`] takes a batch that was fused
//! before: the latencies of finding the winner, loading its neighbours and dividing overlap across pixels on a processor
//! that executes out of order. Both give the same bits.
//!
//! A view can be hidden from a pixel in two ways. For rules that a large cost does not disturb, a mask raises its lanes to
//! `MAX` ([`Masks`]). Otherwise the disparities fall into segments that see the same views, and each is fused by itself.
//!
//! Peaks ask for the second minimum: the lanes at `index - 1`, `index` and `index + 1` are overwritten with `MAX`, and the
//! minimum is taken again.

use core::slice;

use super::exact::Exact;
use crate::{
    BlockMatchingParams, Disparity, Params,
    availability::Availability,
    confidence::PeakRatio,
    disparity::Around,
    infallible,
    kernel::{Block, Blocks, Isa, Lane, MAX_BATCH, Masks, Rule, Steps, Winners},
    params::PriorLine,
};

/// Selects disparities by their fused costs in lanes.
///
/// A lane that holds [`Lane::MAX`] has saturated, or belongs to no candidate.
pub(crate) struct Selection<'a, L: Lane, I: Blocks<L>, P> {
    isa: I,
    params: &'a P,
    pub rule: Rule,
    /// The index of each lane of a vector.
    indices: I::Costs,
    /// If the last vector has lanes past the last disparity: [`Lane::MAX`] in those lanes, and zero
    /// elsewhere.
    padding: Option<I::Costs>,
    /// Disparities with a neighbour on both sides.
    inner_disparities: usize,
    /// Those that [`disparity`](Selection::disparity) refines by a parabola: none around a prior.
    parabola_disparities: usize,
}

impl<'a, L: Lane, I: Blocks<L>, P: Params<BlockMatchingParams>> Selection<'a, L, I, P> {
    pub fn new(isa: I, constants: &'a P, rule: Rule) -> Selection<'a, L, I, P> {
        let params = constants.get();
        let mut indices = <I::Costs as bytemuck::Zeroable>::zeroed();
        let mut padding = indices;
        for index in 0..I::LANES {
            if let Some(lane) = lanes_mut::<L, _>(&mut indices).get_mut(I::lane(index)) {
                *lane = L::from_index(index);
            }
            let is_padding = index > (params.num_disparities() - 1) % I::LANES;
            if let Some(lane) = lanes_mut::<L, _>(&mut padding).get_mut(I::lane(index)).filter(|_| is_padding) {
                *lane = L::MAX;
            }
        }
        let padding = (!params.num_disparities().is_multiple_of(I::LANES)).then_some(padding);
        let inner_disparities = params.num_disparities().saturating_sub(2);
        let parabola_disparities = if params.prior().is_some() { 0 } else { inner_disparities };
        Selection { isa, params: constants, rule, indices, padding, inner_disparities, parabola_disparities }
    }

    /// Masks over `vectors`, in which all lanes are masked as yet, of a pixel that sees no view as yet.
    pub fn masks<'m, const V: usize>(
        &self,
        vectors: &'m mut [[I::Costs; V]],
        availability: &'m mut Availability,
        prior: Option<PriorLine<'m>>,
    ) -> Masks<'m, L, I, V> {
        Masks { vectors, availability, prior, padded: self.padding.is_some() }
    }

    /// Slides the block to the next pixel, fuses its sums, and returns the least fused cost. `masks` are at
    /// this pixel, and `masked` are the views that they hide.
    #[inline(always)]
    pub fn slide_and_fuse<const V: usize>(
        &self,
        masked: Option<u8>,
        masks: &Masks<'_, L, I, V>,
        steps: &mut Steps<'_, I, V>,
        blocks: &mut [[I::Costs; V]],
        fused: &mut [I::Costs],
    ) -> L {
        let Some(masked) = masked else {
            self.isa.slide(steps, blocks);
            return self.fuse_segments(masks.availability, blocks, fused);
        };
        let least = self.isa.slide_and_fuse(self.rule, masked, steps, blocks, masks.vectors, fused);
        if masked == 0 && self.padding.is_some() { self.least(fused) } else { least }
    }

    /// Fuses the sums of a block segment by segment, since masks cannot hide views here, and returns the
    /// least fused cost.
    #[cfg_attr(target_os = "none", inline(never))]
    #[cfg_attr(not(any(target_os = "none", debug_assertions)), inline(always))]
    fn fuse_segments<const V: usize>(&self, availability: &Availability, blocks: &[[I::Costs; V]], fused: &mut [I::Costs]) -> L {
        for segment in availability.segments() {
            // The next segment overwrites the lanes past the end of this one. Only the lanes before its start
            // have to be kept.
            let (first, end) = (segment.start / I::LANES, infallible::div_ceil(segment.end, I::LANES));
            let (Some(blocks), Some(fused)) = (blocks.get(first..end), fused.get_mut(first..end)) else { continue };
            let before = fused.first().copied();
            self.isa.fuse_available(self.rule, segment.views, blocks, fused);
            let lanes_before = segment.start - first * I::LANES;
            if let (Some(before), Some(costs)) = (before.filter(|_| lanes_before > 0), fused.first_mut()) {
                let (before, after) = (self.isa.load_block(&before), self.isa.load_block(costs));
                let start = self.isa.splat(L::from_index(lanes_before));
                start.if_greater(self.isa.load_block(&self.indices), before, after).store(costs);
            }
        }
        self.least(fused)
    }

    /// Hides the padding of a pixel's fused costs, and returns the least of them.
    #[inline(always)]
    fn least(&self, fused: &mut [I::Costs]) -> L {
        self.hide_padding(fused);
        self.isa.least(fused)
    }

    /// Raises the lanes past the last disparity to [`Lane::MAX`], if there are any.
    #[inline(always)]
    fn hide_padding(&self, fused: &mut [I::Costs]) {
        if let (Some(padding), Some(last)) = (&self.padding, fused.last_mut()) {
            self.isa.load_block(last).max(self.isa.load_block(padding)).store(last);
        }
    }

    /// The padding in the order of the disparities.
    #[inline(always)]
    pub fn ordered_padding(&self) -> Option<I::Block> {
        self.padding.map(|padding| self.isa.load_block(&padding).ordered())
    }

    /// The disparities of a batch of pixels, refined if both neighbours exist; by `exact` costs where lanes
    /// do not suffice.
    ///
    /// Every step is taken for all pixels before the next, so that the steps of different pixels overlap.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn disparities<'e, const V: usize>(
        &self,
        winners: &Winners<L>,
        pixels: &mut [Option<Disparity>],
        exact: impl Fn(usize) -> Exact<'e, L, I, P, V>,
    ) where
        I: 'e,
        P: 'e,
    {
        let mut around = Around { d: [0; MAX_BATCH], before: [0; MAX_BATCH], at: [0; MAX_BATCH], after: [0; MAX_BATCH] };
        let mut unclear = [false; MAX_BATCH];
        for (i, unclear) in unclear.iter_mut().enumerate() {
            let (index, at, before, after) = (winners.indices[i], winners.costs[i], winners.before[i], winners.after[i]);
            // The disparities at the ends of the search are not refined.
            let inner = index.wrapping_sub(1) < self.inner_disparities as u32;
            *unclear = (at == L::MAX) | (inner & ((before == L::MAX) | (after == L::MAX)));
            around.d[i] = self.params.get().min_disparity().wrapping_add(index as i16);
            around.before[i] = if inner { before } else { at }.widen();
            around.at[i] = at.widen();
            around.after[i] = if inner { after } else { at }.widen();
        }
        let refined = match self.params.get().prior() {
            Some(_) => Disparity::refine_all_equiangular(&around),
            None => Disparity::refine_all(&around),
        };
        match <&mut [_; MAX_BATCH]>::try_from(&mut *pixels) {
            Ok(pixels) => *pixels = refined,
            Err(_) => pixels.iter_mut().zip(refined).for_each(|(pixel, refined)| *pixel = refined),
        }
        if unclear != [false; MAX_BATCH] {
            for ((i, pixel), _) in pixels.iter_mut().enumerate().zip(unclear).filter(|(_, unclear)| *unclear) {
                *pixel = match (self.rule, winners.costs[i] == L::MAX) {
                    // The cost of a single view does not saturate, so there is no candidate.
                    (Rule::Min, true) => None,
                    (Rule::Min, false) => Disparity::whole(around.d[i]),
                    (_, true) => exact(i).disparity(),
                    (_, false) => exact(i).refined(winners.indices[i] as usize),
                };
            }
        }
    }

    /// The disparity of a pixel, given its least fused cost, refined if both neighbours exist; by `exact`
    /// costs where lanes do not suffice.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn disparity<'e, const V: usize>(
        &self,
        cost: L,
        fused: &[I::Costs],
        exact: impl FnOnce() -> Exact<'e, L, I, P, V>,
    ) -> Option<Disparity>
    where
        I: 'e,
        P: 'e,
    {
        match cost == L::MAX {
            true => exact().disparity(),
            false => self.disparity_at(self.isa.position(fused, cost), cost, fused, exact),
        }
    }

    /// The disparity of a pixel, if it is unique enough, and the grade of its peak ratio, given its least fused cost. It
    /// overwrites the fused costs.
    #[inline(always)]
    pub fn disparity_and_peak<'e, const V: usize>(
        &self,
        least: L,
        fused: &mut [I::Costs],
        unit: u32,
        exact: impl Fn() -> Exact<'e, L, I, P, V>,
    ) -> (Option<Disparity>, u8)
    where
        I: 'e,
        P: 'e,
    {
        if least == L::MAX {
            return exact().disparity_and_peak();
        }
        let index = self.isa.position(fused, least);
        let disparity = self.disparity_at(index, least, fused, &exact);
        let (grade, is_unique) = self.peak_at(index, least, fused, unit, lane::<I>, &exact);
        (disparity.filter(|_| is_unique), grade)
    }

    /// The disparity of the candidate at an index, which has the least fused cost.
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn disparity_at<'e, const V: usize>(
        &self,
        index: usize,
        cost: L,
        fused: &[I::Costs],
        exact: impl FnOnce() -> Exact<'e, L, I, P, V>,
    ) -> Option<Disparity>
    where
        I: 'e,
        P: 'e,
    {
        let before = index.wrapping_sub(1);
        // From the index whose range is checked, so that the compiler knows the sign.
        let d = self.params.get().min_disparity() + 1 + before as i16;
        let neighbours = || {
            let lanes: &[L] = bytemuck::try_cast_slice(fused).unwrap_or_default();
            let costs = (*lanes.get(lane::<I>(before))?, *lanes.get(lane::<I>(index + 1))?);
            (costs.0.max(costs.1) != L::MAX).then_some((costs.0.widen(), costs.1.widen()))
        };
        if before < self.parabola_disparities {
            return match neighbours() {
                Some((before, after)) => Disparity::refine(d, before, cost.widen(), after),
                None => exact().refined(index),
            };
        }
        // Either around a prior or at an end of the search.
        if self.parabola_disparities > 0 || before >= self.inner_disparities {
            return Disparity::whole(d);
        }
        match neighbours() {
            Some((before, after)) => Disparity::refine_equiangular(d, before, cost.widen(), after),
            None => exact().refined(index),
        }
    }
}

impl<L: Lane, I: Blocks<L>, P: Params<BlockMatchingParams>> Selection<'_, L, I, P> {
    /// A grey value's difference in each sample of the block, on the scale of the costs fused in lanes where these views are
    /// not available at all disparities.
    #[inline(always)]
    pub fn unit<const V: usize>(&self, incomplete: u8) -> u32 {
        self.params.get().block_area() * self.rule.scale(V, incomplete == 0)
    }

    /// The grades of the peak ratios of a batch of pixels with their `units`, from their fused costs, which it overwrites. Pixels
    /// that are not unique enough lose their disparity.
    #[cfg_attr(not(debug_assertions), inline(always))]
    pub fn peaks<'e, const V: usize>(
        &self,
        winners: &Winners<L>,
        fused: &mut [I::Costs],
        units: &[u32; MAX_BATCH],
        pixels: &mut [Option<Disparity>],
        mut peaks: Option<&mut [u8]>,
        exact: impl Fn(usize) -> Exact<'e, L, I, P, V>,
    ) where
        I: 'e,
        P: 'e,
    {
        let vectors = fused.len().checked_div(pixels.len()).unwrap_or_default().max(1);
        for (i, (pixel, fused)) in pixels.iter_mut().zip(fused.chunks_exact_mut(vectors)).enumerate() {
            let (least, index) = (winners.costs[i], winners.indices[i] as usize);
            let (grade, is_unique) = match least == L::MAX {
                true => exact(i).peak(),
                false => self.peak_at(index, least, fused, units[i], |index| index, || exact(i)),
            };
            if !is_unique {
                *pixel = None;
            }
            if let Some(peak) = peaks.as_mut().and_then(|peaks| peaks.get_mut(i)) {
                *peak = grade;
            }
        }
    }

    /// The [judgement](PeakRatio::judge) of the candidate at an index, whose lane is `lane(index)`.
    #[inline(always)]
    fn peak_at<'e, const V: usize>(
        &self,
        index: usize,
        least: L,
        fused: &mut [I::Costs],
        unit: u32,
        lane: impl Fn(usize) -> usize,
        exact: impl FnOnce() -> Exact<'e, L, I, P, V>,
    ) -> (u8, bool)
    where
        I: 'e,
        P: 'e,
    {
        let lanes: &mut [L] = bytemuck::try_cast_slice_mut(fused).unwrap_or_default();
        for near in [index.wrapping_sub(1), index, index + 1] {
            if let Some(cost) = lanes.get_mut(lane(near)) {
                *cost = L::MAX;
            }
        }
        let second = self.isa.least(fused);
        if !second.is_cost() {
            return exact().peak();
        }
        let ratio = PeakRatio { least: least.widen(), second: second.widen(), unit };
        PeakRatio::judge(Some(ratio), index, self.params.get().num_disparities(), self.params.get().uniqueness_ratio())
    }
}

/// The lane of the disparity at `index` among those of a pixel.
#[inline(always)]
fn lane<I: Isa>(index: usize) -> usize {
    index / I::LANES * I::LANES + I::lane(index % I::LANES)
}

/// The lanes of a vector.
fn lanes_mut<L: Lane, T: bytemuck::Pod>(vector: &mut T) -> &mut [L] {
    bytemuck::try_cast_slice_mut(slice::from_mut(vector)).unwrap_or_default()
}
