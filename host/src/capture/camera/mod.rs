//! Cameras of Linux (V4L2), and those that a command asks for pictures: listing them, and taking frames in 8 bits, grey or in colour.
//!
//! | item | what it is |
//! | --- | --- |
//! | [`list`], [`CameraInfo`] | the cameras of this machine, their formats and sizes |
//! | [`CameraSettings`] | format, size, warm-up, averaging, locked controls |
//! | [`V4l2Camera`] | an open camera; without the feature `v4l2` or off Linux, none can be opened |
//! | [`ExecCamera`] | a command that takes pictures |
//! | [`HttpCamera`], [`HttpUrl`] | a camera of a network that sends JPEG pictures |
//! | [`PixelFormat`], `FrameLayout` | how frames are encoded, and their conversion to pictures |
//! | [`CameraError`], `CameraFault` | what went wrong, and what to do |
//!
//! ```no_run
//! # use multiscopic::capture::camera::{CameraSettings, V4l2Camera};
//! # use std::{path::Path, sync::atomic::AtomicBool, time::Duration};
//! let is_cancelled = AtomicBool::new(false);
//! let mut camera = V4l2Camera::open(Path::new("/dev/video0"), &CameraSettings::default())?;
//! let center = camera.frame(Duration::from_secs(5), &is_cancelled)?;
//! // Move the camera, then:
//! let right = camera.frame(Duration::from_secs(5), &is_cancelled)?;
//! # Ok::<(), multiscopic::capture::camera::CameraError>(())
//! ```

mod exec;
mod http;
mod picture_mean;
mod pixel_format;
#[cfg(not(all(target_os = "linux", feature = "v4l2")))]
mod unsupported;
#[cfg(all(target_os = "linux", feature = "v4l2"))]
mod v4l2;

use std::{num::NonZeroU16, path::PathBuf};

use serde::Serialize;

pub use exec::ExecCamera;
pub use http::{HttpCamera, HttpError, HttpFault, HttpUrl};
pub use pixel_format::PixelFormat;
#[cfg(not(all(target_os = "linux", feature = "v4l2")))]
pub use unsupported::{CameraError, V4l2Camera, list};
#[cfg(all(target_os = "linux", feature = "v4l2"))]
pub use v4l2::{CameraError, CameraFault, FrameLayout, V4l2Camera, list};

/// The settings of a camera and of taking its pictures.
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
    /// True to freeze exposure, gain, focus and white balance after the warm-up, as far as the camera can, so that pictures can
    /// be compared.
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

/// A camera, with its formats and sizes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraInfo {
    /// Its device file.
    pub device: PathBuf,
    /// Its name; empty if it cannot be opened.
    pub card: String,
    /// Its driver; empty if it cannot be opened.
    pub driver: String,
    /// The bus and port that it is connected to; empty if it cannot be opened.
    pub bus: String,
    /// The reason why it cannot be used.
    pub problem: Option<String>,
    /// The formats that it has.
    pub formats: Vec<FormatInfo>,
}

/// A pixel format of a camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FormatInfo {
    /// Its four-character code, without padding.
    pub format: String,
    /// The driver's description.
    pub description: String,
    /// True if it is a [`PixelFormat`].
    pub is_supported: bool,
    /// The frame sizes that it comes in.
    pub sizes: Vec<FrameSizes>,
}

/// Frame sizes: width and height in pixels.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum FrameSizes {
    /// A single size.
    One([u32; 2]),
    /// A range of sizes.
    Range {
        /// The smallest size.
        min: [u32; 2],
        /// The largest size.
        max: [u32; 2],
        /// The increments from the smallest size.
        step: [u32; 2],
    },
}
