//! Cameras of Linux (V4L2): what there is, and frames in 8-bit grey.
//!
//! ```no_run
//! # use multiscopic::capture::camera::{Camera, Settings};
//! # use std::{path::Path, sync::atomic::AtomicBool, time::Duration};
//! let is_cancelled = AtomicBool::new(false);
//! let mut camera = Camera::open(Path::new("/dev/video0"), &Settings::default())?;
//! let center = camera.frame(Duration::from_secs(5), &is_cancelled)?;
//! // Move the camera, then:
//! let right = camera.frame(Duration::from_secs(5), &is_cancelled)?;
//! # Ok::<(), multiscopic::capture::camera::CameraError>(())
//! ```

mod connection;
mod driver;
mod error;
mod format;
mod jpeg;
mod layout;
mod listing;
mod lock;
mod mean;
mod settings;
mod stream;

use std::{
    fmt,
    path::{Path, PathBuf},
    sync::atomic::AtomicBool,
    time::{Duration, Instant},
};

use image::GrayImage;

use connection::Connection;
pub use error::{CameraError, Fault};
pub use format::PixelFormat;
pub use layout::Layout;
pub use listing::{Listing, Offer, Sizes, list};
pub use settings::Settings;

/// A camera, and how it is set.
///
/// An error leaves it usable: the next [`frame`](Camera::frame) starts anew, and finds a camera that was unplugged and is back. When it is
/// dropped, it stops, and what was locked is as it was before.
pub struct Camera {
    path: PathBuf,
    settings: Settings,
    layout: Layout,
    card: String,
    /// `None` after the device was lost.
    connection: Option<Connection>,
}

impl Camera {
    /// Opens the camera at `path`, `/dev/videoN`, and sets its format and size.
    ///
    /// # Errors
    /// If there is no such device or no permission, if it is none that takes pictures or is in use, or if it does not have the format or
    /// size.
    pub fn open(path: &Path, settings: &Settings) -> Result<Camera, CameraError> {
        let named = |fault| CameraError { device: path.into(), fault };
        let connection = Connection::open(path, settings.format, settings.size).map_err(named)?;
        let (layout, card) = (connection.layout(), connection.card().to_owned());
        Ok(Camera { path: path.into(), settings: settings.clone(), layout, card, connection: Some(connection) })
    }

    /// Takes a picture of what is there now: nothing of it was exposed before this call.
    ///
    /// The first call starts the camera, lets it warm up, and locks it. Later calls drop the frames that were waiting and those that were
    /// on their way. The mean of [`Settings::average`] frames is taken, rounded.
    ///
    /// Whatever happens, it returns within `timeout`, and within a tenth of a second once `is_cancelled`; but for the time that the
    /// driver takes to start and stop.
    ///
    /// # Errors
    /// If no frame comes in time, a frame is damaged, the camera is gone, or it is cancelled. The next call tries again from the start.
    pub fn frame(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<GrayImage, CameraError> {
        let taken = self.take(Instant::now(), timeout, is_cancelled);
        taken.map_err(|fault| CameraError { device: self.path.clone(), fault })
    }

    fn take(&mut self, start: Instant, timeout: Duration, is_cancelled: &AtomicBool) -> Result<GrayImage, Fault> {
        let mut connection = match self.connection.take() {
            Some(connection) => connection,
            None => Connection::open(&self.path, Some(self.layout.format), Some(self.layout.size))?,
        };
        let taken = connection.frame(&self.settings, stream::Wait { start, timeout, is_cancelled });
        if taken.is_err() {
            connection.stop();
        }
        // What is unplugged comes back as another file.
        if !matches!(taken, Err(Fault::Disconnected)) {
            self.connection = Some(connection);
        }
        taken
    }

    /// How its frames lie in memory.
    pub fn layout(&self) -> Layout {
        self.layout
    }
}

/// The camera and how it is set, in a line: `/dev/video0 (HD Webcam), 640x480 YUYV`.
impl fmt::Display for Camera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}), {}", self.path.display(), self.card, self.layout)
    }
}
