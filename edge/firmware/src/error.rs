//! Why the firmware failed.

use core::{ffi::CStr, fmt};
use multiscopic_edge::{PipelineError, StreamsError, packet::BufferTooSmall};

use crate::host_file::HostError;

/// Why the firmware failed.
pub enum FirmwareError {
    /// The host does not give the command line.
    CommandLine(HostError),
    /// The argument is not the name of a fusion.
    Fusion,
    /// The arguments are not those of a calibration.
    Calibration,
    /// A file could not be opened.
    File(&'static CStr, HostError),
    /// A frame has the wrong size.
    Size {
        /// Its file.
        path: &'static CStr,
        /// Its size in bytes.
        found: u64,
        /// The size that the profile needs.
        expected: u64,
    },
    /// A line could not be read, matched or sent.
    Pipeline(PipelineError<StreamsError<HostError>, HostError>),
    /// The last packet could not be encoded.
    Packet(BufferTooSmall),
}

impl fmt::Display for FirmwareError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |path: &'static CStr| path.to_str().unwrap_or("a file");
        match self {
            FirmwareError::CommandLine(error) => write!(f, "cannot read the command line: {error}"),
            FirmwareError::Fusion => write!(f, "start it with one word: min, mean or heuristic"),
            FirmwareError::Calibration => write!(
                f,
                "start it with: width, height, views (1 to 4), smallest disparity, disparities, block size, fusion, columns of a tile, bm or sgm"
            ),
            FirmwareError::File(path, error) => write!(f, "cannot open {}: {error}", name(path)),
            FirmwareError::Size { path, found, expected } => {
                write!(f, "{} has {found} bytes, a frame of this profile has {expected}", name(path))
            }
            FirmwareError::Pipeline(error) => write!(f, "{error}"),
            FirmwareError::Packet(error) => write!(f, "{error}"),
        }
    }
}
