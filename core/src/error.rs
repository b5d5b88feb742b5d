//! The errors of matching.

use core::{error, fmt};

/// The memory lent to a matcher, or to a rectified source, is too small.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MemoryTooSmall {
    /// Words of 32 bits needed.
    pub needed: usize,
    /// Words of 32 bits given.
    pub given: usize,
}

impl fmt::Display for MemoryTooSmall {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} words of memory are needed, {} were given", self.needed, self.given)
    }
}

impl error::Error for MemoryTooSmall {}

/// The reason why a disparity line could not be computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum MatchError<E> {
    /// The source failed.
    Source(E),
    /// The slice for the disparity line has the wrong length.
    OutputLength {
        /// Pixels needed: the region's width.
        needed: usize,
        /// Pixels given.
        given: usize,
    },
}

impl<E> MatchError<MatchError<E>> {
    /// The same error, where the source of a match is another match.
    pub fn flatten(self) -> MatchError<E> {
        match self {
            MatchError::Source(error) => error,
            MatchError::OutputLength { needed, given } => MatchError::OutputLength { needed, given },
        }
    }
}

impl<E: fmt::Display> fmt::Display for MatchError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MatchError::Source(error) => write!(f, "cannot read a line: {error}"),
            MatchError::OutputLength { needed, given } => write!(f, "a disparity line has {needed} pixels, {given} were given"),
        }
    }
}

impl<E: error::Error> error::Error for MatchError<E> {}
