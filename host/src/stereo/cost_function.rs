//! The matching costs of semi-global matching: how each is computed, and what it is called.

use multiscopic_core::{Census, ConfidenceTable, PathPenalties, SearchSpace, SemiGlobalCost};

use super::{
    Engine, confidence_map,
    cost::{CensusPairRows, CensusRows, CostRows, SadRows},
};
use crate::{error::Result, images::Frames};

/// A matching cost of semi-global matching, in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CostFunction {
    /// The sum of absolute differences over a block.
    Sad {
        /// The side of the block in pixels: see [`SemiGlobalCost`].
        block_size: u8,
    },
    /// The Hamming distance of census transforms (Zabih and Woodfill 1994).
    Census(Census),
    /// The mean of that distance and the one of blurred images, in which the pixels of the window are three pixels apart.
    TwoScaleCensus(Census),
}

impl CostFunction {
    /// The fused costs of `frames`, prepared on the threads of `engine`.
    ///
    /// # Errors
    /// If the block size is out of its range.
    ///
    /// # Panics
    /// If a view of `search` is missing.
    pub fn rows<'a>(
        self,
        frames: &Frames,
        search: &'a SearchSpace,
        engine: &Engine,
    ) -> Result<Box<dyn CostRows<Cost = u8> + 'a>> {
        let planes = &frames.planes();
        Ok(match self {
            CostFunction::Sad { block_size } => Box::new(SadRows::new(engine, planes, search, block_size)?),
            CostFunction::Census(census) => Box::new(CensusRows::new(planes, search, census, engine)),
            CostFunction::TwoScaleCensus(census) => Box::new(CensusPairRows::two_scales(planes, search, census, engine)),
        })
    }

    /// The penalties for matches in a number of `views`, unless others are given.
    pub(super) fn default_penalties(self, views: usize) -> PathPenalties {
        match self {
            CostFunction::Sad { block_size } => SemiGlobalCost::Sad { block_size },
            CostFunction::Census(census) | CostFunction::TwoScaleCensus(census) => SemiGlobalCost::Census(census),
        }
        .default_penalties(views)
    }

    /// The probabilities that disparities are right, by the peak ratios of the sums of this cost along paths.
    pub(super) fn confidence_table(self) -> &'static ConfidenceTable {
        match self {
            CostFunction::Sad { .. } => &ConfidenceTable::SEMI_GLOBAL,
            CostFunction::Census(_) | CostFunction::TwoScaleCensus(_) => &confidence_map::CENSUS,
        }
    }
}

/// The name of a matching cost, whose parameters are named by themselves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CostName {
    /// The census transform.
    Census,
    /// The census transform at two scales.
    Census2,
    /// Sums of absolute differences.
    Sad,
}

impl CostName {
    /// All costs.
    pub const ALL: [CostName; 3] = [CostName::Census, CostName::Census2, CostName::Sad];

    /// The name on command lines.
    pub const fn name(self) -> &'static str {
        match self {
            CostName::Census => "census",
            CostName::Census2 => "census2",
            CostName::Sad => "sad",
        }
    }

    /// A line about it.
    pub const fn about(self) -> &'static str {
        match self {
            CostName::Census => "Bits in which the census transforms differ",
            CostName::Census2 => "The mean of two: of the images, and of blurred ones with a window of three times the size",
            CostName::Sad => "The sum of absolute differences over a block, by default of 5 x 5 pixels",
        }
    }

    /// The cost, in a census window or in blocks of a size, 5 if it is `None`.
    ///
    /// # Errors
    /// If the block size is out of its range.
    pub fn function(self, census: Census, block_size: Option<u8>) -> Result<CostFunction> {
        Ok(match self {
            CostName::Census => CostFunction::Census(census),
            CostName::Census2 => CostFunction::TwoScaleCensus(census),
            CostName::Sad => {
                let block_size = block_size.unwrap_or(SemiGlobalCost::DEFAULT_BLOCK_SIZE);
                SemiGlobalCost::Sad { block_size }.checked()?;
                CostFunction::Sad { block_size }
            }
        })
    }
}
