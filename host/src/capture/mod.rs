//! Taking the frames: cameras, stages, and the session in which a stage moves a camera.

#[cfg(all(target_os = "linux", feature = "v4l2"))]
pub mod camera;
pub mod session;
mod shutter;
pub mod stage;

pub use shutter::{Shutter, Take};
