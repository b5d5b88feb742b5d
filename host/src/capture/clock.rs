//! The time by which stages are polled and waited for.

use std::{
    fmt, thread,
    time::{Duration, Instant},
};

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
pub struct SteppedClock(std::sync::Mutex<Instant>);

#[cfg(test)]
impl SteppedClock {
    pub fn new() -> std::sync::Arc<SteppedClock> {
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
