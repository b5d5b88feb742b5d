//! Errors and warnings of the library as this program tells them: with the options that change what is wrong.

#[cfg(feature = "calibration")]
use multiscopic::calibration::{BoardMiss, HandEyeError, LensCalibrationError};
use multiscopic::{
    DisparityMap, Error, Geometry, Inspection, MatchSetup,
    error::{MountingError, Warning},
};
use multiscopic_core::SearchSpace;

/// The message of an error.
pub fn error(error: &Error) -> String {
    match error {
        Error::Memory { task: "the match", .. } => format!("{error} (--num-disparities, --shrink 2)"),
        Error::PictureSize { .. } => format!("{error} (--max-pixels)"),
        Error::UnknownRange => format!("{error}: give --min-disparity and --num-disparities"),
        Error::Refused(refused) => warning(refused),
        Error::Mounting(refused) => mounting(refused),
        _ => error.to_string(),
    }
}

/// The messages of the warnings after matching.
pub fn warnings(preparation: &MatchSetup, disparities: &DisparityMap, search: &SearchSpace) -> Vec<String> {
    preparation.warnings(disparities, search).iter().map(warning).collect()
}

/// The message of a warning about the frames of a sweep, which are not aligned.
pub fn of_sweep(message: &str) -> String {
    message.replace("align the views (--align)", "turn the camera square to its stage, or capture with --mount")
}

/// The message if no pixel of a frame from the firmware's pipeline has a disparity.
pub fn no_disparity(disparities: &DisparityMap) -> Option<&'static str> {
    let is_empty = disparities.range().is_none();
    is_empty.then_some("no pixel has a disparity: look at the images, and choose a profile with the disparities that they show")
}

/// The message if disparities have no depth, though there are some.
pub fn no_depth(disparities: &DisparityMap, geometry: &Geometry) -> Option<&'static str> {
    let has_depth = disparities.pixels().iter().flatten().any(|&disparity| geometry.depth(disparity).is_some());
    (!has_depth && disparities.range().is_some()).then_some(
        "no pixel has a depth, since all disparities plus doffs are 0 or less: check the order of the views, and --doffs",
    )
}

/// The message of a warning.
pub fn warning(warning: &Warning) -> String {
    match warning {
        Warning::NoDisparity => format!("{warning} (--auto-range, --min-confidence)"),
        Warning::UnknownRange { .. } => format!("{warning}: give --min-disparity and --num-disparities"),
        Warning::Swapped(_) => format!("{warning}; if they are right, give a negative --min-disparity"),
        Warning::OffLine { .. } | Warning::Shifted { .. } => format!("{warning} (--align)"),
        Warning::Brightness { .. } => format!("{warning} (--no-inspection leaves it)"),
        Warning::FocalLength { .. } => format!("{warning} (--focal-px)"),
        Warning::Depths { .. } => format!("{warning} (--baseline-mm, --focal-px)"),
        Warning::Distorted => format!("{warning} (multiscopic calibrate lens)"),
        Warning::PileAtLast { num_disparities, .. } => {
            format!("{warning}: give --num-disparities above {num_disparities}, or --auto-range")
        }
        Warning::PileAtFirst { first, .. } => format!("{warning}: give --min-disparity below {first}, or --auto-range"),
        Warning::BeyondRange { shown, .. } => {
            format!("{warning}: {}, or --auto-range", range_options(*shown.start(), *shown.end()))
        }
        _ => warning.to_string(),
    }
}

/// The range of disparities that images show, with the options of `multiscopic match` for it.
pub fn range_line(inspection: &Inspection) -> Option<String> {
    let shown = inspection.shown_range()?;
    let (first, last) = (*shown.start(), *shown.end());
    Some(format!("disparities from {first} to {last}: {}", range_options(first, last)))
}

fn range_options(first: i16, last: i16) -> String {
    format!("--min-disparity {first} --num-disparities {}", i32::from(last) - i32::from(first) + 1)
}

fn mounting(error: &MountingError) -> String {
    let message = error.to_string();
    match error {
        MountingError::FewBlocks { .. } => message.replace("take a shorter step", "take a shorter --step"),
        MountingError::SmallParallax { .. } | MountingError::Uncertain { .. } => {
            message.replace("take a longer step", "take a longer --step")
        }
        MountingError::NoFlatTarget { .. } => message
            .replace("the distance is that", "--distance is that")
            .replace("give the focal length or the lens instead", "give --focal-px or --lens instead"),
        _ => message,
    }
}

