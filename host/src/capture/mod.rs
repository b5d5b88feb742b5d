//! Taking the frames: cameras, the stages that move them, and the capture that runs both.
//!
//! | item | what it is |
//! | --- | --- |
//! | [`stage`] | robot arms, G-code machines, a person |
//! | [`camera`] | cameras of Linux (V4L2), with the feature `v4l2` |
//! | [`BlockingCamera`], [`ThreadedCamera`] | a camera that blocks, polled from a thread of its own |
//! | [`acquire_frames`] | runs the core's [`Sequence`](multiscopic_core::capture::Sequence) into memory |

mod acquisition;
#[cfg(all(target_os = "linux", feature = "v4l2"))]
pub mod camera;
pub mod stage;
mod threaded_camera;

pub use acquisition::acquire_frames;
pub use threaded_camera::{BlockingCamera, ThreadedCamera};
