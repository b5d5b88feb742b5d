//! The crate's error type. Messages name the file, what was found, and what was expected.

use std::{
    io,
    path::{Path, PathBuf},
};

use multiscopic_core::{Frame, ParamsError};
use multiscopic_engine::EngineError;

/// Bad input, bad usage, a failed device, or a file that could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be opened or read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A file could not be written. Any previous version of it is unchanged.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A file has the wrong contents.
    #[error("{}: found {found}, expected {expected}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What the file contains.
        found: String,
        /// What it should contain, and what to do.
        expected: String,
    },
    /// A matching parameter is out of range.
    #[error(transparent)]
    Params(#[from] ParamsError),
    /// The engine refuses the frames or its threads.
    #[error(transparent)]
    Engine(EngineError),
    /// A stage or a camera failed. It holds a [`StageError`](crate::capture::stage::StageError) or the
    /// camera's error.
    #[error(transparent)]
    Device(Box<dyn std::error::Error + Send + Sync>),
    /// A capture failed. The stage has stopped.
    #[error("{}{source}", frame.map_or(String::new(), |frame| format!("{frame} frame: ")))]
    Capture {
        /// The frame that was being captured, if any.
        frame: Option<Frame>,
        /// The cause.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The request makes no sense, or cannot be met: the message says what to change.
    #[error("{0}")]
    Usage(String),
}

impl From<EngineError> for Error {
    fn from(error: EngineError) -> Error {
        match error {
            EngineError::Params(error) => Error::Params(error),
            error => Error::Engine(error),
        }
    }
}

impl Error {
    /// `path` contains `found` instead of `expected`.
    pub(crate) fn format(path: &Path, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::Format { path: path.into(), found: found.into(), expected: expected.into() }
    }

    /// Checks that `what` may take the bytes `needed`, given the most that may be taken, if that is limited.
    pub(crate) fn check_memory(what: &str, needed: u64, most: Option<u64>, advice: &str) -> Result<()> {
        match most {
            Some(most) if needed > most => {
                let [needed, most] = [needed.div_ceil(1_000_000), most / 1_000_000];
                let taken = format!("{what} takes about {needed} MB of memory, and {most} MB may be taken");
                Err(Error::Usage(format!("{taken}: {advice}")))
            }
            _ => Ok(()),
        }
    }
}

/// The result of an operation on the host.
pub type Result<T> = std::result::Result<T, Error>;
