//! A machine with a firmware of the RepRap family: Marlin, Klipper, RepRapFirmware, Repetier or Smoothieware, after their G-code
//! documentation.
//!
//! They have no order to stop in common, and most of them ignore some or all lines while they move. So a move is sent in short
//! segments, and to stop is to send no more. Each segment is followed by `M400`, which is done once the machine stands still,
//! and `M114`, which reports the coordinates. Lines are executed in turn, so that the report proves that the segment has ended.

use std::{
    io::{Read, Write},
    time::{Duration, Instant},
};

use multiscopic_core::capture::{Position, Stage};

use super::line_port::{LinePort, distance, linear_move, parse_coordinate, to_machine, to_position};
use crate::capture::stage::{error::StageError, limits::Limits, posed::PosedStage};

/// The names by which these firmwares answer `M115`.
pub(super) const FIRMWARES: [&str; 6] = ["Marlin", "Prusa-Firmware", "Klipper", "RepRapFirmware", "Repetier", "Smoothie"];

/// The most pending lines to process in one call. Fewer than this arrive between two calls.
const MAX_PENDING: usize = 64;

/// The duration of a segment in seconds, but for speeding up and slowing down: the machine moves so long after an order to stop.
const SEGMENT_S: f64 = 0.1;

/// The largest difference of reported coordinates from those that the machine was sent to, in millimetres: some firmwares report
/// tenths.
const TOLERANCE_MM: f64 = 0.06;

/// A machine with a firmware of the RepRap family.
///
/// It cannot report where it is while it moves. Each call returns within [`Limits::silence_timeout`] and
/// [`Limits::stall_timeout`]. Dropping it stops any move.
pub struct RepRap<P: Read + Write> {
    port: LinePort<P>,
    limits: Limits,
    /// Coordinates when it was opened, in millimetres. `None` after it restarted and lost them.
    start: Option<[f64; 2]>,
    /// The coordinates at which it stands, or at which the present segment ends, in millimetres.
    coordinates: [f64; 2],
    motion: Motion,
}

#[derive(Clone, Copy, Debug)]
enum Motion {
    /// Not sent anywhere, or stopped.
    Idle,
    /// On a segment of the way to `target`. Its report is due.
    Moving { target: [f64; 2], due: Due },
    /// Standing still at its target.
    Arrived,
    /// Halted by the firmware, which says so, and answers no more.
    Halted,
}

/// A report of coordinates that is due.
#[derive(Clone, Copy, Debug)]
struct Due {
    since: Instant,
    /// The time at which the last line came, or since which it is due.
    heard: Instant,
}

impl<P: Read + Write> RepRap<P> {
    /// Takes over a port at which such a firmware has answered.
    pub(super) fn open(port: LinePort<P>, limits: &Limits) -> Result<Self, StageError> {
        let mut machine = RepRap { port, limits: *limits, start: None, coordinates: [0.0; 2], motion: Motion::Idle };
        // Some firmwares report in the unit of the last `G20` or `G21`. `M400` waits for any earlier move.
        machine.coordinates = machine.query(&["G21", "M400", "M114"])?;
        machine.start = Some(machine.coordinates);
        Ok(machine)
    }

    /// Sends lines, the last of which is `M114`, and returns the reported coordinates in millimetres.
    fn query(&mut self, lines: &[&str]) -> Result<[f64; 2], StageError> {
        self.port.send(&lines.join("\n"))?;
        self.report(lines[0])
    }

    /// Waits for the report of coordinates, in millimetres, that is due after the line `sent`.
    fn report(&mut self, sent: &str) -> Result<[f64; 2], StageError> {
        let mut due = self.due();
        loop {
            self.check_patience(due)?;
            let Some(line) = self.port.next(due.since + self.patience())? else { continue };
            if let Some(coordinates) = self.process(&line, sent)? {
                return Ok(coordinates);
            }
            due.heard = self.port.now();
        }
    }

    /// A report that is due from now on.
    fn due(&self) -> Due {
        Due { since: self.port.now(), heard: self.port.now() }
    }

