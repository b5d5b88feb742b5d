//! A serial port, line by line, and positions as G-code machines write them.

use std::{
    io::{self, Read, Write},
    sync::Arc,
    time::{Duration, Instant},
};

use multiscopic_core::capture::Position;

use crate::capture::{
    Clock,
    stage::{error::StageError, limits::Limits},
};

/// Longer than any line of either firmware.
const MAX_LINE_BYTES: usize = 1024;

/// A pause of this length means that no more lines are pending. USB adapters gather bytes for less.
const QUIET: Duration = Duration::from_millis(100);

/// The errors of a read that has brought nothing, though the port works.
const NOTHING_YET: [io::ErrorKind; 3] = [io::ErrorKind::TimedOut, io::ErrorKind::WouldBlock, io::ErrorKind::Interrupted];

/// Sends and receives lines over a serial port.
pub struct LinePort<P> {
    port: P,
    name: String,
    silence_timeout: Duration,
    clock: Arc<dyn Clock>,
    bytes: Vec<u8>,
}

impl<P: Read + Write> LinePort<P> {
    /// Uses `port`, called `name` in messages. An expected line may take as long as `silence_timeout`.
    pub fn new(port: P, name: &str, silence_timeout: Duration, clock: Arc<dyn Clock>) -> LinePort<P> {
        LinePort { port, name: name.into(), silence_timeout, clock, bytes: Vec::new() }
    }

    /// The current time.
    pub fn now(&self) -> Instant {
        self.clock.now()
    }

    /// Waits for this long.
    pub fn wait(&self, duration: Duration) {
        self.clock.sleep(duration);
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
    /// there, or comes with one read, is returned even after it.
    pub fn next(&mut self, deadline: Instant) -> Result<Option<String>, StageError> {
        let mut has_read = false;
        loop {
            if let Some(line) = self.take_line() {
                return Ok(Some(line));
            }
            if self.bytes.len() > MAX_LINE_BYTES {
                return Err(StageError::Protocol {
                    from: self.name(),
                    found: format!("{} bytes without an end of line", self.bytes.len()),
                    expected: "lines; is the baud rate right?".into(),
                });
            }
            // Also while bytes arrive: they may never make a line.
            if has_read && self.now() >= deadline {
                return Ok(None);
            }
            let mut chunk = [0; 256];
            match self.port.read(&mut chunk) {
                Ok(0) => return Err(self.disconnected(io::ErrorKind::UnexpectedEof.into())),
                Ok(length) => self.bytes.extend_from_slice(&chunk[..length]),
                Err(error) if NOTHING_YET.contains(&error.kind()) => {}
                Err(source) => return Err(self.disconnected(source)),
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

    /// The next line that is not empty, which must arrive before `deadline`.
    pub fn expect(&mut self, deadline: Instant) -> Result<String, StageError> {
        let next = if self.now() < deadline { self.next(deadline)? } else { None };
        next.ok_or_else(|| StageError::Silent { from: self.name(), after: self.silence_timeout })
    }

    /// Discards lines until no more arrive, for at most the silence time-out.
    pub fn discard_pending(&mut self) -> Result<(), StageError> {
        let deadline = self.now() + self.silence_timeout;
        while self.now() < deadline && self.next(self.now() + QUIET)?.is_some() {}
        Ok(())
    }

    fn disconnected(&self, source: io::Error) -> StageError {
        StageError::Disconnected { from: self.name(), source, advice: "check its cable and power" }
    }
}

/// Converts a position to the coordinates, in millimetres, of a machine that started at `start`.
pub fn to_machine(start: [f64; 2], position: Position) -> [f64; 2] {
    [start[0] + f64::from(position.x_um) / 1e3, start[1] - f64::from(position.y_um) / 1e3]
}

/// Converts the coordinates of a machine that started at `start` to a position.
pub fn to_position(start: [f64; 2], machine: [f64; 2]) -> Position {
    let um = |millimetres: f64| (millimetres * 1e3).round() as i32;
    Position { x_um: um(machine[0] - start[0]), y_um: um(start[1] - machine[1]) }
}

/// The G-code of a straight move.
pub fn linear_move(target: [f64; 2], limits: &Limits) -> String {
    // Adding 0 turns -0 into 0.
    let [x, y] = target.map(|millimetres| (millimetres * 1e4).round() / 1e4 + 0.0);
    format!("G1 X{x:.4} Y{y:.4} F{:.1}", limits.speed_mm_s * 60.0)
}

/// The Euclidean distance.
pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Parses a coordinate. `None` if the text is not a number, or not one that a machine can mean.
pub fn parse_coordinate(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| (-1e5..=1e5).contains(number))
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

    fn line_port(chunks: impl IntoIterator<Item = Option<&'static [u8]>>) -> LinePort<Port> {
        LinePort::new(Port(chunks.into_iter().collect()), "port", Duration::ZERO, Arc::new(SystemClock))
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
        assert!(matches!(port.next(now), Err(StageError::Disconnected { .. })));
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
        let mut port = LinePort::new(EndlessPort(b"\r\n\n"), "port", Duration::from_millis(5), Arc::new(SystemClock));
        let deadline = Instant::now() + Duration::from_millis(5);
        assert_eq!(port.next(deadline).unwrap(), None);
        assert!(matches!(port.expect(deadline + Duration::from_millis(5)), Err(StageError::Silent { .. })));
        port.discard_pending().unwrap();
    }

    #[test]
    fn noise_without_lines_is_refused() {
        let mut port = line_port([Some(&[0xff; 256][..]); 5]);
        let later = Instant::now() + Duration::from_secs(60);
        assert!(matches!(port.next(later), Err(StageError::Protocol { .. })));
    }

    #[test]
    fn y_points_up() {
        let position = Position { x_um: 1500, y_um: 250 };
        assert_eq!(to_machine([10.0, 20.0], position), [11.5, 19.75]);
        assert_eq!(to_position([10.0, 20.0], [11.5, 19.75]), position);
        assert_eq!(linear_move([11.5, -0.00001], &Limits::default()), "G1 X11.5000 Y0.0000 F3000.0");
    }
}
