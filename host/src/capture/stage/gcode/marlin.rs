//! A machine with Marlin, or a compatible firmware, after Marlin's G-code documentation.
//!
//! Marlin answers every line with `ok`: a move as soon as it is queued, so that more lines can be sent while the
//! machine moves, and `M400` once it stands still. Until then it may ignore everything else, even a stop, so
//! `M400` is only sent when the move should have ended. `M114` reports the coordinates at standstill.

use std::{
    io::{Read, Write},
    time::{Duration, Instant},
};

use multiscopic_core::capture::{Position, Stage};

use super::line_port::{LinePort, distance, linear_move, parse_coordinate, to_machine, to_position};
use crate::capture::stage::{error::StageError, limits::Limits};

/// The most pending lines to process in one call. Fewer than this arrive between two calls.
const MAX_PENDING: usize = 64;

/// A machine with Marlin.
///
/// It cannot report where it is while it moves. A stop is abrupt, and may lose steps. Each call returns
/// within [`Limits::silence_timeout`] for each line sent, and [`Limits::stall_timeout`] more if the machine
/// reports that it is busy. Dropping it stops any move.
pub struct Marlin<P: Read + Write> {
    port: LinePort<P>,
    limits: Limits,
    /// Number of lines not yet answered.
    unanswered: usize,
    /// Coordinates when it was opened, in millimetres. `None` after it restarted and lost them.
    start: Option<[f64; 2]>,
    /// The coordinates that it was last sent to or reported, in millimetres.
    coordinates: [f64; 2],
    motion: Motion,
}

#[derive(Clone, Copy, Debug)]
enum Motion {
    /// Not sent anywhere, or stopped.
    Idle,
    /// Moving, presumably until `due`.
    Moving { due: Instant, duration: Duration },
    /// `M400` was sent at `asked`, after a move that should have taken `duration`. The last line arrived at
    /// `heard`.
    Finishing { asked: Instant, heard: Instant, duration: Duration },
    /// Standing still at its target.
    Arrived,
}

impl<P: Read + Write> Marlin<P> {
    /// Takes over a port at which Marlin has answered.
    pub(super) fn open(port: LinePort<P>, limits: &Limits) -> Result<Self, StageError> {
        let limits = *limits;
        let mut marlin = Marlin { port, limits, unanswered: 0, start: None, coordinates: [0.0; 2], motion: Motion::Idle };
        // Also waits for any earlier move.
        marlin.command("M400")?;
        marlin.coordinates = marlin.query_coordinates()?;
        marlin.start = Some(marlin.coordinates);
        Ok(marlin)
    }

    /// Sends a line, and returns the answers before its `ok`.
    fn command(&mut self, line: &str) -> Result<Vec<String>, StageError> {
        self.send(line)?;
        let mut answers = Vec::new();
        let Limits { silence_timeout, stall_timeout, .. } = self.limits;
        // Wait while it reports that it is busy, but not without limit.
        let deadline = self.port.now() + silence_timeout + stall_timeout;
        while self.unanswered > 0 {
            let answer = self.port.expect(deadline.min(self.port.now() + silence_timeout))?;
            if let Some(answer) = self.process(answer, line)? {
                answers.push(answer);
            }
        }
        Ok(answers)
    }

    fn send(&mut self, line: &str) -> Result<(), StageError> {
        self.port.send(line)?;
        self.unanswered += 1;
        Ok(())
    }

    /// Processes a line that arrived after `sent`, and returns it if it is an answer.
    fn process(&mut self, line: String, sent: &str) -> Result<Option<String>, StageError> {
        let by = self.port.name();
        if line == "ok" || line.starts_with("ok ") {
            self.unanswered = self.unanswered.saturating_sub(1);
            // Some versions answer on the same line.
            return Ok(line.strip_prefix("ok ").map(str::to_owned));
        }
        // It may restart in the middle of a line.
        if line.ends_with("start") {
            self.start = None;
            return Err(StageError::Restarted { by });
        }
        if let Some(reason) = line.strip_prefix("Error:").or(line.strip_prefix("!!")) {
            return Err(match reason.contains("halted") || reason.contains("kill") {
                true => StageError::Alarm { by, reason: reason.trim().into() },
                false => StageError::Refused { by, line: sent.into(), reason: reason.trim().into() },
            });
        }
        if line.starts_with("echo:Unknown command") {
            return Err(StageError::Refused { by, line: sent.into(), reason: line });
        }
        Ok(Some(line))
    }

    /// Queries the coordinates at standstill, in millimetres.
    fn query_coordinates(&mut self) -> Result<[f64; 2], StageError> {
        let answers = self.command("M114")?;
        answers.iter().find_map(|answer| parse_coordinates(answer)).ok_or_else(|| StageError::Protocol {
            from: self.port.name(),
            found: answers.join(" / "),
            expected: "X:0.00 Y:0.00 ... of M114".into(),
        })
    }

