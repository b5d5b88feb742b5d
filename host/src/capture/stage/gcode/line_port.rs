//! A serial port, line by line, and positions as G-code machines write them.

use std::{
    io::{self, Read, Write},
    sync::Arc,
    time::{Duration, Instant},
};

use multiscopic_core::capture::Position;

use crate::capture::{
    Clock,
    lines::{LineFault, Lines},
    stage::{error::StageError, limits::Limits},
};

/// A pause of this length means that no more lines are pending. USB adapters gather bytes for less.
const QUIET: Duration = Duration::from_millis(100);

/// Sends and receives lines over a serial port.
pub struct LinePort<P> {
    lines: Lines<P>,
    name: String,
    silence_timeout: Duration,
}

impl<P: Read + Write> LinePort<P> {
    /// Uses `port`, called `name` in messages. An expected line may take as long as `silence_timeout`.
    pub fn new(port: P, name: &str, silence_timeout: Duration, clock: Arc<dyn Clock>) -> LinePort<P> {
        LinePort { lines: Lines::new(port, clock), name: name.into(), silence_timeout }
    }

    /// The current time.
    pub fn now(&self) -> Instant {
        self.lines.now()
    }

    /// Waits for this long.
    pub fn wait(&self, duration: Duration) {
        self.lines.wait(duration);
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
        self.lines.send(bytes).map_err(|source| self.disconnected(source))
    }

    /// The next line that is not empty, as [`Lines::next`] has it.
    pub fn next(&mut self, deadline: Instant) -> Result<Option<String>, StageError> {
        self.lines.next(deadline).map_err(|fault| match fault {
            LineFault::Ended(source) => self.disconnected(source),
            LineFault::TooLong(count) => StageError::Protocol {
                from: self.name(),
                found: format!("{count} bytes without an end of line"),
                expected: "lines; is the baud rate right?".into(),
            },
        })
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
    use super::*;

    #[test]
    fn y_points_up() {
        let position = Position { x_um: 1500, y_um: 250 };
        assert_eq!(to_machine([10.0, 20.0], position), [11.5, 19.75]);
        assert_eq!(to_position([10.0, 20.0], [11.5, 19.75]), position);
        assert_eq!(linear_move([11.5, -0.00001], &Limits::default()), "G1 X11.5000 Y0.0000 F3000.0");
    }
}
