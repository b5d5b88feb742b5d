//! How a camera is set up.

use std::num::NonZeroU16;

use super::format::PixelFormat;

/// How a camera is set up, and how its pictures are taken.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraSettings {
    /// Pixel format. `None`: the first of [`PixelFormat::ALL`] that the camera has.
    pub format: Option<PixelFormat>,
    /// Width and height in pixels. `None`: the camera's current size.
    pub size: Option<[u32; 2]>,
    /// Frames to discard after the camera starts, and again after its controls were locked: its automatic
    /// controls need a few frames to settle, and some drivers deliver a stale frame first.
    pub warm_up: u16,
    /// Frames averaged into one picture.
    pub average: NonZeroU16,
    /// Whether to freeze exposure, gain, focus and white balance after the warm-up, so that pictures can be
    /// compared.
    pub lock: bool,
    /// Exposure time in units of 100 µs. `None`: what the camera chose.
    pub exposure: Option<i32>,
    /// Gain in the camera's units. `None`: what the camera chose.
    pub gain: Option<i32>,
    /// Focus distance in the camera's units. `None`: what the camera chose.
    pub focus: Option<i32>,
    /// Colour temperature in kelvins. `None`: what the camera chose.
    pub white_balance: Option<i32>,
}

impl Default for CameraSettings {
    fn default() -> CameraSettings {
        CameraSettings {
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
