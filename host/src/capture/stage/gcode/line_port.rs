//! A serial port, line by line.

use std::{
    io::{self, Read, Write},
    time::{Duration, Instant},
};

use crate::capture::stage::error::StageError;

/// Longer than any line of either firmware.
const MAX_LINE_BYTES: usize = 1024;

/// A pause of this length means that no more lines are pending. USB adapters gather bytes for less.
const QUIET: Duration = Duration::from_millis(100);

/// Sends and receives lines over a serial port.
pub struct LinePort<P> {
    port: P,
    name: String,
    silence_timeout: Duration,
    bytes: Vec<u8>,
}

impl<P: Read + Write> LinePort<P> {
    /// Uses `port`, called `name` in messages. An expected line may take as long as `silence_timeout`.
    pub fn new(port: P, name: &str, silence_timeout: Duration) -> LinePort<P> {
        LinePort { port, name: name.into(), silence_timeout, bytes: Vec::new() }
    }

    /// The name of the port in messages.
    pub fn name(&self) -> String {
        self.name.clone()
    }

    /// Sends a line.
    pub fn send(&mut self, line: &str) -> Result<(), StageError> {
        self.send_bytes(format!("{line}\n").as_bytes())
    }

    /// Sends bytes that are not a line.
    pub fn send_bytes(&mut self, bytes: &[u8]) -> Result<(), StageError> {
        // Not flushed: flushing may block without limit.
        self.port.write_all(bytes).map_err(|source| self.disconnected(source))
    }

    /// The next line that is not empty. `None` if there is none until `deadline`; a line that is already
    /// there is returned even after it.
    pub fn next(&mut self, deadline: Instant) -> Result<Option<String>, StageError> {
        loop {
            while let Some(end) = self.bytes.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = self.bytes.drain(..=end).collect();
                let line = String::from_utf8_lossy(&line);
                if !line.trim().is_empty() {
                    return Ok(Some(line.trim().to_owned()));
                }
            }
            if self.bytes.len() > MAX_LINE_BYTES {
                return Err(StageError::Protocol {
                    from: self.name(),
                    found: format!("{} bytes without an end of line", self.bytes.len()),
                    expected: "lines; is the baud rate right?".into(),
                });
            }
            let mut chunk = [0; 256];
            match self.port.read(&mut chunk) {
                Ok(0) => return Err(self.disconnected(io::ErrorKind::UnexpectedEof.into())),
                Ok(length) => self.bytes.extend_from_slice(&chunk[..length]),
                Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock) => {
                    if Instant::now() >= deadline {
                        return Ok(None);
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(source) => return Err(self.disconnected(source)),
            }
        }
    }

    /// The next line that is not empty, which must arrive before `deadline`.
    pub fn expect(&mut self, deadline: Instant) -> Result<String, StageError> {
        let next = if Instant::now() < deadline { self.next(deadline)? } else { None };
        next.ok_or_else(|| StageError::Silent { from: self.name(), after: self.silence_timeout })
    }

    /// Discards lines until no more arrive, for at most the silence time-out.
    pub fn discard_pending(&mut self) -> Result<(), StageError> {
        let deadline = Instant::now() + self.silence_timeout;
        while Instant::now() < deadline && self.next(Instant::now() + QUIET)?.is_some() {}
        Ok(())
    }

    fn disconnected(&self, source: io::Error) -> StageError {
        StageError::Disconnected { from: self.name(), source, advice: "check its cable and power" }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;

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

    fn line_port(chunks: impl IntoIterator<Item = Option<&'static [u8]>>) -> LinePort<Port> {
        LinePort::new(Port(chunks.into_iter().collect()), "port", Duration::ZERO)
    }

    #[test]
    fn lines_are_assembled_from_chunks() {
        let mut port = line_port([Some(&b"\r\no"[..]), None, Some(b"k\r\nerr"), Some(b"or:9\n\xff"), None]);
        let now = Instant::now();
        assert_eq!(port.next(now).unwrap(), None);
        assert_eq!(port.next(now).unwrap().as_deref(), Some("ok"));
        assert_eq!(port.next(now).unwrap().as_deref(), Some("error:9"));
        assert_eq!(port.next(now).unwrap(), None);
        assert!(matches!(port.next(now), Err(StageError::Disconnected { .. })));
    }

    #[test]
    fn noise_without_lines_is_refused() {
        let mut port = line_port([Some(&[0xff; 256][..]); 5]);
        assert!(matches!(port.next(Instant::now()), Err(StageError::Protocol { .. })));
    }
}
