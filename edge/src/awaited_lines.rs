//! Lines that are awaited: a matcher asks for them, and is asked again when they are there.

use core::{error, fmt, future::Future};
use embedded_io_async::Read;
use multiscopic_core::{Frame, MatchError, ScanlineSource};

use crate::streams::{Streams, StreamsError};

/// A source of scanlines that are not there yet, such as a camera, a UART or a socket with an asynchronous driver: the
/// [`ScanlineSource`] of those who await.
///
/// [`Streams`] of [`embedded_io_async::Read`] are one. [`AwaitedLines`] brings the lines to a matcher.
pub trait AsyncScanlineSource {
    /// The reason why a line could not be read.
    type Error;

    /// Fills `line`, whose length is the width of the frame, with the 8-bit grey pixels of line `v` of `frame`. Lines are read as
    /// those of a [`ScanlineSource`] are: every line of each frame once, in ascending order. Implement it as an `async fn`.
    ///
    /// # Errors
    /// The source's own. The matcher's caller gets it, and the same line is read when the matcher is called again.
    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> impl Future<Output = Result<(), Self::Error>>;
}

impl<R: Read> AsyncScanlineSource for Streams<R> {
    type Error = StreamsError<R::Error>;

    async fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        let stream = self.at_line(frame, v)?;
        let read = stream.reader.read_exact(line).await;
        stream.finish_line(frame, read)
    }
}

/// The lines of an [`AsyncScanlineSource`] for a matcher, which does not await.
///
/// It holds one line. Where a matcher needs another, it stops without losing anything, the line is awaited, and the matcher
/// goes on. While a line is awaited, the executor runs other tasks; while one is matched, it does not. Disparities are those
/// of the same lines from a [`ScanlineSource`], bit for bit.
///
/// ```
/// use embedded_io_async::{Read, Write};
/// use multiscopic_core::{BlockMatchingParams, Fusion, Matcher, SearchConfig, Views, params};
/// use multiscopic_edge::{AwaitedLines, Streams, packet};
///
/// const WIDTH: usize = 96;
/// const SIZE: SearchConfig = SearchConfig::of_size(WIDTH as u16, 64);
/// const SEARCH: SearchConfig = SearchConfig { views: Views::HORIZONTAL, fusion: Fusion::Min, num_disparities: 16, ..SIZE };
/// params!(Match: BlockMatchingParams = SEARCH.block_matching(7));
///
/// /// Reads a frame from each of the streams, and sends its disparities as they become known.
/// async fn send_disparities<R: Read, W: Write>(frames: Streams<R>, output: &mut W, memory: &mut [u32]) -> Option<()> {
///     let (mut held, mut packet) = ([0; WIDTH], [0; packet::buffer_bytes(WIDTH)]);
///     let mut lines = AwaitedLines::new(frames, &mut held);
///     let mut matcher = Matcher::new(&Match, memory).ok()?;
///     let mut sender = packet::Sender::new(Match::PARAMS.search(), &mut packet);
///     let mut disparities = [None; WIDTH];
///     while let Some(v) = lines.bring_to(|lines| matcher.next_line(lines, &mut disparities)).await.ok()? {
///         output.write_all(sender.line(matcher.region(), v, &disparities).ok()?).await.ok()?;
///     }
///     output.write_all(sender.end(None).ok()?).await.ok()
/// }
///
/// // In firmware: three UARTs, files or sockets, a static for the memory, and an executor.
/// let frames = Streams::open(SEARCH.views, |_| Ok::<_, ()>(&[7; WIDTH * 64][..])).unwrap();
/// let mut memory = [0; Match::PARAMS.memory_words()];
/// let mut sent = [0; 20_000];
/// embassy_futures::block_on(send_disparities(frames, &mut &mut sent[..], &mut memory)).unwrap();
/// assert_eq!(sent.split(|&byte| byte == 0).filter(|packet| !packet.is_empty()).count(), 65);
/// ```
///
/// With confidences, or around a prior, the closure calls all matchers of the line.
#[derive(Debug)]
pub struct AwaitedLines<'b, S> {
    source: S,
    line: &'b mut [u8],
    /// The line held, until the matcher takes it.
    held: Option<(Frame, usize)>,
}

impl<'b, S: AsyncScanlineSource> AwaitedLines<'b, S> {
    /// The lines of `source`. `line`, whose length is the width of the frames, will hold one.
    pub fn new(source: S, line: &'b mut [u8]) -> AwaitedLines<'b, S> {
        AwaitedLines { source, line, held: None }
    }

    /// Calls `next`, which computes a disparity line from these lines, until all that it needs have been there. It gives what
    /// [`Matcher::next_line`](multiscopic_core::Matcher::next_line) or
    /// [`SemiGlobalMatcher::next_line`](multiscopic_core::SemiGlobalMatcher::next_line) gives.
    ///
    /// If the future is dropped, so is that of the source: all is as before if the source loses no bytes then.
    ///
    /// # Errors
    /// Those of `next` and of the source. No line is lost, and the call can be repeated.
    pub async fn bring_to<T>(
        &mut self,
        mut next: impl FnMut(&mut Self) -> Result<T, MatchError<AwaitedLineError<S::Error>>>,
    ) -> Result<T, MatchError<AwaitedLineError<S::Error>>> {
        loop {
            match next(self) {
                Err(MatchError::Source(AwaitedLineError::NotHeld { frame, line })) => {
                    let read = self.source.read_line(frame, line, self.line).await;
                    read.map_err(|error| MatchError::Source(AwaitedLineError::Read(error)))?;
                    self.held = Some((frame, line));
                }
                end => return end,
            }
        }
    }
}

impl<S: AsyncScanlineSource> ScanlineSource for AwaitedLines<'_, S> {
    type Error = AwaitedLineError<S::Error>;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        if line.len() != self.line.len() {
            return Err(AwaitedLineError::Width { needed: line.len(), given: self.line.len() });
        }
        // Another line may be held if an earlier call ended early: it is read again when it is needed.
        self.held.take_if(|held| *held == (frame, v)).ok_or(AwaitedLineError::NotHeld { frame, line: v })?;
        line.copy_from_slice(self.line);
        Ok(())
    }
}

/// The reason why a matcher has no line of [`AwaitedLines`]. `E` is the error of the source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum AwaitedLineError<E> {
    /// The line has to be awaited, which [`AwaitedLines::bring_to`] does.
    NotHeld {
        /// The frame.
        frame: Frame,
        /// The line.
        line: usize,
    },
    /// The slice that holds a line has the wrong length.
    Width {
        /// Pixels needed: the width of the frame.
        needed: usize,
        /// Pixels given.
        given: usize,
    },
    /// The source failed.
    Read(E),
}

impl<E: fmt::Display> fmt::Display for AwaitedLineError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            AwaitedLineError::NotHeld { frame, line } => write!(f, "line {line} of frame {frame:?} has to be awaited"),
            AwaitedLineError::Width { needed, given } => write!(f, "a line has {needed} pixels, {given} can be held"),
            AwaitedLineError::Read(error) => write!(f, "{error}"),
        }
    }
}

impl<E: error::Error> error::Error for AwaitedLineError<E> {}