/// The message for a picture that does not help to calibrate a lens.
#[cfg(feature = "calibration")]
pub fn board_miss(miss: &BoardMiss) -> String {
    let message = miss.to_string();
    match miss {
        BoardMiss::NotFound => {
            message.replace("the kind of board, its squares and its dictionary", "--board, --squares and --dictionary")
        }
        BoardMiss::Larger { .. } => message.replace("correct the number of squares", "correct --squares"),
        _ => message,
    }
}

/// The message for pictures that do not determine a lens.
#[cfg(feature = "calibration")]
pub fn lens_calibration(error: &LensCalibrationError) -> String {
    let message = error.to_string();
    match error {
        LensCalibrationError::NoFit { .. } => message.replace("check the squares of the board,", "check --squares,"),
        LensCalibrationError::Contradiction { .. } => message.replace(
            "a flat board with the right squares, or another model",
            "a flat board and the right --squares, or another --model",
        ),
        _ => message,
    }
}

/// The message for pictures that do not tell where a camera sits on a tool.
#[cfg(feature = "calibration")]
pub fn hand_eye(error: &HandEyeError) -> String {
    let message = error.to_string();
    match error {
        HandEyeError::NoBoard { .. } => {
            message.replace("check the lens and the squares of the board", "check --lens and --square")
        }
        HandEyeError::Contradiction { .. } => message.replace("the squares of the board, and", "--square, and"),
        _ => message,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use multiscopic_core::View;

    #[test]
    fn errors_of_the_library_name_options() {
        let view = View::RIGHT;
        for (refused, option) in [
            (
                MountingError::FewBlocks { view, count: 7, needed: 60 },
                "7 textured blocks are found again, and 60 are needed: let the camera see a scene with texture everywhere, take a shorter --step, and",
            ),
            (
                MountingError::SmallParallax { parallax_px: 1.25, needed_px: 5.0 },
                "by 1.2 pixels, and 5 are needed: take a longer --step, or a nearer scene",
            ),
            (
                MountingError::Uncertain { deviation_deg: 0.5, allowed_deg: 0.25 },
                "uncertain by 0.50 degrees, and 0.25 are allowed: take a longer --step, a nearer scene with",
            ),
            (
                MountingError::NoFlatTarget { count: 9, spread: 0.1 },
                "--distance is that of a flat target in the middle of the image, but 9 points there are at distances that differ by 10 %: put a textured board there, or give --focal-px or --lens instead",
            ),
        ] {
            let message = error(&refused.into());
            assert!(message.contains(option), "{message}");
        }
        let size = Error::PictureSize { path: "p.png".into(), width: 4, height: 4, max_pixels: 15 };
        assert_eq!(
            error(&size),
            "p.png: found a picture of 4x4 pixels, expected 1 to 65535 pixels on each side and at most 15 in all (--max-pixels)"
        );
    }

    #[test]
    fn warnings_of_the_library_name_options() {
        let piled = Warning::PileAtLast { share: 0.125, last: 60, num_disparities: 60 };
        assert_eq!(
            warning(&piled),
            "12 % of the disparities are 60, an end of the range: give --num-disparities above 60, or --auto-range"
        );
        let first = Warning::PileAtFirst { share: 0.5, first: 1 };
        assert_eq!(
            warning(&first),
            "50 % of the disparities are 1, an end of the range: give --min-disparity below 1, or --auto-range"
        );
        let beyond = Warning::BeyondRange { share: 0.3, searched: 1..=60, shown: -2..=90 };
        assert_eq!(
            warning(&beyond),
            "30 % of the corners lie beyond the range 1..=60: the images show disparities from -2 to 90: --min-disparity -2 \
             --num-disparities 93, or --auto-range"
        );
        assert!(warning(&Warning::Distorted).ends_with(": calibrate the lens (multiscopic calibrate lens)"));
    }

    #[cfg(feature = "calibration")]
    #[test]
    fn boards_and_lenses_name_options() {
        let missed = board_miss(&BoardMiss::NotFound);
        assert!(missed.ends_with("in good light, or correct --board, --squares and --dictionary"), "{missed}");
        let larger = board_miss(&BoardMiss::Larger { found: [9, 6], squares: [8, 6] });
        assert!(larger.ends_with("one of 8x6 squares has 7x5: correct --squares"), "{larger}");
        let no_fit = LensCalibrationError::NoFit { model: multiscopic::LensModel::PlumbBob, first: "a.png".into() };
        let no_fit = lens_calibration(&no_fit);
        assert!(
            no_fit.ends_with("explains the images: check --squares, and that a.png and the others are from one camera"),
            "{no_fit}"
        );
        let contradiction = LensCalibrationError::Contradiction { rms_px: 2.0, worst: "b.png".into(), worst_px: 3.0 };
        let contradiction = lens_calibration(&contradiction);
        assert!(contradiction.ends_with("a flat board and the right --squares, or another --model"), "{contradiction}");
    }
}
