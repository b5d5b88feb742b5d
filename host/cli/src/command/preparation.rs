//! Steps between reading frames and matching them.

use std::path::Path;

use multiscopic::{
    Alignment, DisparityMap, FloatImage, Frames, Geometry, Inspection, MatchSetup, RangeSource, Result,
    alignment::Tolerance,
    files::{self, DisparityEncoding, MatchedImages, StoredDisparities},
    lens::Undistortion,
    stereo::confidence_map::{self, ConfidenceMap},
};
use multiscopic_core::SearchSpace;

use super::{
    limits,
    options::{MemoryOptions, PreparationOptions, Source},
    terminal,
};

/// The megabytes from which on the user is told.
const MUCH: u64 = 1000;

/// Prepares the frames of `source` and their geometry. `search` makes a search of a range of disparities: the smallest one and
/// their number. Alignments that take more `memory` than may be taken are refused.
pub fn prepare(
    (options, range_source): (&PreparationOptions, RangeSource),
    source: &Source,
    undistortion: Option<&Undistortion>,
    frames: &mut Frames,
    geometry: &mut Option<Geometry>,
    memory: &MemoryOptions,
    search: impl Fn((i16, u16)) -> Result<SearchSpace>,
) -> Result<MatchSetup> {
    if options.no_inspection {
        return MatchSetup::of_inspection(Inspection::default(), range_source, search);
    }
    if !options.align {
        return MatchSetup::new(frames, range_source, search);
    }
    check_alignment(memory, frames)?;
    let rectified = |alignment: &_| source.rectified_frames(undistortion, alignment);
    let tolerance = source.rig.as_ref().and_then(Tolerance::of_rig);
    let setup = MatchSetup::rectifying(frames, geometry, tolerance, range_source, search, rectified)?;
    setup.alignment.iter().for_each(|alignment| terminal::say(&alignment.summary()));
    Ok(setup)
}

/// Checks that the alignment of `frames` may take what it takes.
///
/// # Errors
/// Those of [`Alignment::check_memory`].
pub fn check_alignment(memory: &MemoryOptions, frames: &Frames) -> Result<()> {
    say_if_much("aligning", Alignment::bytes(frames));
    Alignment::check_memory(frames, memory.most_bytes())
}

/// Tells how much memory is taken, if it is much.
pub fn say_if_much(what: &str, bytes: u64) {
    let megabytes = bytes.div_ceil(1_000_000);
    if megabytes >= MUCH {
        terminal::say(&format!("{what} takes about {megabytes} MB of memory"));
    }
}

/// Reads the disparities of `images`, or of unknown ones. Tells if they are encoded as other programs do, or may be wrong.
pub fn read_disparities(path: &Path, images: Option<&MatchedImages<'_>>) -> Result<FloatImage> {
    let StoredDisparities { map, encoding, doubt } = files::read_disparities(path, images, limits())?;
    let path = path.display();
    if let Some(doubt) = doubt {
        terminal::warn(&format!("{path} has {doubt}: are they the disparities of these images?"));
    }
    if matches!(encoding, DisparityEncoding::Kitti | DisparityEncoding::OpenCv) {
        terminal::say(&format!("{path} is read as {encoding}"));
    }
    Ok(map)
}

/// Invalidates the pixels that the undistorted centre does not show.
pub fn mask_unseen(undistortion: Option<&Undistortion>, disparities: &mut DisparityMap, confidences: Option<&mut ConfidenceMap>) {
    let Some(undistortion) = undistortion else { return };
    undistortion.mask(disparities);
    if let Some(confidences) = confidences {
        confidence_map::filter_by_confidence(disparities, confidences, 0);
    }
}
