//! Errors of cameras.

use std::{io, path::PathBuf, time::Duration};

use super::frame_layout::FrameLayout;
use crate::capture::camera::settings::PixelFormat;

/// An error of a camera. Its message names the device.
#[derive(Debug, thiserror::Error)]
#[error("{}: {fault}", device.display())]
pub struct CameraError {
    /// The device.
    pub device: PathBuf,
    /// The fault.
    pub fault: CameraFault,
}

impl From<CameraError> for crate::error::Error {
    fn from(error: CameraError) -> crate::error::Error {
        crate::error::Error::Device(Box::new(error))
    }
}

/// A fault of a camera, with the expectation and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CameraFault {
    /// There is no such device.
    #[error("no such device; `multiscopic devices` lists the cameras")]
    NotFound,
    /// The device may not be opened.
    #[error(
        "permission denied; become a member of its group (on most systems: `sudo usermod -aG video $USER`, then log in again)"
    )]
    Forbidden,
    /// The device is not a camera, or cannot stream.
    #[error("found {found}, expected a camera that can stream; `multiscopic devices` lists the cameras")]
    NotACamera {
        /// The device that was found.
        found: String,
    },
    /// The device has only the multi-planar interface.
    #[error(
        "found a device with the multi-planar interface only, like many camera ports of boards; this is not supported: use a single-planar device"
    )]
    MultiPlanar,
    /// The device is in use.
    #[error("the device is in use; close the program that uses it (`fuser -v` names it)")]
    Busy,
    /// The device was unplugged, or its driver was unloaded.
    #[error("the device is gone; plug it in again")]
    Disconnected,
    /// The device has none of the supported formats.
    #[error("found the formats {offered}, expected one of {}", PixelFormat::names())]
    NoFormat {
        /// The formats that it has.
        offered: String,
    },
    /// The device does not have the format or the size.
    #[error("found {found}, expected {expected}; `multiscopic devices` lists the formats and sizes of each camera")]
    Format {
        /// The layout that it would use instead.
        found: String,
        /// The layout that was requested.
        expected: String,
    },
    /// No frame arrived in time.
    #[error(
        "found {frames} of {expected} frames after {:.1} s; check the cable, the power and the trigger, or allow more time",
        waited.as_secs_f64()
    )]
    NoFrame {
        /// Frames that arrived.
        frames: u32,
        /// Frames that were needed, including those to be discarded.
        expected: u32,
        /// The time for which they were waited for.
        waited: Duration,
    },
    /// The capture was cancelled.
    #[error("cancelled")]
    Cancelled,
    /// The driver marked the frame as damaged.
    #[error("found a frame that the driver marked as damaged; try again, and check the cable and the bandwidth if it persists")]
    Damaged,
    /// The frame has too few bytes.
    #[error(
        "found a frame of {found} bytes, expected {expected} for {layout}; try again, and check the cable and the bandwidth if it persists"
    )]
    Truncated {
        /// The bytes that it has.
        found: u64,
        /// The bytes that it needs at least.
        expected: u64,
        /// The expected layout.
        layout: FrameLayout,
    },
    /// The frame is not a JPEG image, or has another size.
    #[error(
        "found {found}, expected a complete JPEG image of {layout}; try again, and check the cable and the bandwidth if it persists"
    )]
    Jpeg {
        /// The data that was found.
        found: String,
        /// The expected layout.
        layout: FrameLayout,
    },
    /// The device does not have a control that should be set.
    #[error("found no control for {control}; do not set it")]
    NoControl {
        /// The setting.
        control: &'static str,
    },
    /// The device did not accept the value of a control.
    #[error("{control} cannot be set to {value}: found {found}; choose a value that the camera has, or do not lock it")]
    Control {
        /// The setting.
        control: &'static str,
        /// The requested value.
        value: String,
        /// The value that it has instead, or the error of the system.
        found: String,
    },
    /// Any other error of the system.
    #[error("cannot {action}: {source}; try again, and plug the device in again if it persists")]
    System {
        /// The operation that was attempted.
        action: &'static str,
        /// The error of the system.
        source: io::Error,
    },
}

impl CameraFault {
    /// Converts an error of the system that occurred when trying to `action`.
    pub(super) fn during(action: &'static str) -> impl Fn(io::Error) -> CameraFault {
        move |source| match source.kind() {
            io::ErrorKind::ResourceBusy => CameraFault::Busy,
            _ if is_gone(&source) => CameraFault::Disconnected,
            _ => CameraFault::System { action, source },
        }
    }
}

/// Returns true if the device no longer exists. [`io::ErrorKind`] has no variant for it.
pub(super) fn is_gone(error: &io::Error) -> bool {
    error.raw_os_error() == Some(libc::ENODEV)
}
