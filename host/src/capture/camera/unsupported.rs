//! Stand-ins for real cameras in builds without them.

use std::{convert::Infallible, fmt, path::Path, sync::atomic::AtomicBool, time::Duration};

use super::{CameraInfo, CameraSettings};
use crate::{
    capture::acquisition::BlockingCamera,
    error::{Error, Result},
    images::Picture,
};

/// This build has no support of real cameras.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("this build supports no real cameras: build multiscopic on Linux with the feature v4l2, or use the simulated one")]
pub struct CameraError;

impl From<CameraError> for Error {
    fn from(error: CameraError) -> Error {
        Error::Device(Box::new(error))
    }
}

/// No camera: this build supports none.
pub struct V4l2Camera(Infallible);

impl V4l2Camera {
    /// Opens no camera.
    ///
    /// # Errors
    /// Always.
    pub fn open(_: &Path, _: &CameraSettings) -> std::result::Result<V4l2Camera, CameraError> {
        Err(CameraError)
    }

    /// Width and height of its frames in pixels.
    pub fn size(&self) -> [u32; 2] {
        match self.0 {}
    }

    /// The quantities that the camera does not let be locked.
    pub fn unlocked(&self) -> &[&'static str] {
        match self.0 {}
    }
}

impl BlockingCamera for V4l2Camera {
    type Error = CameraError;

    fn take(&mut self, _: Duration, _: &AtomicBool) -> std::result::Result<Picture, CameraError> {
        match self.0 {}
    }
}

impl fmt::Display for V4l2Camera {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {}
    }
}

/// Lists no cameras.
///
/// # Errors
/// Always.
pub fn list() -> Result<Vec<CameraInfo>> {
    Err(CameraError.into())
}
