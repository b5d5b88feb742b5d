//! The crate's error type. Messages name the file, what was found, and what was expected.

mod refusal;
mod warning;

use std::{
    io,
    path::{Path, PathBuf},
};

use multiscopic_core::{Frame, ParamsError};
use multiscopic_engine::{EngineError, SimulationError};

pub use refusal::{AlignmentError, MountingError, PlaneError};
pub use warning::Warning;

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
        /// The contents that were found.
        found: String,
        /// The contents that were expected, and what to do.
        expected: String,
    },
    /// A picture or map has no pixels, or more than the reader's [`Limits`](crate::files::Limits).
    #[error(
        "{}: found a picture of {width}x{height} pixels, expected 1 to 65535 pixels on each side and at most {max_pixels} in all",
        path.display()
    )]
    PictureSize {
        /// The file.
        path: PathBuf,
        /// The width that its header gives, in pixels.
        width: u32,
        /// The height that its header gives, in pixels.
        height: u32,
        /// The most pixels that the reader accepts.
        max_pixels: u64,
    },
    /// Too few corners of the centre are found in the other views to know the range of disparities.
    #[error("too few corners of the centre are found in the other views to know the range of disparities")]
    UnknownRange,
    /// A warning that is refused where going on makes no sense.
    #[error("{0}")]
    Refused(Warning),
    /// Frames do not determine how the camera is mounted on its stage.
    #[error(transparent)]
    Mounting(#[from] MountingError),
    /// The views cannot be aligned.
    #[error(transparent)]
    Alignment(#[from] AlignmentError),
    /// Disparities determine no plane.
    #[error(transparent)]
    Plane(#[from] PlaneError),
    /// A folder that is to be written is there already.
    #[error("{} is there already and will not be replaced: give another folder, or remove it", path.display())]
    FolderExists {
        /// The folder.
        path: PathBuf,
    },
    /// A file is given for two outputs.
    #[error("{} is given for two outputs: give each its own file", path.display())]
    SharedOutput {
        /// The file.
        path: PathBuf,
    },
    /// An output would replace an input.
    #[error("the output {} would replace the input {}: give another file", output.display(), input.display())]
    OutputIsInput {
        /// The output.
        output: PathBuf,
        /// The input.
        input: PathBuf,
    },
    /// A computation takes more memory than it may.
    #[error("{task} takes about {} MB of memory, and {} MB may be taken: {advice}", needed_bytes.div_ceil(1_000_000), most_bytes / 1_000_000)]
    Memory {
        /// The computation, as in "the match".
        task: &'static str,
        /// About how many bytes it takes.
        needed_bytes: u64,
        /// The most bytes that may be taken.
        most_bytes: u64,
        /// Advice on how to take less.
        advice: &'static str,
    },
    /// A matching parameter is out of range.
    #[error(transparent)]
    BlockMatchingParams(#[from] ParamsError),
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

impl From<SimulationError> for Error {
    fn from(error: SimulationError) -> Error {
        Error::Usage(error.to_string())
    }
}

impl From<EngineError> for Error {
    fn from(error: EngineError) -> Error {
        match error {
            EngineError::BlockMatchingParams(error) => Error::BlockMatchingParams(error),
            error => Error::Engine(error),
        }
    }
}

impl Error {
    /// `path` contains `found` instead of `expected`.
    pub(crate) fn format(path: &Path, found: impl Into<String>, expected: impl Into<String>) -> Error {
        Error::Format { path: path.into(), found: found.into(), expected: expected.into() }
    }

    /// Checks that `task` may take the bytes that it needs, given the most that may be taken, if that is limited.
    pub(crate) fn check_memory(
        task: &'static str,
        needed_bytes: u64,
        most_bytes: Option<u64>,
        advice: &'static str,
    ) -> Result<()> {
        match most_bytes {
            Some(most_bytes) if needed_bytes > most_bytes => Err(Error::Memory { task, needed_bytes, most_bytes, advice }),
            _ => Ok(()),
        }
    }
}

/// The result of an operation on the host.
pub type Result<T> = std::result::Result<T, Error>;