    /// The time for which a report may take to come.
    fn patience(&self) -> Duration {
        self.limits.silence_timeout + self.limits.stall_timeout
    }

    /// Fails if a report has been due for too long.
    fn check_patience(&self, due: Due) -> Result<(), StageError> {
        let (name, now) = (self.port.name(), self.port.now());
        let (after, silence) = (now - due.since, now - due.heard);
        match (after > self.patience(), silence >= self.limits.silence_timeout) {
            (false, _) => Ok(()),
            (true, true) => Err(StageError::Silent { from: name, after: silence }),
            (true, false) => Err(StageError::Late { by: name, after }),
        }
    }

    /// Processes a line that arrived after `sent`, and returns the coordinates that it reports, if it does.
    fn process(&mut self, line: &str, sent: &str) -> Result<Option<[f64; 2]>, StageError> {
        let by = self.port.name();
        // It may restart in the middle of a line.
        if line.ends_with("start") {
            self.start = None;
            return Err(StageError::Restarted { by });
        }
        let lower = line.to_lowercase();
        let has = |words: &[&str]| words.iter().any(|words| lower.contains(words));
        if has(&["halted", "kill()", "shutdown", "emergency stop"]) {
            (self.motion, self.start) = (Motion::Halted, None);
            return Err(StageError::Alarm { by, reason: line.into() });
        }
        let is_refusal = lower.starts_with("error:")
            || lower.starts_with("!!")
            || has(&["unknown command", "unknown m code", "unknown g code", "not supported", "bad command"])
            // Marlin: `echo:Home XY First`.
            || lower.starts_with("echo:home ") && lower.ends_with(" first");
        if is_refusal {
            return Err(StageError::Refused { by, line: sent.into(), reason: line.into() });
        }
        let reported = parse_coordinates(line);
        let reach = f64::from(self.limits.reach_um) / 1e3 + TOLERANCE_MM;
        // It was not sent there: its coordinates are others now.
        if reported.zip(self.start).is_some_and(|(reported, start)| distance(reported, start) > reach) {
            self.start = None;
            return Err(StageError::Restarted { by });
        }
        Ok(reported)
    }

    /// The coordinates when it was opened. Fails if it has restarted since.
    fn start(&self) -> Result<[f64; 2], StageError> {
        self.start.ok_or_else(|| StageError::Restarted { by: self.port.name() })
    }

    fn is_moving(&self) -> bool {
        matches!(self.motion, Motion::Moving { .. })
    }

    /// Sends the next segment of the way to `target`.
    fn send_segment(&mut self, target: [f64; 2]) -> Result<(), StageError> {
        let (from, share) = (self.coordinates, self.limits.speed_mm_s * SEGMENT_S / distance(self.coordinates, target));
        self.coordinates = match share < 1.0 {
            true => [0, 1].map(|axis| from[axis] + share * (target[axis] - from[axis])),
            false => target,
        };
        // Set before sending: the machine may move even if sending seems to fail.
        self.motion = Motion::Moving { target, due: self.due() };
        self.port.send(&format!("G21\nG90\n{}\nM400\nM114", self.segment()))
    }

    /// The line of the present segment.
    fn segment(&self) -> String {
        linear_move(self.coordinates, &self.limits)
    }

    /// Fails unless the present segment has ended where it should.
    fn check_end(&mut self, reported: [f64; 2]) -> Result<(), StageError> {
        if distance(reported, self.coordinates) <= TOLERANCE_MM {
            return Ok(());
        }
        let line = self.segment();
        self.coordinates = reported;
        let reason = format!("it is at X{:.2} Y{:.2}; is that the end of its travel?", reported[0], reported[1]);
        Err(StageError::Refused { by: self.port.name(), line, reason })
    }
}

