//! Exact fused costs, for the pixels whose lanes do not suffice.
//!
//! This is the definition of a pixel's result, in scalar code; lanes compute the same where they can.
//!
//! ```text
//! available[k] = range of candidates at which view k sees the pixel         // by geometry, not by masks
//! cost(index)  = fuse over k of (index in available[k] ? sums[index][k] : NONE)
//! winner       = first index of least cost among candidates that exist
//! refined(i)   = whole(d) unless cost(i - 1), cost(i) and cost(i + 1) all exist, else the parabola
//!                (two lines around a prior)
//! peak         = (least, least of the costs more than one index away from the winner)
//! ```
//!
//! The block sums are those of the lanes: 16 bits hold the sum of any block that has lanes of 16 bits, so only the fused
//! cost, which is a multiple of it, can have saturated there. [`Fusion::fuse`] takes the sums widened to 32 bits.
//!
//! Each call visits all candidates. It is `#[cold]`, and no state outlives it: the callers' loops stay as small as without
//! it. Where an instruction set does not [fuse](Blocks::FUSES_HALF) the rule [`Fusion::Half`] in lanes, every pixel is computed
//! here.

use core::{ops::Range, slice};

use crate::{
    BlockMatchingParams, Disparity, Fusion, MatchingCost, Params, SemiGlobalParams,
    confidence::PeakRatio,
    kernel::{Blocks, Lane},
    params::PriorLine,
};

/// The fused costs of a pixel in 32 bits, one by one. They are needed where lanes have saturated, and next to
/// disparities at which no view is available.
#[derive(Clone, Copy)]
pub(crate) struct Exact<'a, L: Lane, I: Blocks<L>, P, const V: usize> {
    pub params: &'a P,
    /// The pixel's column.
    pub u: usize,
    /// The pixel's line.
    pub v: usize,
    /// Around which its line is searched.
    pub prior: Option<PriorLine<'a>>,
    /// The sums of its block.
    pub blocks: &'a [[I::Costs; V]],
}

impl<L: Lane, I: Blocks<L>, P: Params<BlockMatchingParams>, const V: usize> Exact<'_, L, I, P, V> {
    /// The disparity of the existing candidate of least fused cost, the smallest if several tie, refined if
    /// both neighbours exist.
    #[cold]
    pub fn disparity(&self) -> Option<Disparity> {
        let (_, index) = self.winner(&self.available(), |_| true)?;
        self.refined(index)
    }

    /// The disparity, if it is unique enough, and the grade of its peak ratio.
    #[cold]
    pub fn disparity_and_peak(&self) -> (Option<Disparity>, u8) {
        let (grade, is_unique) = self.peak();
        (self.disparity().filter(|_| is_unique), grade)
    }

    /// The [judgement](PeakRatio::judge) of the existing candidate of least fused cost.
    #[cold]
    pub fn peak(&self) -> (u8, bool) {
        let available = self.available();
        let Some((least, index)) = self.winner(&available, |_| true) else { return (0, true) };
        let ratio = self.winner(&available, |other| other.abs_diff(index) > 1).map(|(second, _)| {
            let scale = self.params.get().fusion().scale(V) as u32;
            PeakRatio { least, second, unit: self.params.get().block_area() * scale }
        });
        PeakRatio::judge(ratio, index, self.params.get().num_disparities(), self.params.get().uniqueness_ratio())
    }

    /// The least fused cost of the existing candidates at these indices, and its index, the smallest if several tie.
    fn winner(&self, available: &[Range<u16>; V], is_searched: impl Fn(usize) -> bool) -> Option<(u32, usize)> {
        if available.iter().all(Range::is_empty) {
            return None;
        }
        let searched = (0..self.params.get().num_disparities()).filter(|&index| is_searched(index));
        searched.filter_map(|index| Some((self.cost(available, index)?, index))).min_by_key(|&(cost, _)| cost)
    }

    /// The disparity at `index`, refined if both neighbours exist.
    #[cold]
    pub fn refined(&self, index: usize) -> Option<Disparity> {
        let available = self.available();
        let cost = |index| self.cost(&available, index);
        let d = self.params.get().min_disparity() + index as i16;
        match (cost(index.wrapping_sub(1)), cost(index), cost(index + 1)) {
            // The mean of five views or more has a larger scale than the other rules.
            (Some(before), Some(at), Some(after)) if V > 4 && self.params.get().fusion() == Fusion::Mean => {
                let refine = if self.prior.is_some() { Disparity::refine_equiangular_wide } else { Disparity::refine_wide };
                refine(d, before.into(), at.into(), after.into())
            }
            (Some(before), Some(at), Some(after)) => {
                let refine = if self.prior.is_some() { Disparity::refine_equiangular } else { Disparity::refine };
                refine(d, before, at, after)
            }
            _ => Disparity::whole(d),
        }
    }

    /// The fused costs of all disparities as matching costs of [semi-global matching](crate::SemiGlobalParams):
    /// divided by `2^shift`, and 255 where a candidate does not exist and past the last disparity.
    pub fn quotients(&self, shift: u32, costs: &mut [u8]) {
        let available = self.available();
        let scale = self.params.get().fusion().scale(V) as u32;
        costs.fill(u8::MAX);
        for (index, quotient) in costs.iter_mut().enumerate().take(self.params.get().num_disparities()) {
            if let Some(cost) = self.cost(&available, index) {
                let cost = cost.checked_div(scale << shift).unwrap_or_default();
                *quotient = cost.min(SemiGlobalParams::MAX_COST.into()) as u8;
            }
        }
    }

    /// The indices of the disparities at which the pixel sees each view.
    fn available(&self) -> [Range<u16>; V] {
        let (params, views) = (self.params.get(), self.params.get().views());
        let mut available = [const { 0..0 }; V];
        for (k, available) in available.iter_mut().enumerate() {
            let Some(view) = views.get(k) else { break };
            let (pixel, size) = ((self.u, self.v), (params.width(), params.height()));
            let (least, count) = (params.min_disparity(), params.num_disparities());
            *available = match &self.prior {
                Some(prior) => prior.available(view, pixel, size, least, count),
                None => view.available(pixel, size, least, count),
            };
        }
        available
    }

    /// The fused cost of a candidate, if it exists.
    fn cost(&self, available: &[Range<u16>; V], index: usize) -> Option<u32> {
        let views = self.blocks.get(index / I::LANES)?;
        let mut costs = [u32::NONE; V];
        for ((cost, sums), _) in costs.iter_mut().zip(views).zip(available).filter(|(_, range)| range.contains(&(index as u16))) {
            let lanes: &[L] = bytemuck::try_cast_slice(slice::from_ref(sums)).ok()?;
            *cost = lanes.get(I::lane(index % I::LANES))?.widen();
        }
        Some(self.params.get().fusion().fuse(costs)).filter(|cost| cost.exists())
    }
}
