//! Long work that leaves the interpreter to other threads, and that Ctrl-C ends.

use std::{
    panic,
    sync::{
        atomic::{AtomicBool, Ordering},
        mpsc::{self, RecvTimeoutError},
    },
    thread,
    time::Duration,
};

use multiscopic::Progress;
use pyo3::prelude::*;

use crate::exceptions::exception;

/// The time between two looks for signals.
const BETWEEN_LOOKS: Duration = Duration::from_millis(50);

/// True if a signal has ended the work.
struct Interruption(AtomicBool);

impl Progress for Interruption {
    fn is_interrupted(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Runs `work` with the interpreter detached. It has a thread of its own, since Python handles signals on the calling one alone.
///
/// # Errors
/// That of `work`, or what a signal's handler raises, such as `KeyboardInterrupt`.
pub fn run<T: Send>(py: Python<'_>, work: impl FnOnce(&dyn Progress) -> multiscopic::Result<T> + Send) -> PyResult<T> {
    let interruption = Interruption(AtomicBool::new(false));
    py.detach(|| {
        thread::scope(|scope| {
            let (done, finished) = mpsc::channel::<()>();
            let interruption = &interruption;
            let worker = scope.spawn(move || {
                // Dropped at the end, even by a panic: then the receiver wakes up.
                let _done = done;
                work(interruption)
            });
            let mut signals = Ok(());
            while signals.is_ok() && finished.recv_timeout(BETWEEN_LOOKS) == Err(RecvTimeoutError::Timeout) {
                signals = Python::attach(|py| py.check_signals());
            }
            interruption.0.store(signals.is_err(), Ordering::Relaxed);
            let outcome = worker.join().unwrap_or_else(|panic| panic::resume_unwind(panic));
            signals?;
            outcome.map_err(exception)
        })
    })
}
