//! The options of rigs with several baselines.

use clap::Args;
use multiscopic::{
    Result,
    stereo::{LongBaselines, refinement::Median},
};
use multiscopic_core::Views;

/// How views at longer baselines are matched.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Several baselines")]
pub struct BaselineOptions {
    /// Number of disparities searched around the prior, in pixels of the longer baseline
    #[arg(long, value_name = "N", default_value_t = LongBaselines::DEFAULT.num_disparities)]
    prior_disparities: u16,

    /// Size of the median filter of the prior, odd, from 3 to 31, or 0 for none
    #[arg(long, value_name = "N", default_value_t = LongBaselines::DEFAULT.median.map_or(0, Median::size))]
    prior_median: u8,

    /// Match all views together over the whole range, whatever their baselines
    #[arg(long)]
    together: bool,
}

impl BaselineOptions {
    /// Those of `views` that are matched first: at the shortest baseline, unless all are matched together.
    pub fn first(&self, views: Views) -> Views {
        if self.together { views } else { LongBaselines::shortest(views) }
    }

    /// How views at longer baselines refine what those at the shortest found, or `None` to match all together.
    pub fn long_baselines(&self) -> Result<Option<LongBaselines>> {
        let median = if self.prior_median == 0 { None } else { Some(Median::new(self.prior_median)?) };
        let long = LongBaselines { num_disparities: self.prior_disparities, median, ..LongBaselines::DEFAULT };
        Ok((!self.together).then_some(long))
    }
}
