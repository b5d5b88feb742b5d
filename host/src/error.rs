//! What can go wrong on the host, in words that name the file, what was found and what was expected.

use std::{
    io,
    path::{Path, PathBuf},
};

use multiscopic_core::{Frame, ParamsError};

/// An error of the host: bad input, bad usage, or a file that could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be opened or read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file could not be written. What was there before is still there.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file's contents are not what they should be.
    #[error("{}: found {found}, expected {expected}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is there.
        found: String,
        /// What should be there, and what to do.
        expected: String,
    },
    /// The parameters are out of range.
    #[error(transparent)]
    Params(#[from] ParamsError),
    /// A stage or a camera failed: see [`StageError`](crate::capture::stage::StageError) and the camera's error, which are the source.
    #[error(transparent)]
    Device(Box<dyn std::error::Error + Send + Sync>),
    /// A capture failed. Nothing moves any more.
    #[error("{}{source}", frame.map_or(String::new(), |frame| format!("{} frame: ", frame.name())))]
    Capture {
        /// The frame with which it did, if it was with one.
        frame: Option<Frame>,
        /// Why.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The command line asks for something that cannot be.
    #[error("{0}")]
    Usage(String),
}

impl Error {
    /// The contents of `path` are `found` where `expected` should be.
    pub(crate) fn format(path: &Path, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::Format { path: path.into(), found: found.into(), expected: expected.into() }
    }
}

/// The result of an operation on the host.
pub type Result<T> = std::result::Result<T, Error>;