    /// Processes the pending lines. Returns true if there were any.
    fn process_pending(&mut self, sent: &str) -> Result<bool, StageError> {
        for processed in 0..MAX_PENDING {
            match self.port.next(self.port.now())? {
                Some(line) => self.process(line, sent).map(drop)?,
                None => return Ok(processed > 0),
            }
        }
        Ok(true)
    }

    /// The coordinates when it was opened. Fails if it has restarted since.
    fn start(&self) -> Result<[f64; 2], StageError> {
        self.start.ok_or_else(|| StageError::Restarted { by: self.port.name() })
    }

    fn is_moving(&self) -> bool {
        matches!(self.motion, Motion::Moving { .. } | Motion::Finishing { .. })
    }
}

impl<P: Read + Write> Stage for Marlin<P> {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.check_reach(position)?;
        let start = self.start()?;
        if self.is_moving() {
            self.stop()?;
        }
        self.command("G21")?;
        self.command("G90")?;
        let target = to_machine(start, position);
        let duration = Duration::from_secs_f64(distance(self.coordinates, target) / self.limits.speed_mm_s);
        // Set before sending: the machine may move even if sending seems to fail.
        self.motion = Motion::Moving { due: self.port.now() + duration, duration };
        self.coordinates = target;
        self.command(&linear_move(target, &self.limits)).map(drop)
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        self.start()?;
        let has_heard = self.process_pending("M400")?;
        let now = self.port.now();
        match self.motion {
            Motion::Idle => Ok(false),
            Motion::Arrived => Ok(true),
            Motion::Moving { due, .. } if now < due => Ok(false),
            Motion::Moving { duration, .. } => {
                self.motion = Motion::Finishing { asked: now, heard: now, duration };
                self.send("M400").map(|()| false)
            }
            Motion::Finishing { .. } if self.unanswered == 0 => {
                self.motion = Motion::Arrived;
                Ok(true)
            }
            Motion::Finishing { asked, heard, duration } => {
                let heard = if has_heard { now } else { heard };
                self.motion = Motion::Finishing { asked, heard, duration };
                let (by, Limits { silence_timeout, stall_timeout, .. }) = (self.port.name(), self.limits);
                // A machine slower than commanded may need as long again.
                match (now - heard > duration + silence_timeout, heard - asked > duration + stall_timeout) {
                    (true, _) => Err(StageError::Silent { from: by, after: now - heard }),
                    (_, true) => Err(StageError::Late { by, after: now - asked }),
                    _ => Ok(false),
                }
            }
        }
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        let start = self.start()?;
        match self.is_moving() {
            true => Ok(None),
            false => self.query_coordinates().map(|coordinates| Some(to_position(start, coordinates))),
        }
    }

    /// Stops the machine, and queries where it stopped.
    fn stop(&mut self) -> Result<(), StageError> {
        self.motion = Motion::Idle;
        self.command("M410")?;
        self.coordinates = self.query_coordinates()?;
        Ok(())
    }
}

impl<P: Read + Write> Drop for Marlin<P> {
    fn drop(&mut self) {
        if self.is_moving() {
            // There is nobody to report an error to.
            let _ = self.stop();
        }
    }
}

/// Parses an answer to `M114`, such as `X:0.00 Y:127.00 Z:145.00 E:0.00 Count X: 0 Y:10160 Z:116000`.
fn parse_coordinates(answer: &str) -> Option<[f64; 2]> {
    let number = |name: &str| {
        // A number at the end of a line that broke off may lack digits.
        let (number, _) = answer.split_once(name)?.1.trim_start().split_once(char::is_whitespace)?;
        // Numbers of steps have no decimals. They come first if the beginning is lost.
        parse_coordinate(number).filter(|_| number.contains('.'))
    };
    Some([number("X:")?, number("Y:")?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_parsed() {
        assert_eq!(parse_coordinates("X:0.50 Y:127.00 Z:145.00 E:0.00 Count X: 0 Y:10160 Z:116000"), Some([0.5, 127.0]));
        assert_eq!(parse_coordinates("X: -1.00 Y: 2.00 Z: 3.00"), Some([-1.0, 2.0]));
        assert_eq!(parse_coordinates("X:nan Y:0 Z:0"), None);
        assert_eq!(parse_coordinates("T:20.0"), None);
    }

    #[test]
    fn a_report_that_lacks_its_beginning_or_its_end_tells_the_truth_or_nothing() {
        let report = "X:10.50 Y:127.25 Z:145.00 E:0.00 Count X:840 Y:10180 Z:116000";
        let parts = (0..=report.len()).flat_map(|length| [&report[..length], &report[length..]]);
        let found: Vec<_> = parts.filter_map(parse_coordinates).collect();
        assert!(!found.is_empty() && found.iter().all(|coordinates| *coordinates == [10.5, 127.25]), "{found:?}");
    }
}
