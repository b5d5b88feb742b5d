//! Errors of the library as Python's exceptions, with the same text.

use std::io;

use multiscopic::Error;
use pyo3::{
    PyErr,
    exceptions::{PyRuntimeError, PyValueError},
};

/// The exception for an error: `OSError`, or the class of it that fits, for files that cannot be read or written, and
/// `ValueError` for what is in them and for arguments.
pub fn exception(error: Error) -> PyErr {
    let text = error.to_string();
    match error {
        // Of several classes of `OSError`, that of the system's error: `FileNotFoundError`, `PermissionError` and so on.
        Error::Read { source, .. } | Error::Write { source, .. } => io::Error::new(source.kind(), text).into(),
        Error::Device(_) | Error::Capture { .. } => PyRuntimeError::new_err(text),
        _ => PyValueError::new_err(text),
    }
}
