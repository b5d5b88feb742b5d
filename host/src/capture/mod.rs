//! Taking the frames: cameras, the stages that move them, and the capture that runs both.
//!
//! | item | what it is |
//! | --- | --- |
//! | [`stage`] | robot arms, G-code machines, a person |
//! | [`exec`] | commands that drive stages and cameras of any kind |
//! | [`camera`] | cameras of Linux (V4L2), with the feature `v4l2`, and their settings |
//! | `SimulatedCamera` | a camera that sees the scene of the demo, with the feature `scene` |
//! | [`Imperfections`] | what is wrong with a simulated rig |
//! | [`ImageCamera`] | a camera whose frames stay in memory |
//! | [`BlockingCamera`], [`ThreadedCamera`] | a camera that blocks, polled from a thread of its own |
//! | [`Clock`], [`SystemClock`] | the time by which stages are waited for |
//! | [`acquire_images`] | runs the core's [`Sequence`](multiscopic_core::capture::Sequence) into memory |
//! | [`RigParts`], [`CaptureLog`] | what frames were taken with, and when: `rig.toml` and `capture.log` of their folder |
//! | [`Accuracy`], [`Survey`], [`Choice`] | which long baseline gives the depth accuracy asked for |

mod accuracy;
mod acquisition;
pub mod camera;
mod capture_log;
pub mod exec;
mod imperfections;
mod lines;
mod rig_parts;
#[cfg(feature = "scene")]
mod simulated_camera;
pub mod stage;

use std::{
    fmt, thread,
    time::{Duration, Instant},
};

pub use accuracy::{Accuracy, Bound, Choice, Survey};
pub use acquisition::{Acquisition, BlockingCamera, ImageCamera, ThreadedCamera, acquire_images, acquire_images_with_clock};
pub use capture_log::CaptureLog;
pub use imperfections::Imperfections;
pub use rig_parts::RigParts;
#[cfg(feature = "scene")]
pub use simulated_camera::SimulatedCamera;

/// A source of time.
///
/// Stages and captures take the time from here and wait here. So tests can run them with simulated hardware in simulated time,
/// which passes only while somebody waits, however busy the machine is.
pub trait Clock: fmt::Debug + Send + Sync {
    /// The current time. It never goes back.
    fn now(&self) -> Instant;

    /// Waits for `duration`.
    fn sleep(&self, duration: Duration);
}

/// The clock of the operating system.
#[derive(Clone, Copy, Debug, Default)]
pub struct SystemClock;

impl Clock for SystemClock {
    fn now(&self) -> Instant {
        Instant::now()
    }

    fn sleep(&self, duration: Duration) {
        thread::sleep(duration);
    }
}

/// A clock that moves only while somebody waits.
#[cfg(test)]
#[derive(Debug)]
struct SteppedClock(std::sync::Mutex<Instant>);

#[cfg(test)]
impl SteppedClock {
    fn new() -> std::sync::Arc<SteppedClock> {
        std::sync::Arc::new(SteppedClock(Instant::now().into()))
    }
}

#[cfg(test)]
impl Clock for SteppedClock {
    fn now(&self) -> Instant {
        *self.0.lock().unwrap()
    }

    fn sleep(&self, duration: Duration) {
        *self.0.lock().unwrap() += duration;
    }
}
