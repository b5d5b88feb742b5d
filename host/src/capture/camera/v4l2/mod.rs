//! Cameras of Linux, through Video4Linux 2.

mod connection;
mod driver;
mod error;
mod frame_layout;
mod gray;
mod listing;
mod locked_controls;
mod stream;

use std::{
    fmt,
    path::{Path, PathBuf},
    sync::atomic::AtomicBool,
    time::{Duration, Instant},
};

use image::GrayImage;

use super::settings::CameraSettings;
use crate::capture::threaded_camera::BlockingCamera;
use connection::Connection;
pub use error::{CameraError, CameraFault};
pub use frame_layout::FrameLayout;
pub use listing::list;

/// An open V4L2 camera.
///
/// It stays usable after an error: the next call of [`frame`](V4l2Camera::frame) starts afresh, and reopens a
/// device that was unplugged and plugged in again. Dropping it stops the camera and restores the controls
/// that were locked.
pub struct V4l2Camera {
    path: PathBuf,
    settings: CameraSettings,
    layout: FrameLayout,
    card: String,
    /// `None` once the device was lost.
    connection: Option<Connection>,
}

impl V4l2Camera {
    /// Opens the camera at `path`, such as `/dev/video0`, and sets its format and size.
    ///
    /// # Errors
    /// There is no such device, it may not be opened, it is not a camera, it is in use, or it lacks the
    /// format or the size.
    pub fn open(path: &Path, settings: &CameraSettings) -> Result<V4l2Camera, CameraError> {
        let of_device = |fault| CameraError { device: path.into(), fault };
        let connection = Connection::open(path, settings.format, settings.size).map_err(of_device)?;
        let (layout, card) = (connection.layout(), connection.card().to_owned());
        Ok(V4l2Camera { path: path.into(), settings: settings.clone(), layout, card, connection: Some(connection) })
    }

    /// Takes a picture: the rounded mean of [`CameraSettings::average`] frames, none of which was exposed
    /// before this call.
    ///
    /// The first call starts the camera, lets it warm up, and locks its controls. Later calls discard the
    /// frames that are queued or already being exposed.
    ///
    /// It returns within `timeout`, and within a tenth of a second once `is_cancelled` is set, not counting the
    /// time that the driver takes to start and stop the stream.
    ///
    /// # Errors
    /// No frame arrived in time, a frame was damaged, the device is gone, or the call was cancelled.
    pub fn frame(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<GrayImage, CameraError> {
        let taken = self.try_frame(Instant::now(), timeout, is_cancelled);
        taken.map_err(|fault| CameraError { device: self.path.clone(), fault })
    }

    fn try_frame(&mut self, start: Instant, timeout: Duration, is_cancelled: &AtomicBool) -> Result<GrayImage, CameraFault> {
        let mut connection = match self.connection.take() {
            Some(connection) => connection,
            None => Connection::open(&self.path, Some(self.layout.format), Some(self.layout.size))?,
        };
        let taken = connection.frame(&self.settings, stream::Wait { start, timeout, is_cancelled });
        if taken.is_err() {
            connection.stop();
        }
        // A device that is plugged in again is another file.
        if !matches!(taken, Err(CameraFault::Disconnected)) {
            self.connection = Some(connection);
        }
        taken
    }

    /// The layout of the camera's frames in memory.
    pub fn layout(&self) -> FrameLayout {
        self.layout
    }

    /// Width and height of its frames in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.layout.size
    }
}

impl BlockingCamera for V4l2Camera {
    type Error = CameraError;

    fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<GrayImage, CameraError> {
        self.frame(timeout, is_cancelled)
    }
}

/// One line: `/dev/video0 (HD Webcam), 640x480 YUYV`.
impl fmt::Display for V4l2Camera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}), {}", self.path.display(), self.card, self.layout)
    }
}
