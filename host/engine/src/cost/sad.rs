//! Matching costs by sums of absolute differences, for rows in any order.

use multiscopic_core::{BlockMatchingParams, Matcher, Memory, Region, SearchSpace, SemiGlobalCost, kernel::Kernel};
use rayon::prelude::*;

use super::{CostRows, Volume};
use crate::{engine::Engine, error::EngineError, planes::Planes, simd::Task};

/// The fused costs of a centre and its views: sums over blocks as [`SemiGlobalCost::Sad`] scales them. A byte
/// for each pixel and disparity is kept.
#[derive(Debug)]
pub struct SadRows<'a> {
    search: &'a SearchSpace,
    costs: Volume<u8>,
}

impl<'a> SadRows<'a> {
    /// Computes all costs, on the threads of `engine`.
    ///
    /// # Errors
    /// [`EngineError::BlockMatchingParams`] if the block is not one for [`SemiGlobalCost::Sad`].
    pub fn new(
        engine: &Engine,
        frames: &Planes<'_>,
        search: &'a SearchSpace,
        block_size: u8,
    ) -> Result<SadRows<'a>, EngineError> {
        let cost = SemiGlobalCost::Sad { block_size }.checked()?;
        let params = BlockMatchingParams::block_matching(*search, block_size)?;
        let simd = engine.simd(search);
        let depth = search.num_disparities().next_multiple_of(simd.lanes());
        let mut costs = Volume::filled(search.width(), search.height(), depth, u8::MAX);
        let height = search.height().div_ceil(engine.threads());
        let bands: Vec<Region> = Region::bands(search, height).collect();
        let band_len = height * costs.row_len();
        engine.pool().install(|| {
            costs.costs_mut().par_chunks_mut(band_len).zip(bands).for_each(|(costs, region)| {
                simd.run(Band { frames, params: &params, region: &region, shift: cost.shift(), costs, depth });
            });
        });
        Ok(SadRows { search, costs })
    }
}

impl CostRows for SadRows<'_> {
    type Cost = u8;

    fn search(&self) -> &SearchSpace {
        self.search
    }

    fn row(&self, v: usize, stride: usize, row: &mut [u8]) {
        let kept = self.costs.num_disparities();
        for (to, from) in row.chunks_exact_mut(stride).zip(self.costs.row(v).chunks_exact(kept)) {
            to[..kept.min(stride)].copy_from_slice(&from[..kept.min(stride)]);
        }
    }
}

/// Computes the costs of a band of rows.
struct Band<'a> {
    frames: &'a Planes<'a>,
    params: &'a BlockMatchingParams,
    region: &'a Region,
    shift: u32,
    costs: &'a mut [u8],
    depth: usize,
}

impl Task for Band<'_> {
    type Output = ();

    fn run<I: Kernel>(self, isa: I) {
        let Band { mut frames, params, region, shift, costs, depth } = self;
        let mut memory = vec![0; Memory::new::<I>(params, region.width()).words()];
        let mut matcher = Matcher::with_isa(isa, params, region, &mut memory).expect("the memory has the matcher's own size");
        for costs in costs.chunks_exact_mut(region.width() * depth) {
            matcher.next_costs(&mut frames, shift, costs, depth).expect("lines in memory do not fail");
        }
    }
}
