//! Scanlines from byte streams: files, and what cannot be rewound, such as UARTs.

use core::{error, fmt};
use embedded_io::{Read, ReadExactError, Seek};
use multiscopic_core::{Frame, Rewind, ScanlineSource, View, Views};

/// A stream for each frame, which gives the frame's lines from top to bottom, one byte a pixel.
///
/// ```
/// use multiscopic_core::{Frame, ScanlineSource, Views};
/// use multiscopic_edge::Streams;
///
/// // Files, ports, or bytes in memory: two lines of three pixels each.
/// let pixels = |frame| Ok::<&[u8], ()>(if frame == Frame::Center { &[1, 2, 3, 4, 5, 6] } else { &[7, 7, 7, 8, 8, 8] });
/// let mut streams = Streams::open(Views::HORIZONTAL, pixels).unwrap();
/// let mut line = [0; 3];
/// streams.read_line(Frame::Center, 0, &mut line).unwrap();
/// assert_eq!(line, [1, 2, 3]);
/// ```
pub struct Streams<R> {
    center: FrameStream<R>,
    views: [Option<(View, FrameStream<R>)>; Views::MAX_MATCHED],
}

impl<R> Streams<R> {
    /// Opens a stream for the centre and for each of `views`.
    ///
    /// # Errors
    /// The first error that `open` returns.
    pub fn open<E>(views: Views, mut open: impl FnMut(Frame) -> Result<R, E>) -> Result<Streams<R>, E> {
        let mut streams = Streams { center: FrameStream::new(open(Frame::Center)?), views: [const { None }; Views::MAX_MATCHED] };
        for (stream, view) in streams.views.iter_mut().zip(views.iter()) {
            *stream = Some((view, FrameStream::new(open(Frame::View(view))?)));
        }
        Ok(streams)
    }

    /// The stream of `frame`, whose next line has to be `v`.
    pub(crate) fn at_line<E>(&mut self, frame: Frame, v: usize) -> Result<&mut FrameStream<R>, StreamsError<E>> {
        let stream = self.get_mut(frame).ok_or(StreamsError::NoStream { frame })?;
        if v != stream.next {
            return Err(StreamsError::OutOfOrder { frame, next: stream.next, requested: v });
        }
        Ok(stream)
    }

    fn get_mut(&mut self, frame: Frame) -> Option<&mut FrameStream<R>> {
        match frame {
            Frame::Center => Some(&mut self.center),
            Frame::View(view) => {
                let mut streams = self.views.iter_mut().flatten();
                streams.find_map(|(of_view, stream)| (*of_view == view).then_some(stream))
            }
        }
    }
}

impl<R: Read> ScanlineSource for Streams<R> {
    type Error = StreamsError<R::Error>;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        let stream = self.at_line(frame, v)?;
        let read = stream.reader.read_exact(line);
        stream.finish_line(frame, read)
    }
}

/// For matching in column tiles, which reads every frame once for each tile.
impl<R: Read + Seek> Rewind for Streams<R> {
    fn rewind(&mut self) -> Result<(), Self::Error> {
        let views = self.views.iter_mut().flatten().map(|(view, stream)| (Frame::View(*view), stream));
        for (frame, stream) in [(Frame::Center, &mut self.center)].into_iter().chain(views) {
            stream.reader.rewind().map_err(|error| StreamsError::Rewind { frame, error })?;
            stream.next = 0;
        }
        Ok(())
    }
}

/// The stream of a frame, and the number of its next line.
pub(crate) struct FrameStream<R> {
    pub reader: R,
    next: usize,
}

impl<R> FrameStream<R> {
    const fn new(reader: R) -> FrameStream<R> {
        FrameStream { reader, next: 0 }
    }

    /// Goes on to the next line if this one has been read.
    pub fn finish_line<E>(&mut self, frame: Frame, read: Result<(), ReadExactError<E>>) -> Result<(), StreamsError<E>> {
        let line = self.next;
        read.map_err(|error| match error {
            ReadExactError::UnexpectedEof => StreamsError::Ended { frame, line },
            ReadExactError::Other(error) => StreamsError::Read { frame, line, error },
        })?;
        self.next += 1;
        Ok(())
    }
}

/// An error of a line that cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum StreamsError<E> {
    /// The frame was not opened.
    NoStream {
        /// The frame.
        frame: Frame,
    },
    /// The requested line is not the next one.
    OutOfOrder {
        /// The frame.
        frame: Frame,
        /// The next line of the stream.
        next: usize,
        /// The requested line.
        requested: usize,
    },
    /// The stream ended within the line.
    Ended {
        /// The frame.
        frame: Frame,
        /// The line.
        line: usize,
    },
    /// The stream failed.
    Read {
        /// The frame.
        frame: Frame,
        /// The line.
        line: usize,
        /// The stream's error.
        error: E,
    },
    /// The stream cannot be rewound.
    Rewind {
        /// The frame.
        frame: Frame,
        /// The stream's error.
        error: E,
    },
}

impl<E: fmt::Display> fmt::Display for StreamsError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StreamsError::NoStream { frame } => write!(f, "frame {frame:?} has no stream"),
            StreamsError::OutOfOrder { frame, next, requested } => {
                write!(f, "line {requested} of frame {frame:?} was requested, but line {next} is next")
            }
            StreamsError::Ended { frame, line } => write!(f, "frame {frame:?} ended in line {line}"),
            StreamsError::Read { frame, line, error } => write!(f, "cannot read line {line} of frame {frame:?}: {error}"),
            StreamsError::Rewind { frame, error } => write!(f, "cannot rewind frame {frame:?}: {error}"),
        }
    }
}

impl<E: error::Error + 'static> error::Error for StreamsError<E> {
    fn source(&self) -> Option<&(dyn error::Error + 'static)> {
        match self {
            StreamsError::Read { error, .. } | StreamsError::Rewind { error, .. } => Some(error),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LEFT: Frame = Frame::View(View::LEFT);

    /// Lines of three pixels: two of the centre, one of the left view.
    fn streams() -> Streams<&'static [u8]> {
        let pixels = |frame| if frame == Frame::Center { &[1, 2, 3, 4, 5, 6][..] } else { &[7, 8, 9][..] };
        Streams::open(Views::NONE.with(View::LEFT), |frame| Ok::<_, ()>(pixels(frame))).unwrap()
    }

    #[test]
    fn reads_of_several_frames_interleave() {
        let (mut streams, mut line) = (streams(), [0; 3]);
        for (frame, v, pixels) in [(Frame::Center, 0, [1, 2, 3]), (LEFT, 0, [7, 8, 9]), (Frame::Center, 1, [4, 5, 6])] {
            streams.read_line(frame, v, &mut line).unwrap();
            assert_eq!(line, pixels);
        }
    }

    #[test]
    fn a_line_out_of_order_is_refused() {
        let error = streams().read_line(LEFT, 1, &mut [0; 3]);
        assert_eq!(error, Err(StreamsError::OutOfOrder { frame: LEFT, next: 0, requested: 1 }));
    }

    #[test]
    fn a_short_stream_and_a_missing_one_have_errors_of_their_own() {
        assert_eq!(streams().read_line(LEFT, 0, &mut [0; 4]), Err(StreamsError::Ended { frame: LEFT, line: 0 }));
        let top = Frame::View(View::TOP);
        assert_eq!(streams().read_line(top, 0, &mut [0; 3]), Err(StreamsError::NoStream { frame: top }));
    }
}
