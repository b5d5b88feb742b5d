//! Warnings about a capture and the disparities found in it.

use std::{
    fmt::{self, Display, Formatter},
    ops::RangeInclusive,
};

use multiscopic_core::{Frame, View};

/// A reason to doubt a capture, or the disparities that a search found in it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// Views show the scene moved the wrong way.
    Swapped(Vec<View>),
    /// The edges of a frame are much softer than those of most others.
    Blurred(Frame),
    /// A view is the same image as the centre, pixel by pixel.
    Copy(View),
    /// Much of the centre has no texture.
    Flat {
        /// The share of the centre without texture.
        share: f64,
    },
    /// The views look as if the lens distorted them.
    Distorted,
    /// Disparities pile up at the last disparity of the search.
    PileAtLast {
        /// The share of the disparities that are there.
        share: f64,
        /// The last disparity, in pixels.
        last: i16,
        /// The number of disparities of the search.
        num_disparities: u16,
    },
    /// Disparities pile up at the first disparity of the search.
    PileAtFirst {
        /// The share of the disparities that are there.
        share: f64,
        /// The first disparity, in pixels.
        first: i16,
    },
    /// Many corners of the images have disparities beyond the search.
    BeyondRange {
        /// The share of the corners with such disparities.
        share: f64,
        /// The disparities of the search, in pixels.
        searched: RangeInclusive<i16>,
        /// The disparities that the images show, in pixels.
        shown: RangeInclusive<i16>,
    },
}

impl Display for Warning {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Warning::Swapped(views) => {
                let names: Vec<String> = views.iter().map(View::to_string).collect();
                let (noun, look) = if names.len() == 1 { ("view", "looks") } else { ("views", "look") };
                write!(
                    f,
                    "the {} {noun} {look} swapped with the opposite side, or the images mirrored: the scene moves the wrong way",
                    names.join(" and ")
                )
            }
            Warning::Blurred(frame) => write!(
                f,
                "the {frame} image is blurred beside the others: keep the camera still while it takes it, and the focus fixed"
            ),
            Warning::Copy(view) => {
                write!(f, "the {view} view is the same image as the centre: check the files, and that the camera moves")
            }
            Warning::Flat { share } => write!(
                f,
                "{:.0} % of the centre has no texture, and disparities there are unreliable: add light, or project a pattern",
                100.0 * share
            ),
            Warning::Distorted => f.write_str(
                "all views look turned towards their baselines alike, as by a lens that distorts or a wrong focal length: calibrate \
                 the lens",
            ),
            Warning::PileAtLast { share, last: end, .. } | Warning::PileAtFirst { share, first: end } => {
                write!(f, "{:.0} % of the disparities are {end}, an end of the range", 100.0 * share)
            }
            Warning::BeyondRange { share, searched, shown } => write!(
                f,
                "{:.0} % of the corners lie beyond the range {searched:?}: the images show disparities from {} to {}",
                100.0 * share,
                shown.start(),
                shown.end()
            ),
        }
    }
}
