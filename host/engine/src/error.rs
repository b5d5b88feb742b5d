//! Reasons why frames cannot be matched.

use multiscopic_core::{Frame, ParamsError, network::WeightError};

/// The reason why frames cannot be matched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EngineError {
    /// More threads were asked for than an engine may have.
    #[error("{given} threads are too many, at most {most}: 0 is one for each core")]
    TooManyThreads {
        /// The number that was asked for.
        given: usize,
        /// The most that there may be.
        most: usize,
    },
    /// The system refused to start threads.
    #[error("cannot start {threads} threads: {source}")]
    Threads {
        /// The number that was asked for.
        threads: usize,
        /// The refusal.
        source: rayon::ThreadPoolBuildError,
    },
    /// The frames have another size than the search.
    #[error("the frames have {}x{} pixels, the search is for {}x{}", frames[0], frames[1], search[0], search[1])]
    FrameSize {
        /// The width and height of the frames.
        frames: [usize; 2],
        /// Those of the search.
        search: [usize; 2],
    },
    /// A frame of the search is missing.
    #[error("the search is in the {0} view, which is missing")]
    MissingFrame(Frame),
    /// The prior has another size than the frames.
    #[error("the prior has {}x{} pixels, the frames have {}x{}", prior[0], prior[1], frames[0], frames[1])]
    PriorSize {
        /// The width and height of the prior.
        prior: [usize; 2],
        /// Those of the frames.
        frames: [usize; 2],
    },
    /// A matching parameter is out of range.
    #[error(transparent)]
    BlockMatchingParams(#[from] ParamsError),
    /// A file has the weights of another network.
    #[error("{0}")]
    Weights(WeightError),
}
