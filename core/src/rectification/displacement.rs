//! The distance at which a pixel is found.

use crate::Disparity;

/// The place of a rectified pixel's grey value in the frame that the camera took, relative to the pixel's own
/// coordinates. In steps of 1/64 pixel, up to 512 pixels away.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Displacement {
    /// Steps to the right.
    pub right: i16,
    /// Steps down.
    pub down: i16,
}

impl Displacement {
    /// The steps of a pixel: those of a [`Disparity`].
    pub const STEPS: i32 = Disparity::STEPS;

    /// No displacement.
    pub const ZERO: Displacement = Displacement { right: 0, down: 0 };
}
