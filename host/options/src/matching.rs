//! All options that decide which disparities frames get, and the method that they describe.

use std::ffi::OsString;

use clap::{Args, Parser};
use multiscopic::{
    Dataset, Error, Method, Result,
    stereo::{MethodName, Pipeline},
};
use multiscopic_core::{Fusion, SearchSpace, Views};

use crate::{
    methods::{GraphCutsOptions, McCnnOptions, SemiGlobalOptions},
    page_entry::Entry,
    refinement::RefinementOptions,
    search::{BaselineOptions, SearchOptions},
    value::{Named, named},
};

/// The options that have no effect on matches around a prior, which therefore refuse them.
pub const PRIOR_EXCLUDES: [&str; 14] = [
    "method",
    "together",
    "search_margin",
    "disp12_max_diff",
    "uniqueness_ratio",
    "texture_threshold",
    "speckle_window_size",
    "median",
    "bilateral",
    "repair",
    "hidden",
    "min_confidence",
    "smooth",
    "fill",
];

/// A method, what it searches, and its options.
#[derive(Clone, Debug, Args)]
pub struct MatchingOptions {
    /// Method
    #[arg(long, value_parser = named::<MethodName>(), default_value = "net", help_heading = "Matching")]
    pub method: MethodName,

    /// Fusion rule for the views' costs [default: min with one or two neighbours, heuristic with three or four, half with more;
    /// for net, and for sgm with a census, of several neighbours trimmed]
    #[arg(long, value_parser = named::<Fusion>(), help_heading = "Matching")]
    fusion: Option<Fusion>,

    /// The search range and the block size.
    #[command(flatten)]
    pub search: SearchOptions,

    #[command(flatten)]
    options: MethodOptions,

    #[command(flatten)]
    baselines: BaselineOptions,
}

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

/// A command line of nothing but matching options.
#[derive(Clone, Debug, Parser)]
#[command(no_binary_name = true, disable_help_flag = true)]
pub(crate) struct MatchingCommand {
    #[command(flatten)]
    matching: MatchingOptions,
}

impl MatchingOptions {
    /// The controls of the page.
    pub(crate) const ON_PAGE: [Entry; 2] = [Entry::list("method", "Method"), Entry::list("fusion", "Fusion")];

    /// Reads the words of a command line, such as `["--method", "sgm"]`.
    ///
    /// # Errors
    /// If there is no such option, it does not take the value, or options do not go together.
    pub fn parse(words: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<MatchingOptions> {
        MatchingCommand::try_parse_from(words).map(|command| command.matching).map_err(|error| {
            let text = error.render().to_string();
            let first = text.lines().next().unwrap_or_default();
            Error::Usage(first.trim_start_matches("error: ").to_owned())
        })
    }

    /// Returns the search in frames of a width and a height. `default_range` is the smallest disparity and the number of
    /// disparities, unless options override them.
    ///
    /// # Errors
    /// If a parameter is out of its range.
    pub fn search(&self, size: [usize; 2], views: Views, default_range: (i16, u16)) -> Result<SearchSpace> {
        let default = || self.options.default_fusion(self.method, views, &self.baselines);
        let fusion = self.fusion.unwrap_or_else(default);
        self.search.search(size, views, Some(fusion), default_range)
    }

    /// Returns the method for a match with `views`.
    ///
    /// # Errors
    /// If a parameter is out of its range or has no effect, or the weights of MC-CNN are not installed.
    pub fn method(&self, views: Views) -> Result<Method> {
        self.options.check_block_size(&[self.method], self.search.block_size)?;
        self.options.method_at_baselines(self.method, self.search.block_size, views, &self.baselines)
    }

    /// Returns the least confidence of a disparity that is kept, if one was asked for.
    pub fn min_confidence(&self) -> Option<u8> {
        self.options.refinement.min_confidence()
    }

    /// Returns the method for a match with `views` around known disparities, which no method has to find: that with no steps
    /// after it but those asked for.
    ///
    /// # Errors
    /// Those of [`method`](MatchingOptions::method).
    pub fn method_around_prior(&self, views: Views) -> Result<Method> {
        self.options.method_at_baselines(MethodName::Bm, self.search.block_size, views, &self.baselines)
    }
}

impl MethodOptions {
    /// Returns these options, with the data set's defaults.
    pub fn for_dataset(mut self, dataset: Dataset) -> MethodOptions {
        self.graph_cuts.occlusion_cost.get_or_insert(dataset.occlusion_cost());
        self
    }

