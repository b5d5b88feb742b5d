//! `multiscopic capture`: a stage moves a camera, and the frames are written to a folder.

#[cfg(all(target_os = "linux", feature = "v4l2"))]
mod command;
#[cfg(not(all(target_os = "linux", feature = "v4l2")))]
mod unavailable;

#[cfg(all(target_os = "linux", feature = "v4l2"))]
pub use command::Capture;
#[cfg(not(all(target_os = "linux", feature = "v4l2")))]
pub use unavailable::Capture;
