//! What can go wrong with a camera.

use std::{io, path::PathBuf, time::Duration};

use super::{Layout, PixelFormat};

/// An error of a camera, which its message names.
#[derive(Debug, thiserror::Error)]
#[error("{}: {fault}", device.display())]
pub struct CameraError {
    /// The device.
    pub device: PathBuf,
    /// What is wrong with it.
    pub fault: Fault,
}

impl From<CameraError> for crate::error::Error {
    fn from(error: CameraError) -> crate::error::Error {
        crate::error::Error::Device(Box::new(error))
    }
}

/// What is wrong with a camera, what was expected, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// There is no such device.
    #[error("there is no such device; `multiscopic devices` lists what there is")]
    NotFound,
    /// The device may not be opened.
    #[error(
        "permission denied; become a member of its group (on most systems: `sudo usermod -aG video $USER`, then log in again)"
    )]
    Forbidden,
    /// The device takes no pictures, or not in the way that is understood here.
    #[error("found {found}, expected a camera that streams; `multiscopic devices` lists those that there are")]
    NotACamera {
        /// What it is.
        found: String,
    },
    /// The device has the multi-planar interface alone.
    #[error(
        "found a device with the multi-planar interface alone (as many camera ports of boards have), which is not supported; use a single-planar one"
    )]
    MultiPlanar,
    /// The device is in use.
    #[error("the device is in use; close the other program that reads it (`fuser -v` names it)")]
    Busy,
    /// The device was unplugged, or its driver is gone.
    #[error("the device is gone; plug it in again")]
    Disconnected,
    /// The device has no format that is understood.
    #[error("found the formats {offered}, expected one of {}", PixelFormat::names())]
    NoFormat {
        /// What it has.
        offered: String,
    },
    /// The device does not have the format or the size.
    #[error("found {found}, expected {expected}; `multiscopic devices` lists what the device has")]
    Format {
        /// What it has instead.
        found: String,
        /// What was asked for.
        expected: String,
    },
    /// No frame came in time.
    #[error("found {frames} of {expected} frames after {:.1} s; check cable, power and trigger, or allow more time", waited.as_secs_f64())]
    NoFrame {
        /// Frames that came.
        frames: u32,
        /// Frames that were needed, those that are dropped included.
        expected: u32,
        /// How long it took.
        waited: Duration,
    },
    /// The capture was cancelled.
    #[error("cancelled")]
    Cancelled,
    /// The driver says that data of the frame are lost or damaged.
    #[error("found a frame that the driver calls damaged; try again, and check cable and bandwidth if it stays")]
    Damaged,
    /// The frame has too few bytes.
    #[error(
        "found a frame of {found} bytes, expected {expected} for {layout}; try again, and check cable and bandwidth if it stays"
    )]
    Truncated {
        /// Its bytes.
        found: u64,
        /// What it has at least.
        expected: u64,
        /// What it should be.
        layout: Layout,
    },
    /// The frame is no JPEG image, or is one of another size.
    #[error("found {found}, expected a complete JPEG image of {layout}; try again, and check cable and bandwidth if it stays")]
    Jpeg {
        /// What it is.
        found: String,
        /// What it should be.
        layout: Layout,
    },
    /// The device does not have what is to be set.
    #[error("found no control of {control}, expected one to set; leave it out")]
    NoControl {
        /// What it controls.
        control: &'static str,
    },
    /// The device does not let something be set.
    #[error("{control} cannot be set to {value}: found {found}; choose a value that the camera has, or do not lock it")]
    Control {
        /// What it controls.
        control: &'static str,
        /// What was to be set.
        value: String,
        /// The value that it has instead, or what the system said.
        found: String,
    },
    /// The system refused something else.
    #[error("cannot {action}: {source}; try again, and plug the device in anew if it stays")]
    System {
        /// What was to be done.
        action: &'static str,
        /// What the system said.
        source: io::Error,
    },
}

/// "No such device", which has no kind of its own; the number is the same on all of Linux's architectures.
const ENODEV: i32 = 19;

impl Fault {
    /// What it means that the system said `source` when it was to do `action`.
    pub(super) fn of(action: &'static str) -> impl Fn(io::Error) -> Fault {
        move |source| match source.kind() {
            io::ErrorKind::ResourceBusy => Fault::Busy,
            _ if is_gone(&source) => Fault::Disconnected,
            _ => Fault::System { action, source },
        }
    }
}

/// Whether the system said that there is no device any more.
pub(super) fn is_gone(error: &io::Error) -> bool {
    error.raw_os_error() == Some(ENODEV)
}