impl<P: Read + Write> Stage for RepRap<P> {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.check_reach(position)?;
        let start = self.start()?;
        match self.is_moving() {
            true => self.stop()?,
            // It may have restarted without a word.
            false if distance(self.query(&["M114"])?, self.coordinates) > TOLERANCE_MM => {
                self.start = None;
                return Err(StageError::Restarted { by: self.port.name() });
            }
            false => {}
        }
        self.send_segment(to_machine(start, position))
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        self.start()?;
        let Motion::Moving { target, mut due } = self.motion else { return Ok(matches!(self.motion, Motion::Arrived)) };
        let mut reported = None;
        for _ in 0..MAX_PENDING {
            let Some(line) = self.port.next(self.port.now())? else { break };
            due.heard = self.port.now();
            reported = reported.or(self.process(&line, &self.segment())?);
        }
        self.motion = Motion::Moving { target, due };
        let Some(reported) = reported else { return self.check_patience(due).map(|()| false) };
        self.motion = Motion::Idle;
        self.check_end(reported)?;
        if self.coordinates != target {
            return self.send_segment(target).map(|()| false);
        }
        self.motion = Motion::Arrived;
        Ok(true)
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        let start = self.start()?;
        match self.is_moving() {
            true => Ok(None),
            false => self.query(&["M114"]).map(|coordinates| Some(to_position(start, coordinates))),
        }
    }

    /// Waits until the present segment has ended.
    fn stop(&mut self) -> Result<(), StageError> {
        let ended = match self.motion {
            Motion::Arrived | Motion::Halted => return Ok(()),
            Motion::Moving { .. } => self.report(&self.segment()),
            Motion::Idle => self.query(&["M400", "M114"]),
        };
        self.coordinates = ended.map_err(|error| match error {
            StageError::Late { after, .. } => StageError::StillMoving { after },
            error => error,
        })?;
        self.motion = Motion::Idle;
        Ok(())
    }
}

impl<P: Read + Write> PosedStage for RepRap<P> {}

impl<P: Read + Write> Drop for RepRap<P> {
    fn drop(&mut self) {
        if self.is_moving() {
            // There is nobody to report an error to.
            let _ = self.stop();
        }
    }
}

/// Parses an answer to `M114`, such as `X:0.00 Y:127.00 Z:145.00 E:0.00 Count X: 0 Y:10160 Z:116000`. Old versions have no
/// blanks.
fn parse_coordinates(answer: &str) -> Option<[f64; 2]> {
    let number = |name: &str| {
        let rest = answer.split_once(name)?.1.trim_start();
        // A number at the end of a line that broke off may lack digits.
        let end = rest.find(|c: char| !c.is_ascii_digit() && !"+-.".contains(c))?;
        // Numbers of steps have no decimals. They come first if the beginning is lost.
        parse_coordinate(&rest[..end]).filter(|_| rest[..end].contains('.'))
    };
    Some([number("X:")?, number("Y:")?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_parsed() {
        for (answer, coordinates) in [
            ("X:0.50 Y:127.00 Z:145.00 E:0.00 Count X: 0 Y:10160 Z:116000", Some([0.5, 127.0])),
            ("X: -1.00 Y: 2.00 Z: 3.00", Some([-1.0, 2.0])),
            ("X:50.80Y:25.40Z:0.00E:0.00 Count X: 50.80Y:25.40Z:0.00", Some([50.8, 25.4])),
            ("C: X:12.5000 Y:-3.2500 Z:0.0000", Some([12.5, -3.25])),
            ("X:1.000 Y:2.000 Z:0.000 E:0.000 E0:0.0 Count 80 160 0 Machine 1.000 2.000 0.000 Bed comp 0.000", Some([1.0, 2.0])),
            ("X:nan Y:0 Z:0", None),
            ("T:20.0", None),
        ] {
            assert_eq!(parse_coordinates(answer), coordinates, "{answer}");
        }
    }

    #[test]
    fn a_report_that_lacks_its_beginning_or_its_end_tells_the_truth_or_nothing() {
        let report = "X:10.50 Y:127.25 Z:145.00 E:0.00 Count X:840 Y:10180 Z:116000";
        let parts = (0..=report.len()).flat_map(|length| [&report[..length], &report[length..]]);
        let found: Vec<_> = parts.filter_map(parse_coordinates).collect();
        assert!(!found.is_empty() && found.iter().all(|coordinates| *coordinates == [10.5, 127.25]), "{found:?}");
    }
}
