//! The method and its options.

mod graph_cuts_options;
mod matching_options;
mod mc_cnn_options;
mod method_name;
mod refinement_options;
mod semi_global_options;

use clap::Args;
use multiscopic::{
    Dataset, Error, Method, Result,
    stereo::{MethodName, Pipeline},
};

pub use self::matching_options::MatchingOptions;
use self::{
    graph_cuts_options::GraphCutsOptions, mc_cnn_options::McCnnOptions, refinement_options::RefinementOptions,
    semi_global_options::SemiGlobalOptions,
};
use super::{named::Named, search_options::SearchOptions};

/// The options of all methods but block matching.
#[derive(Clone, Debug, Args)]
pub struct MethodOptions {
    #[command(flatten)]
    graph_cuts: GraphCutsOptions,

    #[command(flatten)]
    semi_global: SemiGlobalOptions,

    #[command(flatten)]
    mc_cnn: McCnnOptions,

    #[command(flatten)]
    refinement: RefinementOptions,
}

impl MethodOptions {
    /// These options, with the data set's defaults.
    pub fn for_dataset(mut self, dataset: Dataset) -> MethodOptions {
        self.graph_cuts.occlusion_cost.get_or_insert(dataset.occlusion_cost());
        self
    }

    /// An error if a block size was asked for that none of the methods has a use for.
    pub fn check_block_size(&self, names: &[MethodName], block_size: Option<u8>) -> Result<()> {
        if block_size.is_none() || self.refinement.has_blocks() || names.iter().any(|&name| self.has_blocks(name)) {
            return Ok(());
        }
        let names = names.iter().map(Named::name).collect::<Vec<_>>().join(", ");
        let with_blocks = "bm, gc, sgm with --cost sad, and --texture-threshold";
        Err(Error::Usage(format!("--block-size has no effect on {names} as it is here: it is for {with_blocks}")))
    }

    fn has_blocks(&self, name: MethodName) -> bool {
        match name {
            MethodName::Bm | MethodName::Gc => true,
            MethodName::Sgm => self.semi_global.has_blocks(),
            MethodName::MccnnFast | MethodName::MccnnAccurate | MethodName::Net => false,
        }
    }

    /// The method with these options, for a match in a number of `views`. `block_size` is that of block matching, with which
    /// graph cuts start, and of sums of absolute differences, if one was asked for.
    pub fn method(&self, name: MethodName, block_size: Option<u8>, views: usize) -> Result<Method> {
        let MethodOptions { graph_cuts, semi_global, mc_cnn, refinement } = self;
        let method = name.method(block_size, views)?;
        let block_size_or_default = block_size.unwrap_or(SearchOptions::DEFAULT_BLOCK_SIZE);
        let method = match method.pipeline {
            Pipeline::GraphCuts { .. } => {
                let cuts = graph_cuts.graph_cuts(block_size_or_default);
                Method::new(Pipeline::GraphCuts { cost: graph_cuts.cost(), cuts })
            }
            Pipeline::SemiGlobal { .. } => semi_global.with_block_size(block_size).method(views)?,
            Pipeline::McCnn { network, .. } => {
                let architecture = network.architecture();
                let (aggregation, penalties) = (mc_cnn.aggregation(architecture), mc_cnn.penalties(architecture));
                Method::new(Pipeline::McCnn { network, aggregation, penalties })
            }
            Pipeline::BlockMatching { .. } | Pipeline::Network(_) => method,
        };
        let refinement = refinement.refinement(&method, block_size_or_default)?;
        Ok(method.with_refinement(refinement))
    }
}