    /// Refuses a block size that none of the methods has a use for.
    ///
    /// # Errors
    /// If one was asked for.
    pub fn check_block_size(&self, names: &[MethodName], block_size: Option<u8>) -> Result<()> {
        if block_size.is_none() || self.refinement.has_blocks() || names.iter().any(|&name| self.has_blocks(name)) {
            return Ok(());
        }
        let names = names.iter().map(Named::name).collect::<Vec<_>>().join(", ");
        let with_blocks = "bm, sgm with --cost sad, and --texture-threshold";
        Err(Error::Usage(format!("--block-size has no effect on {names} as it is here: it is for {with_blocks}")))
    }

    fn has_blocks(&self, name: MethodName) -> bool {
        match name {
            MethodName::Bm => true,
            MethodName::Sgm => self.semi_global.has_blocks(),
            MethodName::Gc | MethodName::MccnnFast | MethodName::MccnnAccurate | MethodName::Net => false,
        }
    }

    /// Returns the method with these options, for a match in a number of `views`. `block_size` is that of block matching,
    /// and of sums of absolute differences, if one was asked for.
    ///
    /// # Errors
    /// If a parameter is out of its range, or the weights of MC-CNN are not installed.
    pub fn method(&self, name: MethodName, block_size: Option<u8>, views: usize) -> Result<Method> {
        let MethodOptions { graph_cuts, semi_global, mc_cnn, refinement } = self;
        let method = name.method(block_size, views)?;
        let block_size_or_default = block_size.unwrap_or(SearchOptions::DEFAULT_BLOCK_SIZE);
        let pipeline = match method.pipeline {
            Pipeline::GraphCuts { .. } => {
                let cuts = graph_cuts.graph_cuts();
                Pipeline::GraphCuts { cost: graph_cuts.cost(), cuts }
            }
            Pipeline::SemiGlobal { .. } => semi_global.with_block_size(block_size).method(views)?.pipeline,
            Pipeline::McCnn { network, .. } => {
                let architecture = network.architecture();
                let (aggregation, penalties) = (mc_cnn.aggregation(architecture), mc_cnn.penalties(architecture));
                Pipeline::McCnn { network, aggregation, penalties }
            }
            pipeline @ (Pipeline::BlockMatching { .. } | Pipeline::Network(_)) => pipeline,
        };
        let method = Method { pipeline, ..method };
        let refinement = refinement.refinement(&method.refinement, method.smoother(), block_size_or_default)?;
        Ok(method.with_refinement(refinement))
    }

    /// Returns the fusion rule of a method for a match with `views`, unless another one was asked for.
    pub fn default_fusion(&self, name: MethodName, views: Views, baselines: &BaselineOptions) -> Fusion {
        let views = baselines.first(views).len();
        match name {
            MethodName::Sgm => self.semi_global.with_block_size(None).default_fusion(views),
            _ => name.default_fusion(views),
        }
    }

    /// Returns the same method for a match with `views`, of which those at longer baselines refine what the shortest found.
    ///
    /// # Errors
    /// Those of [`method`](MethodOptions::method), and if the prior's filter is out of its range.
    pub fn method_at_baselines(
        &self,
        name: MethodName,
        block_size: Option<u8>,
        views: Views,
        baselines: &BaselineOptions,
    ) -> Result<Method> {
        let method = self.method(name, block_size, baselines.first(views).len())?;
        Ok(Method { long_baselines: baselines.long_baselines()?, ..method })
    }
}

impl Named for MethodName {
    const ALL: &'static [MethodName] = &MethodName::ALL;

    fn name(&self) -> &'static str {
        MethodName::name(*self)
    }

    fn about(&self) -> &'static str {
        match self {
            MethodName::Bm => "Block matching: the least sum of absolute differences",
            MethodName::Gc => "Graph cuts: the least energy of matching costs and smoothness",
            MethodName::Sgm => "Semi-global matching: the least costs along paths, by the census or by blocks",
            MethodName::MccnnFast => {
                "The least costs along paths, with costs by the fast MC-CNN network; its weights: `multiscopic weights install`"
            }
            MethodName::MccnnAccurate => "The same with the accurate network, which takes a hundred times as long",
            MethodName::Net => {
                "A small network that is part of the program: decides between semi-global matching at two scales, and repairs both"
            }
        }
    }
}
