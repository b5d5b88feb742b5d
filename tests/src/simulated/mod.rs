//! Simulated hardware with faults on demand, in time that passes only while somebody waits. It shares no code with the drivers
//! under test.

pub mod arm;
#[cfg(target_os = "linux")]
pub mod cameras;
#[cfg(unix)]
pub mod machine;
pub mod network;
pub mod pose;

use std::{
    sync::{
        Mutex, PoisonError, Weak,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
    thread,
    time::{Duration, Instant},
};

use multiscopic::capture::Clock;

/// The longest step in which time passes.
const STEP: Duration = Duration::from_millis(1);

/// Something that goes on while time passes.
trait Device: Send + Sync {
    /// Does what is due, and waits until whoever is told of it has taken it.
    fn step(&self);
}

/// A clock that stands still except while the one thread that drives the hardware sleeps.
///
/// The work of other threads, however long the system takes for it, costs no time. So time-outs are reached because of events,
/// never because the machine is busy.
#[derive(Debug)]
pub struct SimulatedClock {
    begin: Instant,
    /// Nanoseconds since the beginning.
    passed: AtomicU64,
    keeps_pace: AtomicBool,
    devices: Mutex<Vec<Weak<dyn Device>>>,
}

impl Default for SimulatedClock {
    fn default() -> SimulatedClock {
        SimulatedClock {
            begin: Instant::now(),
            passed: AtomicU64::new(0),
            keeps_pace: AtomicBool::new(false),
            devices: Mutex::default(),
        }
    }
}

impl SimulatedClock {
    /// The time since the beginning.
    pub fn elapsed(&self) -> Duration {
        Duration::from_nanos(self.passed.load(Ordering::SeqCst))
    }

    /// Makes sleeping take as long as it says, while something is waited for that has no part in the simulation.
    pub fn keep_pace(&self, keeps_pace: bool) {
        self.keeps_pace.store(keeps_pace, Ordering::SeqCst);
    }

    /// Lets a device go on while time passes.
    fn attach(&self, device: Weak<dyn Device>) {
        self.devices.lock().unwrap_or_else(PoisonError::into_inner).push(device);
    }

    fn step(&self, duration: Duration) {
        self.passed.fetch_add(duration.as_nanos() as u64, Ordering::SeqCst);
        let devices: Vec<_> = {
            let mut devices = self.devices.lock().unwrap_or_else(PoisonError::into_inner);
            devices.retain(|device| device.strong_count() > 0);
            devices.iter().filter_map(Weak::upgrade).collect()
        };
        devices.iter().for_each(|device| device.step());
    }
}

impl Clock for SimulatedClock {
    fn now(&self) -> Instant {
        self.begin + self.elapsed()
    }

    fn sleep(&self, duration: Duration) {
        if self.keeps_pace.load(Ordering::SeqCst) {
            thread::sleep(duration);
        }
        let end = self.elapsed() + duration;
        while let Some(remaining) = end.checked_sub(self.elapsed()).filter(|remaining| !remaining.is_zero()) {
            self.step(remaining.min(STEP));
        }
    }
}
