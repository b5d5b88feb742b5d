//! How a camera is set.

use std::num::NonZeroU16;

use super::PixelFormat;

/// How a camera is set, and how its frames are taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// The pixel format; by default the best that the camera has, in the order of [`PixelFormat::ALL`].
    pub format: Option<PixelFormat>,
    /// Width and height in pixels; by default what the camera is set to.
    pub size: Option<[u32; 2]>,
    /// Frames dropped when the camera starts, and again when it is locked: its automatics need some to settle, and the first of some
    /// drivers is an old one.
    pub warm_up: u16,
    /// Frames whose mean is a picture.
    pub average: NonZeroU16,
    /// Whether exposure, gain, focus and white balance, which the camera sets itself, stay as they are after the warm-up, so that all
    /// pictures are taken alike.
    pub lock: bool,
    /// Exposure time in units of 100 µs, instead of what the camera finds.
    pub exposure: Option<i32>,
    /// Gain in the camera's units, instead of what the camera finds.
    pub gain: Option<i32>,
    /// Distance of focus in the camera's units, instead of what the camera finds.
    pub focus: Option<i32>,
    /// Colour temperature in kelvins, instead of what the camera finds.
    pub white_balance: Option<i32>,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            format: None,
            size: None,
            warm_up: 8,
            average: NonZeroU16::MIN,
            lock: true,
            exposure: None,
            gain: None,
            focus: None,
            white_balance: None,
        }
    }
}
