//! All options that decide which disparities frames get.

use clap::Args;
use multiscopic::{Method, Result, stereo::MethodName};
use multiscopic_core::{Fusion, Search, Views};

use super::MethodOptions;
use crate::command::options::{BaselineOptions, SearchOptions, named};

/// A method, what it searches, and its options.
#[derive(Clone, Debug, Args)]
pub struct MatchingOptions {
    /// Method
    #[arg(long, value_parser = named::<MethodName>(), default_value = "bm", help_heading = "Matching")]
    pub method: MethodName,

    /// Fusion rule for the views' costs [default: min with one or two neighbours, heuristic with three or four, half with more]
    #[arg(long, value_parser = named::<Fusion>(), help_heading = "Matching")]
    fusion: Option<Fusion>,

    #[command(flatten)]
    pub search: SearchOptions,

    #[command(flatten)]
    options: MethodOptions,

    #[command(flatten)]
    baselines: BaselineOptions,
}

impl MatchingOptions {
    /// The search in frames of a size. `default_range` is the smallest disparity and the number of disparities, unless options
    /// override them.
    pub fn search(&self, size: [usize; 2], views: Views, default_range: (i16, u16)) -> Result<Search> {
        let fusion = self.fusion.unwrap_or(Fusion::default_for(self.baselines.first(views).len()));
        self.search.search(size, views, Some(fusion), default_range)
    }

    /// The method for a match with `views`.
    pub fn method(&self, views: Views) -> Result<Method> {
        self.options.check_block_size(&[self.method], self.search.block_size)?;
        let method = self.options.method(self.method, self.search.block_size, self.baselines.first(views).len())?;
        Ok(Method { long_baselines: self.baselines.long_baselines()?, ..method })
    }
}
