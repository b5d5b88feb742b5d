//! Scanlines from streams: files, and what cannot go back, such as UARTs and sensors.

use core::{error, fmt};
use embedded_io::{Read, ReadExactError, Seek};
use multiscopic_core::{Frame, Rewind, ScanlineSource, View, Views};

/// One stream per frame, which brings the frame's lines from top to bottom.
pub struct Streams<R> {
    center: Stream<R>,
    views: [Option<Stream<R>>; View::ALL.len()],
}

impl<R: Read> Streams<R> {
    /// Opens a stream for the centre and for each of `views`.
    ///
    /// # Errors
    /// The first that `open` returns.
    pub fn open<E>(views: Views, mut open: impl FnMut(Frame) -> Result<R, E>) -> Result<Streams<R>, E> {
        let mut streams = Streams { center: Stream::new(open(Frame::Center)?), views: [const { None }; View::ALL.len()] };
        for view in views.iter() {
            streams.views[view as usize] = Some(Stream::new(open(Frame::View(view))?));
        }
        Ok(streams)
    }

    fn of(&mut self, frame: Frame) -> Option<&mut Stream<R>> {
        match frame {
            Frame::Center => Some(&mut self.center),
            Frame::View(view) => self.views[view as usize].as_mut(),
        }
    }
}

impl<R: Read> ScanlineSource for Streams<R> {
    type Error = StreamsError<R::Error>;

    fn read_line(&mut self, frame: Frame, v: usize, line: &mut [u8]) -> Result<(), Self::Error> {
        let stream = self.of(frame).ok_or(StreamsError::NoStream { frame })?;
        if v != stream.next {
            return Err(StreamsError::OutOfOrder { frame, next: stream.next, asked: v });
        }
        stream.reader.read_exact(line).map_err(|error| match error {
            ReadExactError::UnexpectedEof => StreamsError::Ended { frame, line: v },
            ReadExactError::Other(error) => StreamsError::Read { frame, line: v, error },
        })?;
        stream.next += 1;
        Ok(())
    }
}

/// Streams that can go back, for matching in column tiles.
impl<R: Read + Seek> Rewind for Streams<R> {
    fn rewind(&mut self) -> Result<(), Self::Error> {
        let views = View::ALL.map(Frame::View).into_iter().zip(self.views.iter_mut().map(Option::as_mut));
        let views = views.filter_map(|(frame, stream)| Some((frame, stream?)));
        for (frame, stream) in [(Frame::Center, &mut self.center)].into_iter().chain(views) {
            stream.reader.rewind().map_err(|error| StreamsError::Rewind { frame, error })?;
            stream.next = 0;
        }
        Ok(())
    }
}

/// A stream and the line it brings next.
struct Stream<R> {
    reader: R,
    next: usize,
}

impl<R> Stream<R> {
    const fn new(reader: R) -> Stream<R> {
        Stream { reader, next: 0 }
    }
}

/// Why a line did not come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StreamsError<E> {
    /// The frame is not one of those that were opened.
    NoStream {
        /// The frame.
        frame: Frame,
    },
    /// A line was asked for that is not the next one.
    OutOfOrder {
        /// The frame.
        frame: Frame,
        /// The line that the stream brings next.
        next: usize,
        /// The line that was asked for.
        asked: usize,
    },
    /// The stream ended before the line did.
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
        /// What the stream says.
        error: E,
    },
    /// The stream does not go back.
    Rewind {
        /// The frame.
        frame: Frame,
        /// What the stream says.
        error: E,
    },
}

impl<E: fmt::Display> fmt::Display for StreamsError<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StreamsError::NoStream { frame } => write!(f, "there is no stream of frame {frame:?}"),
            StreamsError::OutOfOrder { frame, next, asked } => {
                write!(f, "line {asked} of frame {frame:?} was asked for, but line {next} comes next")
            }
            StreamsError::Ended { frame, line } => write!(f, "frame {frame:?} ended in line {line}"),
            StreamsError::Read { frame, line, error } => write!(f, "cannot read line {line} of frame {frame:?}: {error}"),
            StreamsError::Rewind { frame, error } => write!(f, "cannot go back to the first line of frame {frame:?}: {error}"),
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

    const LEFT: Frame = Frame::View(View::Left);

    /// Two lines of three pixels of the centre, one of the left view.
    fn streams() -> Streams<&'static [u8]> {
        let pixels = |frame| if frame == Frame::Center { &[1, 2, 3, 4, 5, 6][..] } else { &[7, 8, 9][..] };
        Streams::open(Views::NONE.with(View::Left), |frame| Ok::<_, ()>(pixels(frame))).unwrap()
    }

    #[test]
    fn lines_of_frames_interleave() {
        let (mut streams, mut line) = (streams(), [0; 3]);
        for (frame, v, pixels) in [(Frame::Center, 0, [1, 2, 3]), (LEFT, 0, [7, 8, 9]), (Frame::Center, 1, [4, 5, 6])] {
            streams.read_line(frame, v, &mut line).unwrap();
            assert_eq!(line, pixels);
        }
    }

    #[test]
    fn a_line_that_is_not_next_is_refused() {
        let error = streams().read_line(LEFT, 1, &mut [0; 3]);
        assert_eq!(error, Err(StreamsError::OutOfOrder { frame: LEFT, next: 0, asked: 1 }));
    }

    #[test]
    fn an_end_and_a_missing_stream_have_names() {
        assert_eq!(streams().read_line(LEFT, 0, &mut [0; 4]), Err(StreamsError::Ended { frame: LEFT, line: 0 }));
        let top = Frame::View(View::Top);
        assert_eq!(streams().read_line(top, 0, &mut [0; 3]), Err(StreamsError::NoStream { frame: top }));
    }
}
