//! Lines over a serial port.

use std::{
    io::{self, Read, Write},
    time::{Duration, Instant},
};

use crate::capture::stage::StageError;

/// Longer than any line of either firmware.
const MAX_BYTES: usize = 1024;

/// How long nothing must come after a machine said what it is, so that it has said all: longer than a USB adapter gathers bytes.
const QUIET: Duration = Duration::from_millis(100);

/// A serial port, by the line.
pub struct Lines<P> {
    port: P,
    name: String,
    silence: Duration,
    bytes: Vec<u8>,
}

impl<P: Read + Write> Lines<P> {
    /// The port that messages call `name`, which may be silent for as long as `silence` when it should speak.
    pub fn new(port: P, name: &str, silence: Duration) -> Lines<P> {
        Lines { port, name: name.into(), silence, bytes: Vec::new() }
    }

    /// What messages call it.
    pub fn name(&self) -> String {
        self.name.clone()
    }

    /// Sends a line.
    pub fn send(&mut self, line: &str) -> Result<(), StageError> {
        self.send_bytes(format!("{line}\n").as_bytes())
    }

    /// Sends bytes that are no line.
    pub fn send_bytes(&mut self, bytes: &[u8]) -> Result<(), StageError> {
        // Without flushing, which waits as long as the port likes.
        self.port.write_all(bytes).map_err(|source| self.broken(source))
    }

    /// The next line that is not empty, if it comes before `deadline`; one that is there is given even then.
    pub fn next(&mut self, deadline: Instant) -> Result<Option<String>, StageError> {
        loop {
            while let Some(end) = self.bytes.iter().position(|byte| *byte == b'\n') {
                let line: Vec<u8> = self.bytes.drain(..=end).collect();
                let line = String::from_utf8_lossy(&line);
                if !line.trim().is_empty() {
                    return Ok(Some(line.trim().to_owned()));
                }
            }
            if self.bytes.len() > MAX_BYTES {
                return Err(StageError::Protocol {
                    from: self.name(),
                    found: format!("{} bytes without an end of line", self.bytes.len()),
                    expected: "lines: is the symbol rate right?".into(),
                });
            }
            let mut chunk = [0; 256];
            match self.port.read(&mut chunk) {
                Ok(0) => return Err(self.broken(io::ErrorKind::UnexpectedEof.into())),
                Ok(length) => self.bytes.extend_from_slice(&chunk[..length]),
                Err(error) if matches!(error.kind(), io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock) => {
                    if Instant::now() >= deadline {
                        return Ok(None);
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(source) => return Err(self.broken(source)),
            }
        }
    }

    /// The next line, which must come before `deadline`.
    pub fn expect(&mut self, deadline: Instant) -> Result<String, StageError> {
        let next = if Instant::now() < deadline { self.next(deadline)? } else { None };
        next.ok_or_else(|| StageError::Silent { from: self.name(), after: self.silence })
    }

    /// Drops lines until no more come, but not for ever.
    pub fn settle(&mut self) -> Result<(), StageError> {
        let deadline = Instant::now() + self.silence;
        while Instant::now() < deadline && self.next(Instant::now() + QUIET)?.is_some() {}
        Ok(())
    }

    fn broken(&self, source: io::Error) -> StageError {
        StageError::Disconnected { from: self.name(), source, advice: "check its cable and power" }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::VecDeque;

    /// What comes by and by; `None` for a while without anything.
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

    fn lines(pieces: impl IntoIterator<Item = Option<&'static [u8]>>) -> Lines<Port> {
        Lines::new(Port(pieces.into_iter().collect()), "port", Duration::ZERO)
    }

    #[test]
    fn lines_come_in_pieces() {
        let mut lines = lines([Some(&b"\r\no"[..]), None, Some(b"k\r\nerr"), Some(b"or:9\n\xff"), None]);
        let now = Instant::now();
        assert_eq!(lines.next(now).unwrap(), None);
        assert_eq!(lines.next(now).unwrap().as_deref(), Some("ok"));
        assert_eq!(lines.next(now).unwrap().as_deref(), Some("error:9"));
        assert_eq!(lines.next(now).unwrap(), None);
        assert!(matches!(lines.next(now), Err(StageError::Disconnected { .. })));
    }

    #[test]
    fn noise_has_an_end() {
        let mut lines = lines([Some(&[0xff; 256][..]); 5]);
        assert!(matches!(lines.next(Instant::now()), Err(StageError::Protocol { .. })));
    }
}
