//! The interpreter: errors as its exceptions, and long work that leaves it to other threads and ends at Ctrl-C.

use std::{
    ffi::CString,
    io, panic,
    sync::{
        atomic::{AtomicBool, Ordering},
        mpsc::{self, RecvTimeoutError},
    },
    thread,
    time::Duration,
};

use multiscopic::{Error, Progress};
use pyo3::{
    PyErr, create_exception,
    exceptions::{PyFileExistsError, PyRuntimeError, PyUserWarning, PyValueError},
    prelude::*,
};

create_exception!(
    multiscopic,
    MatchWarning,
    PyUserWarning,
    "A reason to doubt images, or the disparities that were found in them."
);

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

/// Warns the caller, as `warnings.warn` does.
///
/// # Errors
/// The warning, where the interpreter's filters turn it into an exception.
pub fn warn(py: Python<'_>, text: &str) -> PyResult<()> {
    PyErr::warn(py, &py.get_type::<MatchWarning>(), &CString::new(text)?, 1)
}

/// The exception for an error: `OSError`, or the class of it that fits, for files that cannot be read or written, and
/// `ValueError` for what is in them and for arguments.
pub fn exception(error: Error) -> PyErr {
    let text = error.to_string();
    match error {
        // Of several classes of `OSError`, that of the system's error: `FileNotFoundError`, `PermissionError` and so on.
        Error::Read { source, .. } | Error::Write { source, .. } => io::Error::new(source.kind(), text).into(),
        Error::FolderExists { .. } => PyFileExistsError::new_err(text),
        Error::Device(_) | Error::Capture { .. } => PyRuntimeError::new_err(text),
        _ => PyValueError::new_err(text),
    }
}
