//! What comes between reading frames and matching them, and the warnings after it.

use clap::Args;
use multiscopic::{
    Alignment, DisparityMap, Frames, Geometry, Inspection, Result,
    lens::Undistortion,
    stereo::confidence_map::{self, ConfidenceMap},
};
use multiscopic_core::Search;

use super::options::{SearchOptions, Source};

/// The least share of pixels at an end of the range that is a pile.
const MIN_PILE: f64 = 0.02;
/// How many times the mean share of a disparity a pile has.
const PILE: f64 = 3.0;

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
    /// and their number.
    pub fn prepare(
        &self,
        source: &Source,
        undistortion: Option<&Undistortion>,
        frames: &mut Frames,
        geometry: &mut Option<Geometry>,
        search: impl Fn((i16, u16)) -> Result<Search>,
    ) -> Result<Preparation> {
        let mut inspection = Inspection::of(frames);
        let mut range = self.range(&inspection)?;
        let mut alignment = None;
        if self.align {
            let found = Alignment::estimate(frames, &search(range)?, geometry.as_ref())?;
            *frames = source.rectified_frames(undistortion, &found)?;
            if let Some(geometry) = geometry {
                geometry.principal_point = found.principal_point(geometry.principal_point);
            }
            // Views that are turned show other disparities.
            inspection = found.inspect(&inspection, frames);
            range = self.range(&inspection)?;
            alignment = Some(found);
        }
        Ok(Preparation { search: search(range)?, inspection, alignment, range })
    }

    /// The range of disparities, unless other options override it.
    fn range(&self, inspection: &Inspection) -> Result<(i16, u16)> {
        if self.auto_range { inspection.found_range() } else { Ok(SearchOptions::DEFAULT_RANGE) }
    }
}

/// What is known of frames before they are matched.
#[derive(Clone, Debug)]
pub struct Preparation {
    /// What the prepared images tell.
    pub inspection: Inspection,
    /// What rectified them, if that was asked for.
    pub alignment: Option<Alignment>,
    /// The smallest disparity and the number of disparities, unless options override them.
    pub range: (i16, u16),
    /// The search in this range.
    pub search: Search,
}

impl Preparation {
    /// What the images and the disparities that a `search` found in them give reason to doubt.
    pub fn warnings(&self, disparities: &DisparityMap, search: &Search) -> Vec<String> {
        let Preparation { inspection, alignment, .. } = self;
        // Swapped views explain disparities at the end of the range.
        let is_swapped = inspection.refuse_swapped(search.min_disparity()).is_err();
        let cut = match is_swapped {
            true => None,
            // In a range of a few disparities none stands out, and in one that is far off all are mismatches.
            false => cut_range(disparities, search, inspection.flat)
                .or_else(|| inspection.beyond_line(search.min_disparity()..=search.max_disparity())),
        };
        let of_alignment = alignment.as_ref().and_then(Alignment::warning);
        inspection.warnings(search.min_disparity()).into_iter().chain(of_alignment).chain(cut).collect()
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

/// Tells whether disparities pile up at an end of the range, so that it seems to be too narrow. Where nothing has texture, as on
/// the share `flat` of the centre, any of them may win.
fn cut_range(disparities: &DisparityMap, search: &Search, flat: f64) -> Option<String> {
    let (first, last, count) = (search.min_disparity(), search.max_disparity(), search.num_disparities());
    let [at_first, at_last] = disparities.shares_at_ends(first..=last);
    let limit = f64::max(MIN_PILE, PILE / count as f64) + flat;
    // Points at infinity are no sign of a range that is cut.
    let (share, end, option) = if at_last > limit {
        (at_last, last, format!("--num-disparities above {count}"))
    } else if at_first > limit && first != 0 {
        (at_first, first, format!("--min-disparity below {first}"))
    } else {
        return None;
    };
    let percent = 100.0 * share;
    Some(format!("{percent:.0} % of the disparities are {end}, an end of the range: give {option}, or --auto-range"))
}
