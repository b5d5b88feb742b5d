//! The search range and the block.

use clap::Args;
use multiscopic::{Error, Method, Result};
use multiscopic_core::{Fusion, Params, Search, SearchConfig, Views};

/// The views that `--views` stands for.
pub fn views_of_count(count: usize) -> Result<Views> {
    match count {
        1 => Ok(Views::STEREO),
        2 => Ok(Views::HORIZONTAL),
        3 => Ok(Views::THREE),
        4 => Ok(Views::CROSS),
        8 => Ok(Views::ARRAY),
        other => Err(Error::Usage(format!("--views is {other}, it must be from 1 to 4, or 8"))),
    }
}

/// The search range and the block size.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Matching")]
pub struct SearchOptions {
    /// Smallest disparity in pixels, may be negative (OpenCV: minDisparity, ROS: min_disparity) [default: 1, or the data set's]
    #[arg(long, visible_alias = "min_disp", value_name = "N", allow_negative_numbers = true)]
    pub min_disparity: Option<i16>,

    /// Number of disparities searched, not only multiples of 16 (OpenCV: numDisparities, ROS: disparity_range)
    /// [default: 60, or the data set's; bench: 64; demo: proportional to the width]
    #[arg(long, visible_alias = "disparity_range", value_name = "N", allow_negative_numbers = true)]
    pub num_disparities: Option<u16>,

    /// Side of the block in pixels, odd, from 1 to 21 (OpenCV: blockSize, ROS: correlation_window_size) [default: 11; 5 for
    /// --cost sad]
    #[arg(long, visible_alias = "correlation_window_size", value_name = "N", allow_negative_numbers = true)]
    pub block_size: Option<u8>,
}

impl SearchOptions {
    /// The paper's search range: the smallest disparity and the number of disparities.
    pub const DEFAULT_RANGE: (i16, u16) = Method::DEFAULT_RANGE;
    /// The paper's block size.
    pub const DEFAULT_BLOCK_SIZE: u8 = Method::DEFAULT_BLOCK_SIZE;

    /// The search in frames of `width` x `height` with `views`. `default_range` is the smallest disparity and the
    /// number of disparities that apply unless options override them.
    pub fn search(
        &self,
        [width, height]: [usize; 2],
        views: Views,
        fusion: Option<Fusion>,
        default_range: (i16, u16),
    ) -> Result<Search> {
        let side = |length: usize| {
            u16::try_from(length).map_err(|_| Error::Usage(format!("a frame has a side of {length} pixels, the limit is 65535")))
        };
        Ok(SearchConfig {
            width: side(width)?,
            height: side(height)?,
            views,
            fusion: fusion.unwrap_or(Fusion::default_for(views.len())),
            min_disparity: self.min_disparity.unwrap_or(default_range.0),
            num_disparities: self.num_disparities.unwrap_or(default_range.1),
        }
        .checked()?)
    }

    /// The parameters of block matching for a search.
    pub fn params(&self, search: Search) -> Result<Params> {
        Ok(Params::block_matching(search, self.block_size.unwrap_or(Self::DEFAULT_BLOCK_SIZE))?)
    }
}
