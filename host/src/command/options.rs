//! Options that several commands take.

use clap::{Args, ValueEnum};
use multiscopic::{Engine, Error, Frames, Result, Simd};
use multiscopic_core::{Fusion, Params, Views};

/// How costs are fused, by the name of the rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FusionName {
    /// The least cost of the views: sharp at occlusions
    Min,
    /// The mean cost of the views: quiet
    Mean,
    /// The mean of the two or three least costs (the paper's rule for four views)
    Heuristic,
}

impl From<FusionName> for Fusion {
    fn from(name: FusionName) -> Fusion {
        match name {
            FusionName::Min => Fusion::Min,
            FusionName::Mean => Fusion::Mean,
            FusionName::Heuristic => Fusion::Heuristic,
        }
    }
}

/// What is searched for, and how.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Matching")]
pub struct SearchOptions {
    /// Fusion of the views' costs [default: min with one or two neighbours, heuristic with more]
    #[arg(long, value_enum)]
    pub fusion: Option<FusionName>,

    /// Smallest disparity in pixels, may be negative (OpenCV: minDisparity; ROS: min_disparity)
    #[arg(long, visible_alias = "min_disp", value_name = "N", allow_negative_numbers = true)]
    pub min_disparity: Option<i16>,

    /// Number of disparities searched (OpenCV: numDisparities, ROS: disparity_range; any number, not only multiples of 16)
    #[arg(long, visible_alias = "disparity_range", value_name = "N")]
    pub num_disparities: Option<u16>,

    /// Side of the block in pixels, odd, 1 to 21 (OpenCV: blockSize, ROS: correlation_window_size) [default: 11]
    #[arg(long, visible_alias = "correlation_window_size", value_name = "N")]
    pub block_size: Option<u8>,
}

impl SearchOptions {
    /// The paper's block size.
    const BLOCK_SIZE: u8 = 11;

    /// The parameters for matching `frames` in `views`; where no range is given, `range` is searched: a minimum and a number.
    pub fn params(&self, frames: &Frames, views: Views, range: (i16, u16)) -> Result<Params> {
        let side = |length: usize| {
            u16::try_from(length).map_err(|_| Error::Usage(format!("a frame has a side of {length} pixels, 65535 is the most")))
        };
        Ok(Params::new(
            side(frames.width())?,
            side(frames.height())?,
            views,
            self.fusion.map_or(Fusion::default_for(views.len()), Fusion::from),
            self.min_disparity.unwrap_or(range.0),
            self.num_disparities.unwrap_or(range.1),
            self.block_size.unwrap_or(Self::BLOCK_SIZE),
        )?)
    }
}

/// What the machine gives.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Machine")]
pub struct EngineOptions {
    /// Threads, 0 for one per core
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub threads: usize,

    /// Vector instructions, by default the widest that the processor has; the result is the same
    #[arg(long, value_name = "NAME")]
    pub simd: Option<String>,
}

impl EngineOptions {
    /// The engine asked for.
    pub fn engine(&self) -> Result<Engine> {
        let simd = match &self.simd {
            None => Simd::widest(),
            Some(name) => Simd::named(name).ok_or_else(|| {
                let available: Vec<String> = Simd::available().iter().map(Simd::to_string).collect();
                Error::Usage(format!("--simd is {name}, this processor has {}", available.join(", ")))
            })?,
        };
        Engine::new(simd, self.threads)
    }
}
