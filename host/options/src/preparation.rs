//! The preparation of images for matching.

use clap::Args;
use multiscopic::images::BitDepth;

use crate::named::{Named, named};

/// The preparation of frames for matching.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Matching")]
pub struct PreparationOptions {
    /// Rectify the views before matching, as `multiscopic align` does: how they are turned, scaled and shifted, and their
    /// brightness
    #[arg(long)]
    pub align: bool,

    /// Find the range of disparities from the images
    #[arg(long, conflicts_with_all = ["min_disparity", "num_disparities"])]
    pub auto_range: bool,
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
