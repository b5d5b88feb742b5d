//! `multiscopic capture`: a stage moves a camera, and the frames are written to a folder with a `rig.toml`.

#[cfg(all(target_os = "linux", feature = "v4l2"))]
mod capture_log;
#[cfg(all(target_os = "linux", feature = "v4l2"))]
mod capture_options;
#[cfg(all(target_os = "linux", feature = "v4l2"))]
mod layout_options;
#[cfg(all(target_os = "linux", feature = "v4l2"))]
mod long_baseline;
#[cfg(all(target_os = "linux", feature = "v4l2"))]
mod recorder;
#[cfg(all(target_os = "linux", feature = "v4l2"))]
mod supported;
#[cfg(not(all(target_os = "linux", feature = "v4l2")))]
mod unsupported;

#[cfg(all(target_os = "linux", feature = "v4l2"))]
pub use supported::Capture;
#[cfg(not(all(target_os = "linux", feature = "v4l2")))]
pub use unsupported::UnsupportedCapture as Capture;
