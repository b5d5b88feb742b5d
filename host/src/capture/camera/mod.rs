//! Cameras of Linux (V4L2): listing them, and taking frames in 8-bit grey.
//!
//! | item | what it is |
//! | --- | --- |
//! | [`list`], [`CameraInfo`] | the cameras of this machine, their formats and sizes |
//! | [`CameraSettings`] | format, size, warm-up, averaging, locked controls |
//! | [`V4l2Camera`] | an open camera; without the feature `v4l2` or off Linux, none can be opened |
//! | [`PixelFormat`], `FrameLayout` | how frames are encoded, and their conversion to grey |
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

mod settings;
#[cfg(not(all(target_os = "linux", feature = "v4l2")))]
mod unsupported;
#[cfg(all(target_os = "linux", feature = "v4l2"))]
mod v4l2;

pub use settings::{CameraInfo, CameraSettings, FormatInfo, FrameSizes, PixelFormat};
#[cfg(not(all(target_os = "linux", feature = "v4l2")))]
pub use unsupported::{CameraError, V4l2Camera, list};
#[cfg(all(target_os = "linux", feature = "v4l2"))]
pub use v4l2::{CameraError, CameraFault, FrameLayout, V4l2Camera, list};
