//! Taking the frames: cameras, the stages that move them, and the capture that runs both.
//!
//! | item | what it is |
//! | --- | --- |
//! | [`stage`] | robot arms, G-code machines, a person |
//! | [`camera`] | cameras of Linux (V4L2), with the feature `v4l2`, and their settings |
//! | `SimulatedCamera` | a camera that sees the scene of the demo, with the feature `scene` |
//! | [`Imperfections`] | what is wrong with a simulated rig |
//! | [`BlockingCamera`], [`ThreadedCamera`] | a camera that blocks, polled from a thread of its own |
//! | [`Clock`], [`SystemClock`] | the time by which stages are waited for |
//! | [`acquire_images`] | runs the core's [`Sequence`](multiscopic_core::capture::Sequence) into memory |
//! | [`Accuracy`], [`Survey`], [`Choice`] | which long baseline gives the depth accuracy asked for |

mod accuracy;
mod acquisition;
pub mod camera;
mod clock;
mod imperfections;
#[cfg(feature = "scene")]
mod simulated_camera;
pub mod stage;
mod threaded_camera;

pub use accuracy::{Accuracy, Bound, Choice, Survey};
pub use acquisition::{Acquisition, acquire_images, acquire_images_with_clock};
pub use clock::{Clock, SystemClock};
pub use imperfections::Imperfections;
#[cfg(feature = "scene")]
pub use simulated_camera::SimulatedCamera;
pub use threaded_camera::{BlockingCamera, ThreadedCamera};
