//! Lines of text over a stream of bytes whose reads return after a short while: a serial port, or the pipes of a command.

use std::{
    io::{self, Read, Write},
    sync::Arc,
    time::{Duration, Instant},
};

use super::Clock;

/// Longer than any line that is expected.
const MAX_LINE_BYTES: usize = 1024;

/// The errors of a read that has brought nothing, though the stream works.
const NOTHING_YET: [io::ErrorKind; 3] = [io::ErrorKind::TimedOut, io::ErrorKind::WouldBlock, io::ErrorKind::Interrupted];

/// Sends and receives lines.
pub(super) struct Lines<S> {
    stream: S,
    clock: Arc<dyn Clock>,
    bytes: Vec<u8>,
}

/// The reason why no line can come.
#[derive(Debug)]
pub(super) enum LineFault {
    /// The stream has ended.
    Ended(io::Error),
    /// So many bytes came without an end of line.
    TooLong(usize),
}

impl<S: Read + Write> Lines<S> {
    /// Lines over `stream`, whose reads must return after a short while of the time of `clock`.
    pub fn new(stream: S, clock: Arc<dyn Clock>) -> Lines<S> {
        Lines { stream, clock, bytes: Vec::new() }
    }

    /// The current time.
    pub fn now(&self) -> Instant {
        self.clock.now()
    }

    /// Waits for this long.
    pub fn wait(&self, duration: Duration) {
        self.clock.sleep(duration);
    }

    /// Sends bytes. They are not flushed: flushing may block without limit.
    pub fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.stream.write_all(bytes)
    }

    /// The next line that is not empty, without the blanks around it. `None` if there is none until `deadline`; a line that is
    /// already there, or comes with one read, is returned even after it.
    pub fn next(&mut self, deadline: Instant) -> Result<Option<String>, LineFault> {
        let mut has_read = false;
        loop {
            if let Some(line) = self.take_line() {
                return Ok(Some(line));
            }
            if self.bytes.len() > MAX_LINE_BYTES {
                return Err(LineFault::TooLong(self.bytes.len()));
            }
            // Also while bytes arrive: they may never make a line.
            if has_read && self.now() >= deadline {
                return Ok(None);
            }
            let mut chunk = [0; 256];
            match self.stream.read(&mut chunk) {
                Ok(0) => return Err(LineFault::Ended(io::ErrorKind::UnexpectedEof.into())),
                Ok(length) => self.bytes.extend_from_slice(&chunk[..length]),
                Err(error) if NOTHING_YET.contains(&error.kind()) => {}
                Err(source) => return Err(LineFault::Ended(source)),
            }
            has_read = true;
        }
    }

    /// Takes the first line that has arrived and is not empty.
    fn take_line(&mut self) -> Option<String> {
        while let Some(end) = self.bytes.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = self.bytes.drain(..=end).collect();
            let line = String::from_utf8_lossy(&line);
            if !line.trim().is_empty() {
                return Some(line.trim().to_owned());
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use super::*;
    use crate::capture::SystemClock;

    /// Chunks to be read; `None` for a read that times out.
    struct Port(VecDeque<Option<&'static [u8]>>);

    impl Read for Port {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            match self.0.pop_front() {
                Some(Some(bytes)) => {
                    buffer[..bytes.len()].copy_from_slice(bytes);
                    Ok(bytes.len())
                }
                Some(None) => Err(io::ErrorKind::TimedOut.into()),
                None => Ok(0),
            }
        }
    }

    impl Write for Port {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn line_port(chunks: impl IntoIterator<Item = Option<&'static [u8]>>) -> Lines<Port> {
        Lines::new(Port(chunks.into_iter().collect()), Arc::new(SystemClock))
    }

    #[test]
    fn lines_are_assembled_from_chunks() {
        let mut port = line_port([Some(&b"\r\no"[..]), None, Some(b"k\r\nerr"), Some(b"or:9\n\xff"), None]);
        let now = Instant::now();
        let later = now + Duration::from_secs(60);
        assert_eq!(port.next(now).unwrap(), None);
        assert_eq!(port.next(later).unwrap().as_deref(), Some("ok"));
        assert_eq!(port.next(later).unwrap().as_deref(), Some("error:9"));
        assert_eq!(port.next(now).unwrap(), None);
        assert!(matches!(port.next(now), Err(LineFault::Ended(_))));
    }

    /// Brings the same bytes without end.
    struct EndlessPort(&'static [u8]);

    impl Read for EndlessPort {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            Port([Some(self.0)].into()).read(buffer)
        }
    }

    impl Write for EndlessPort {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn empty_lines_without_end_are_not_waited_for() {
        let mut port = Lines::new(EndlessPort(b"\r\n\n"), Arc::new(SystemClock));
        let deadline = Instant::now() + Duration::from_millis(5);
        assert_eq!(port.next(deadline).unwrap(), None);
    }

    #[test]
    fn noise_without_lines_is_refused() {
        let mut port = line_port([Some(&[0xff; 256][..]); 5]);
        let later = Instant::now() + Duration::from_secs(60);
        assert!(matches!(port.next(later), Err(LineFault::TooLong(_))));
    }
}
