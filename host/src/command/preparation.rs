//! What comes between reading frames and matching them, and the warnings after it.

use clap::Args;
use multiscopic::{Alignment, DisparityMap, Frames, Geometry, Inspection, Result, lens::Undistortion};
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
    /// The range of disparities, unless other options override it: the smallest one and their number.
    pub fn range(&self, inspection: &Inspection) -> Result<(i16, u16)> {
        if self.auto_range { inspection.found_range() } else { Ok(SearchOptions::DEFAULT_RANGE) }
    }

    /// Rectifies the frames of `source` and their geometry, if that was asked for.
    pub fn align(
        &self,
        source: &Source,
        undistortion: Option<&Undistortion>,
        frames: &mut Frames,
        geometry: &mut Option<Geometry>,
        search: &Search,
    ) -> Result<Option<Alignment>> {
        if !self.align {
            return Ok(None);
        }
        let alignment = Alignment::estimate(frames, search, geometry.as_ref())?;
        *frames = source.rectified_frames(undistortion, &alignment)?;
        if let Some(geometry) = geometry {
            geometry.principal_point = alignment.principal_point(geometry.principal_point);
        }
        Ok(Some(alignment))
    }
}

/// What the images and the disparities found in them give reason to doubt.
pub fn warnings(
    inspection: &Inspection,
    alignment: Option<&Alignment>,
    disparities: &DisparityMap,
    search: &Search,
) -> Vec<String> {
    // Swapped views explain disparities at the end of the range.
    let is_swapped = inspection.refuse_swapped(search.min_disparity()).is_err();
    let cut = if is_swapped { None } else { cut_range(disparities, search, inspection.flat) };
    inspection.warnings(search.min_disparity()).into_iter().chain(alignment.and_then(Alignment::warning)).chain(cut).collect()
}

/// Tells whether disparities pile up at an end of the range, so that it seems to be too narrow. Where nothing has texture, as on the
/// share `flat` of the centre, any of them may win.
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
