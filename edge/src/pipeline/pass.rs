//! The passes over a frame: lines are fetched from the board, matched, and sent; and the errors that stop them.

use core::{error, fmt, marker::PhantomData};
use embedded_io::{ErrorType, Write};
use multiscopic_core::{
    BlockMatchingParams, ConfidenceLines, ConfidenceTable, Disparity, Frame, MatchError, Matcher, MemoryTooSmall, Params, Region,
    ScanlineSource, SearchSpace,
    kernel::{Isa, Kernel},
    network::NetworkError,
};

use crate::{
    board::{Board, Phase},
    matching::confidence_line_words,
    packet::{BufferTooSmall, Sender},
};

/// The confidences of lines, computed in memory that is lent.
pub struct Confidences<'w, I> {
    lines: ConfidenceLines<'w, I>,
    /// Those of a line.
    line: &'w mut [u8],
}

impl<'w, I: Isa> Confidences<'w, I> {
    /// Takes the first of `words`, and returns the others too.
    pub fn new(
        isa: I,
        search: &SearchSpace,
        table: &'static ConfidenceTable,
        words: &'w mut [u32],
    ) -> Result<(Confidences<'w, I>, &'w mut [u32]), MemoryTooSmall> {
        let [kept, columns] = [ConfidenceLines::memory_words(search.width()), confidence_line_words(search.width())];
        let too_small = MemoryTooSmall { needed: kept + columns, given: words.len() };
        let (own, rest) = words.split_at_mut_checked(kept + columns).ok_or(too_small)?;
        let (kept, line) = own.split_at_mut_checked(kept).ok_or(too_small)?;
        let line = bytemuck::cast_slice_mut(line).get_mut(..search.width()).ok_or(too_small)?;
        Ok((Confidences { lines: ConfidenceLines::with_isa(isa, search, table, kept)?, line }, rest))
    }
}

/// A pass over a part of the frame, which sends its lines.
pub struct Pass<'a, 'w, B: Board> {
    tile: &'a Region,
    line: &'a mut [Option<Disparity>],
    sender: &'a mut Sender<'w>,
    output: &'a mut B::Output,
}

impl<'a, 'w, B: Board> Pass<'a, 'w, B> {
    /// A pass over `tile`, with a line of the workspace for its disparities.
    pub fn new(
        tile: &'a Region,
        line: &'a mut [Option<Disparity>],
        sender: &'a mut Sender<'w>,
        output: &'a mut B::Output,
    ) -> Result<Pass<'a, 'w, B>, RunError<B>> {
        let (needed, given) = (tile.width(), line.len());
        let line = line.get_mut(..needed).ok_or(PipelineError::Line { needed, given })?;
        B::enter(Phase::Matching);
        Ok(Pass { tile, line, sender, output })
    }

    /// Sends every line that `next_line` computes.
    #[inline(always)]
    pub fn send(
        self,
        mut next_line: impl FnMut(&mut [Option<Disparity>]) -> Result<Option<usize>, FetchError<B>>,
    ) -> Result<(), RunError<B>> {
        let Pass { tile, line, sender, output } = self;
        while let Some(v) = next_line(line).map_err(PipelineError::Match)? {
            B::enter(Phase::Sending);
            let packet = sender.line(tile, v, line).map_err(PipelineError::Packet)?;
            output.write_all(packet).map_err(PipelineError::Write)?;
            B::enter(Phase::Matching);
        }
        B::enter(Phase::Idle);
        Ok(())
    }

    /// Sends every line, with its confidences, of a result.
    pub fn send_result<L: Iterator<Item = (Option<Disparity>, u8)>>(
        self,
        confidences: &mut [u8],
        of_line: impl Fn(usize) -> L,
    ) -> Result<(), RunError<B>> {
        let Pass { tile, line, sender, output } = self;
        B::enter(Phase::Sending);
        for v in 0..tile.height() {
            for ((disparity, confidence), found) in line.iter_mut().zip(&mut *confidences).zip(of_line(v)) {
                (*disparity, *confidence) = found;
            }
            let packet = sender.line_with_confidences(tile, v, line, confidences).map_err(PipelineError::Packet)?;
            output.write_all(packet).map_err(PipelineError::Write)?;
        }
        B::enter(Phase::Idle);
        Ok(())
    }

    /// Sends every line with its confidences. `matched` computes the lines of disparities and peak ratios.
    #[inline(always)]
    pub fn send_with_confidences(
        self,
        mut confidences: Confidences<'_, impl Isa>,
        mut matched: impl FnMut(&mut [Option<Disparity>], &mut [u8]) -> Result<Option<usize>, FetchError<B>>,
    ) -> Result<(), RunError<B>> {
        let Pass { tile, line, sender, output } = self;
        while let Some(v) = confidences.lines.next_line(&mut matched, line, confidences.line).map_err(PipelineError::Match)? {
            B::enter(Phase::Sending);
            let packet = sender.line_with_confidences(tile, v, line, confidences.line).map_err(PipelineError::Packet)?;
            output.write_all(packet).map_err(PipelineError::Write)?;
            B::enter(Phase::Matching);
        }
        B::enter(Phase::Idle);
        Ok(())
    }
}

/// The error of a line that could not be matched on the board `B`.
pub type FetchError<B> = MatchError<<<B as Board>::Frames as ScanlineSource>::Error>;

/// A board's frames. Reading them is a phase of its own.
pub struct Fetching<'a, B: Board> {
    source: &'a mut B::Frames,
    board: PhantomData<B>,
}

impl<'a, B: Board> Fetching<'a, B> {
    pub fn new(source: &'a mut B::Frames) -> Self {
        Fetching { source, board: PhantomData }
    }
}

impl<B: Board> ScanlineSource for Fetching<'_, B> {
    type Error = <B::Frames as ScanlineSource>::Error;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        B::enter(Phase::Fetching);
        let result = self.source.read_line(frame, v, line);
        B::enter(Phase::Matching);
        result
    }
}

/// The frames of a long match, whose prior is a short match of other frames of the board.
pub struct LongFrames<'a, 'm, B: Board, I, P> {
    /// The frames of the long match.
    pub frames: &'a mut B::Frames,
    /// The short match.
    pub short: Matcher<'m, I, P>,
    /// The frames of the short match.
    pub short_frames: &'a mut B::Frames,
}

impl<B: Board, I: Kernel, P: Params<BlockMatchingParams>> ScanlineSource for LongFrames<'_, '_, B, I, P> {
    type Error = FetchError<B>;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        Fetching::<B>::new(self.frames).read_line(frame, v, line).map_err(MatchError::Source)
    }

    /// Matches the next line: the prior's lines are read in order, each once.
    #[inline(always)]
    fn read_prior(&mut self, _: usize, line: &mut [Option<Disparity>]) -> Result<(), Self::Error> {
        self.short.next_line(&mut Fetching::<B>::new(self.short_frames), line).map(drop)
    }
}

/// The error that stopped a pipeline on the board `B` before its last line.
pub type RunError<B> = PipelineError<<<B as Board>::Frames as ScanlineSource>::Error, <<B as Board>::Output as ErrorType>::Error>;

/// An error that stops a pipeline before its last line. `S` is the error of the frames, `W` that of the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
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
