//! What comes between reading frames and matching them.

use clap::Args;
use multiscopic::{
    DisparityMap, Frames, Geometry, Preparation, Result,
    lens::Undistortion,
    stereo::confidence_map::{self, ConfidenceMap},
};
use multiscopic_core::Search;

use super::options::{MemoryOptions, Source};

/// How frames are prepared for matching.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Matching")]
pub struct PreparationOptions {
    /// Rectify the views before matching, as `multiscopic align` does: how they are turned, scaled and shifted, and their
    /// brightness
    #[arg(long)]
    align: bool,

    /// Find the range of disparities from the images
    #[arg(long, conflicts_with_all = ["min_disparity", "num_disparities"])]
    auto_range: bool,
}

impl PreparationOptions {
    /// Prepares the frames of `source` and their geometry. `search` makes a search of a range of disparities: the smallest one
    /// and their number. Alignments that take more `memory` than may be taken are refused.
    pub fn prepare(
        &self,
        source: &Source,
        undistortion: Option<&Undistortion>,
        frames: &mut Frames,
        geometry: &mut Option<Geometry>,
        memory: &MemoryOptions,
        search: impl Fn((i16, u16)) -> Result<Search>,
    ) -> Result<Preparation> {
        if !self.align {
            return Preparation::new(frames, self.auto_range, search);
        }
        memory.check_alignment(frames)?;
        let rectified = |alignment: &_| source.rectified_frames(undistortion, alignment);
        Preparation::rectifying(frames, geometry, self.auto_range, search, rectified)
    }
}

/// Invalidates the pixels that the undistorted centre does not show.
pub fn mask_unseen(undistortion: Option<&Undistortion>, disparities: &mut DisparityMap, confidences: Option<&mut ConfidenceMap>) {
    let Some(undistortion) = undistortion else { return };
    undistortion.mask(disparities);
    if let Some(confidences) = confidences {
        confidence_map::keep_sure(disparities, confidences, 0);
    }
}
