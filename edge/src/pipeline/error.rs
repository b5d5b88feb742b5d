//! The errors of a pipeline.

use core::{error, fmt};
use embedded_io::ErrorType;
use multiscopic_core::{MatchError, MemoryTooSmall, ScanlineSource, network::NetworkError};

use crate::{board::Board, packet::BufferTooSmall};

/// The error that stopped a pipeline on the board `B` before its last line.
pub type RunError<B> = PipelineError<<<B as Board>::Frames as ScanlineSource>::Error, <<B as Board>::Output as ErrorType>::Error>;

/// An error that stops a pipeline before its last line. `S` is the error of the frames, `W` that of the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PipelineError<S, W> {
    /// The line of the workspace is shorter than the tile.
    Line {
        /// Columns of the tile.
        needed: usize,
        /// Columns of the workspace's line.
        given: usize,
    },
    /// There are too few sources of frames.
    Sources {
        /// Sources needed: one for each search.
        needed: usize,
        /// Sources given.
        given: usize,
    },
    /// The matcher's memory in the workspace is too small.
    Memory(MemoryTooSmall),
    /// The network is not among the methods that are run.
    Unlinked,
    /// There is no network in the memory of the workspace.
    Network(NetworkError),
    /// The frames cannot be read again.
    Rewind(S),
    /// A line could not be matched.
    Match(MatchError<S>),
    /// The packet buffer of the workspace is too small.
    Packet(BufferTooSmall),
    /// A packet could not be written.
    Write(W),
}

impl<S: fmt::Display, W: fmt::Display> fmt::Display for PipelineError<S, W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PipelineError::Line { needed, given } => write!(f, "a tile has {needed} columns, the line of the workspace {given}"),
            PipelineError::Sources { needed, given } => {
                write!(f, "the match needs {needed} sources of frames, {given} were given")
            }
            PipelineError::Memory(error) => write!(f, "{error}"),
            PipelineError::Unlinked => f.write_str("the network is not among the methods that are run"),
            PipelineError::Network(error) => write!(f, "{error}"),
            PipelineError::Rewind(error) => write!(f, "cannot rewind to the first line: {error}"),
            PipelineError::Match(error) => write!(f, "{error}"),
            PipelineError::Packet(error) => write!(f, "{error}"),
            PipelineError::Write(error) => write!(f, "cannot send a disparity line: {error}"),
        }
    }
}

impl<S: error::Error, W: error::Error> error::Error for PipelineError<S, W> {}
