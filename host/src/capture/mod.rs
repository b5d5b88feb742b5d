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
//! | `SimulatedStream` | the same camera while it moves, in simulated time |
//! | [`Clock`], [`SystemClock`], [`SteppedClock`] | the time by which stages are waited for |
//! | [`acquire_images`] | runs the core's [`Sequence`](multiscopic_core::capture::Sequence) into memory |
//! | [`acquire_sweep`], [`FreeCamera`], [`SweptFrames`] | frames of a camera that runs free while the stage slides it there and back |
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
#[cfg(feature = "scene")]
mod simulated_stream;
pub mod stage;
mod sweep;

use std::{
    fmt,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    thread,
    time::{Duration, Instant},
};

pub use accuracy::{Accuracy, Bound, Choice, Survey};
pub use acquisition::{Acquisition, BlockingCamera, ImageCamera, ThreadedCamera, acquire_images, acquire_images_with_clock};
pub use capture_log::CaptureLog;
pub use imperfections::{CameraTiming, Imperfections};
pub use rig_parts::RigParts;
#[cfg(feature = "scene")]
pub use simulated_camera::SimulatedCamera;
#[cfg(feature = "scene")]
pub use simulated_stream::SimulatedStream;
pub use sweep::{Arrival, FreeCamera, SweepPass, SweptFrames, Track, acquire_sweep};

/// The interval at which stages and cameras are polled.
const POLL_INTERVAL: Duration = Duration::from_millis(2);

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
#[derive(Debug)]
pub struct SteppedClock(Mutex<Instant>);

impl SteppedClock {
    /// A clock that begins now.
    pub fn new() -> Arc<SteppedClock> {
        Arc::new(SteppedClock(Instant::now().into()))
    }

    fn time(&self) -> MutexGuard<'_, Instant> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Clock for SteppedClock {
    fn now(&self) -> Instant {
        *self.time()
    }

    fn sleep(&self, duration: Duration) {
        *self.time() += duration;
    }
}
