//! The driver of a camera: calls to it through crate `v4l`, the faults that they find, and the layout of frames.

use std::{
    fmt, io,
    path::{Path, PathBuf},
    time::Duration,
};

use v4l::{Device, buffer::Type, capability::Flags};

use super::ioctl::{self, Capabilities};
use crate::capture::camera::{PixelFormat, pixel_format::Chroma};

/// Opens the device at `path` and queries its capabilities.
pub(super) fn open(path: &Path) -> Result<(Device, Capabilities), CameraFault> {
    let device = Device::with_path(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => CameraFault::NotFound,
        io::ErrorKind::PermissionDenied => CameraFault::Forbidden,
        _ if is_gone(&error) => CameraFault::Disconnected,
        _ => CameraFault::System { action: "open it", source: error },
    })?;
    let capabilities = ioctl::capabilities(&device).map_err(|error| match error.raw_os_error() {
        // Files that are not V4L2 devices do not know the ioctl.
        Some(libc::ENOTTY) => CameraFault::NotACamera { found: "no V4L2 device".into() },
        _ => CameraFault::during("query its capabilities")(error),
    })?;
    Ok((device, capabilities))
}

/// The kind of a camera's buffers: in one piece, or, as of the camera ports of many boards, with memory for each plane. Fails
/// unless the device is a camera that can be used here.
pub(super) fn buffers(capabilities: &Capabilities) -> Result<Type, CameraFault> {
    let has = |flags: Flags| capabilities.flags.contains(flags);
    let found = match () {
        () if has(Flags::VIDEO_CAPTURE | Flags::STREAMING) => return Ok(Type::VideoCapture),
        () if has(Flags::VIDEO_CAPTURE_MPLANE | Flags::STREAMING) => return Ok(Type::VideoCaptureMplane),
        () if has(Flags::VIDEO_CAPTURE) || has(Flags::VIDEO_CAPTURE_MPLANE) => "a camera that cannot stream",
        () if has(Flags::VIDEO_OUTPUT) => "an output (a loopback device that nothing feeds is one)",
        () if has(Flags::VIDEO_M2M) || has(Flags::VIDEO_M2M_MPLANE) => "a codec",
        () if has(Flags::META_CAPTURE) => "a camera's metadata device",
        () => "a device of another kind",
    };
    Err(CameraFault::NotACamera { found: format!("{found} ({})", capabilities.card) })
}

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
    /// The device has no such control, no manual mode of it, or not the value.
    #[error("{control} cannot be set to {value}: found {found}; give a value that the camera has, or leave it to the camera")]
    Control {
        /// The setting.
        control: &'static str,
        /// The requested value.
        value: i32,
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

/// The layout of a camera's frames in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameLayout {
    /// Pixel format.
    pub format: PixelFormat,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Bytes from the start of a row to the start of the next; 0 if rows are not padded. JPEG images have no
    /// stride.
    pub stride: u32,
}

impl FrameLayout {
    /// The fewest bytes that a frame can have: its last row need not be padded.
    pub(super) fn bytes(&self) -> u64 {
        let [width, height] = self.size.map(u64::from);
        let stride = self.stride() as u64;
        // A driver may claim any size. No buffer has as many bytes as the greatest number.
        let plane = |rows: u64, stride: u64, row: u64| rows.saturating_sub(1).saturating_mul(stride).saturating_add(row);
        let Chroma::Planes(planes, _) = self.format.encoding().chroma else {
            return plane(height, stride, self.row_bytes() as u64);
        };
        let chroma_row = 2 * width.div_ceil(2) / planes;
        let rows = plane(planes * height.div_ceil(2), self.chroma_stride(planes), chroma_row);
        rows.saturating_add(height.saturating_mul(stride))
    }

    /// The distance between rows of a plane of chroma in bytes, if there are this many planes.
    pub(super) fn chroma_stride(&self, planes: u64) -> u64 {
        let chroma_row = 2 * u64::from(self.size[0]).div_ceil(2) / planes;
        chroma_row.max(self.stride() as u64 / planes)
    }

    /// Bytes per pixel.
    pub(super) fn pixel_bytes(&self) -> usize {
        self.format.encoding().pixel_bytes
    }

    /// Bytes of a row, without padding.
    pub(super) fn row_bytes(&self) -> usize {
        self.size[0] as usize * self.pixel_bytes()
    }

    /// The distance between rows in bytes. A stride shorter than a row means that there is no padding.
    pub(super) fn stride(&self) -> usize {
        self.row_bytes().max(self.stride as usize)
    }
}

/// `640x480 YUYV`.
impl fmt::Display for FrameLayout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size;
        write!(f, "{width}x{height} {}", self.format.name())
    }
}
