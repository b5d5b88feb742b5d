//! The options of the search: the range of disparities, the block, views at several baselines, and images after their
//! preparation.

use clap::Args;
use multiscopic::{
    Error, Method, RangeSource, Result,
    images::BitDepth,
    stereo::{BaselineRefinement, refinement::Median},
};
use multiscopic_core::{BlockMatchingParams, Fusion, SearchConfig, SearchSpace, Views};

use crate::{
    page_entry::{Entry, Unset, method},
    value::{Named, named},
};

/// Returns the views that `--views` stands for.
///
/// # Errors
/// If there is no such set.
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
    /// Smallest disparity in pixels, may be negative (OpenCV: minDisparity, ROS: min_disparity) [default: what the images show;
    /// 1 if --num-disparities is given; the data set's]
    #[arg(long, visible_alias = "min_disp", value_name = "N", allow_negative_numbers = true)]
    pub min_disparity: Option<i16>,

    /// Number of disparities searched, not only multiples of 16 (OpenCV: numDisparities, ROS: disparity_range)
    /// [default: what the images show; 60 if --min-disparity is given; the data set's; bench: 64; demo: proportional to the width]
    #[arg(long, visible_alias = "disparity_range", value_name = "N", allow_negative_numbers = true)]
    pub num_disparities: Option<u16>,

    /// Side of the block in pixels, odd, from 1 to 21 (OpenCV: blockSize, ROS: correlation_window_size) [default: 11; 5 for
    /// --cost sad]
    #[arg(long, visible_alias = "correlation_window_size", value_name = "N", allow_negative_numbers = true)]
    pub block_size: Option<u8>,
}

impl SearchOptions {
    /// The controls of the page.
    pub(crate) const ON_PAGE: [Entry; 3] = [
        Entry::slider("min-disparity", "Smallest disparity", [-128.0, 255.0, 1.0], 1.0, Unset::Never),
        Entry::slider("num-disparities", "Number of disparities", [2.0, 256.0, 1.0], 60.0, Unset::Never),
        Entry::slider("block-size", "Block size", [1.0, 21.0, 2.0], 11.0, Unset::Default).if_(|settings| {
            match method(settings) {
                "bm" => true,
                "sgm" if settings.get("cost").is_some_and(|cost| cost == "sad") => true,
                _ => settings.contains_key("texture-threshold"),
            }
        }),
    ];

    /// The paper's search range: the smallest disparity and the number of disparities.
    pub const DEFAULT_RANGE: (i16, u16) = Method::DEFAULT_RANGE;
    /// The paper's block size.
    pub const DEFAULT_BLOCK_SIZE: u8 = Method::DEFAULT_BLOCK_SIZE;

    /// Returns the source of the range, for commands that take it from the images by default.
    pub fn range_source(&self, preparation: &PreparationOptions) -> RangeSource {
        let is_given = self.min_disparity.is_some() || self.num_disparities.is_some();
        match preparation.auto_range {
            true => RangeSource::ImagesAlone,
            false if is_given || preparation.no_inspection => RangeSource::Paper,
            false => RangeSource::Images,
        }
    }

    /// Returns the search in frames of `width` x `height` with `views`. `default_range` is the smallest disparity and the
    /// number of disparities that apply unless options override them.
    ///
    /// # Errors
    /// If a parameter is out of its range.
    pub fn search(
        &self,
        [width, height]: [usize; 2],
        views: Views,
        fusion: Option<Fusion>,
        default_range: (i16, u16),
    ) -> Result<SearchSpace> {
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

    /// Returns the parameters of block matching for a search.
    ///
    /// # Errors
    /// If the block size is out of its range.
    pub fn params(&self, search: SearchSpace) -> Result<BlockMatchingParams> {
        Ok(BlockMatchingParams::block_matching(search, self.block_size.unwrap_or(Self::DEFAULT_BLOCK_SIZE))?)
    }
}

/// The treatment of views at longer baselines.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Several baselines")]
pub struct BaselineOptions {
    /// Number of disparities searched around the prior, in pixels of the longer baseline; `net` searches each baseline over its
    /// range instead
    #[arg(long, value_name = "N", default_value_t = BaselineRefinement::DEFAULT.num_disparities)]
    prior_disparities: u16,

    /// Size of the median filter of the prior, odd, from 3 to 31, or 0 for none
    #[arg(long, value_name = "N", default_value_t = BaselineRefinement::DEFAULT.median.map_or(0, Median::size))]
    prior_median: u8,

    /// Match all views together over the whole range, whatever their baselines
    #[arg(long)]
    together: bool,
}

impl BaselineOptions {
    /// Returns those of `views` that are matched first: at the shortest baseline, unless all are matched together.
    pub fn first(&self, views: Views) -> Views {
        if self.together { views } else { BaselineRefinement::shortest(views) }
    }

    /// Returns how views at longer baselines refine what those at the shortest found, or `None` to match all together.
    ///
    /// # Errors
    /// If the size of the median filter is out of its range.
    pub fn long_baselines(&self) -> Result<Option<BaselineRefinement>> {
        let median = if self.prior_median == 0 { None } else { Some(Median::new(self.prior_median)?) };
        let long = BaselineRefinement { num_disparities: self.prior_disparities, median, ..BaselineRefinement::DEFAULT };
        Ok((!self.together).then_some(long))
    }
}

/// The preparation of frames for matching.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Matching")]
pub struct PreparationOptions {
    /// Rectify the views before matching, as `multiscopic align` does: how they are turned, scaled and shifted, and their
    /// brightness
    #[arg(long)]
    pub align: bool,

    /// Find the range of disparities from the images, and refuse those that do not show it
    #[arg(long, conflicts_with_all = ["min_disparity", "num_disparities", "no_inspection"])]
    pub auto_range: bool,

    /// Match without looking at the images first: no warnings of them, no change of their brightness, and a range from 1 to 60
    /// unless it is given
    #[arg(long, conflicts_with = "align")]
    pub no_inspection: bool,
}

/// The number of bits of 16-bit images that carry values.
#[derive(Clone, Debug, Default, Args)]
pub struct BitsOption {
    /// Bits of the values in 16-bit images; 8-bit images, and PGM and PPM that name another maximum, do not need it [default: the
    /// least that have the brightest sample of all images]
    #[arg(long, value_name = "N", value_parser = named::<BitDepth>())]
    pub bits: Option<BitDepth>,
}

impl Named for BitDepth {
    const ALL: &'static [BitDepth] = &BitDepth::ALL;

    fn name(&self) -> &'static str {
        match self {
            BitDepth::Ten => "10",
            BitDepth::Twelve => "12",
            BitDepth::Fourteen => "14",
            BitDepth::Sixteen => "16",
        }
    }

    fn about(&self) -> &'static str {
        match self {
            BitDepth::Ten => "White is 1023",
            BitDepth::Twelve => "White is 4095",
            BitDepth::Fourteen => "White is 16383",
            BitDepth::Sixteen => "White is 65535",
        }
    }
}
