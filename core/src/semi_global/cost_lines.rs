//! The matching costs of a line, by either cost function.

use super::census_lines::CensusLines;
use crate::{
    MatchError, Matcher, MemoryTooSmall, Region, ScanlineSource, SemiGlobalCost, SemiGlobalParams,
    kernel::{Isa, Kernel},
    memory::Lender,
};

/// The state that matching costs are computed from.
#[allow(clippy::large_enum_variant, reason = "there is no heap to put the larger one on, and a match has one of these")]
#[derive(Debug)]
pub(super) enum CostLines<'m, I> {
    /// Sums of absolute differences.
    Sad(Matcher<'m, I>),
    /// Hamming distances.
    Census(CensusLines<'m, I>),
}

impl<'m, I: Isa> CostLines<'m, I> {
    /// No lines yet.
    // Inlined, so that the state is made where it stays: it is large for a microcontroller's stack.
    #[cfg_attr(target_arch = "arm", inline(always))]
    pub fn new(isa: I, params: &SemiGlobalParams, lender: &mut Lender<'m>) -> Result<CostLines<'m, I>, MemoryTooSmall> {
        let blocks = params.block_matching();
        Ok(match params.cost() {
            SemiGlobalCost::Sad { .. } => {
                CostLines::Sad(Matcher::in_lent_memory(isa, &blocks, &Region::whole(params.search()), lender)?)
            }
            SemiGlobalCost::Census(census) => CostLines::Census(CensusLines::new(isa, &blocks, census, lender)?),
        })
    }

    /// Computes the costs of line `v`, the next one, `depth` for each pixel.
    #[cfg_attr(target_arch = "arm", inline(always))]
    pub fn next<S: ScanlineSource>(
        &mut self,
        source: &mut S,
        params: &SemiGlobalParams,
        v: usize,
        costs: &mut [u8],
        depth: usize,
    ) -> Result<(), MatchError<S::Error>>
    where
        I: Kernel,
    {
        match self {
            CostLines::Sad(matcher) => matcher.next_costs(source, params.cost().shift(), costs, depth),
            CostLines::Census(census) => census.next_costs(source, v, costs, depth),
        }
    }

    /// The samples of the centre in line `v`, whose costs were computed last.
    #[cfg_attr(target_arch = "arm", inline(always))]
    pub fn center(&self, v: usize) -> &[u8] {
        match self {
            CostLines::Sad(matcher) => matcher.center(v),
            CostLines::Census(census) => census.center(v),
        }
    }
}
