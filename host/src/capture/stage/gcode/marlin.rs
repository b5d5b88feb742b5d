//! A machine with Marlin, or one that speaks like it.
//!
//! After Marlin's documentation of its G-code. Every line is answered by `ok`, a move at once: the machine moves while it takes more lines. `M400` is
//! answered when it stands, and until then nothing else may be, a stop included; so it is sent only when the move should have ended.
//! `M114` says where the machine stands.

use std::{
    io::{Read, Write},
    time::{Duration, Instant},
};

use multiscopic_core::capture::{Position, Stage};

use super::{Lines, coordinate, distance, linear, to_machine, to_position};
use crate::capture::stage::{Limits, StageError};

/// A machine with Marlin.
///
/// It cannot tell where it is while it moves. A stop is abrupt, and may lose some steps. Each call returns within [`Limits::silence_timeout`]
/// for each line sent, and [`Limits::stall_timeout`] more if the machine says that it is busy. When it is dropped, a motion is stopped.
pub struct Marlin<P: Read + Write> {
    lines: Lines<P>,
    limits: Limits,
    /// How many lines it has not answered yet.
    unanswered: usize,
    /// Where it was when it was opened, in millimetres; `None` once that is lost.
    start: Option<[f64; 2]>,
    /// Where it was sent last, in millimetres.
    place: [f64; 2],
    motion: Motion,
}

#[derive(Clone, Copy, Debug)]
enum Motion {
    /// It was not sent anywhere, or stopped.
    None,
    /// It moves until about then.
    Until { due: Instant, duration: Duration },
    /// It was asked then to say when it stands, after a move of this duration. It last said something at `heard`.
    Ending { asked: Instant, heard: Instant, duration: Duration },
    /// It stands where it was sent.
    Done,
}

impl<P: Read + Write> Marlin<P> {
    /// Takes over a machine that has said that it is Marlin.
    pub(super) fn open(lines: Lines<P>, limits: &Limits) -> Result<Self, StageError> {
        let limits = *limits;
        let mut marlin = Marlin { lines, limits, unanswered: 0, start: None, place: [0.0; 2], motion: Motion::None };
        // Also waits for what it may have been doing.
        marlin.command("M400")?;
        marlin.place = marlin.ask_place()?;
        marlin.start = Some(marlin.place);
        Ok(marlin)
    }

    /// Sends a line and gives what is answered before its `ok`.
    fn command(&mut self, line: &str) -> Result<Vec<String>, StageError> {
        self.send(line)?;
        let mut answers = Vec::new();
        let Limits { silence_timeout, stall_timeout, .. } = self.limits;
        // As long as it says that it is busy, but not for ever.
        let end = Instant::now() + silence_timeout + stall_timeout;
        while self.unanswered > 0 {
            let answer = self.lines.expect(end.min(Instant::now() + silence_timeout))?;
            if let Some(answer) = self.take(answer, line)? {
                answers.push(answer);
            }
        }
        Ok(answers)
    }

    fn send(&mut self, line: &str) -> Result<(), StageError> {
        self.lines.send(line)?;
        self.unanswered += 1;
        Ok(())
    }

    /// Takes a line that came after `sent`, and gives it if it is an answer.
    fn take(&mut self, line: String, sent: &str) -> Result<Option<String>, StageError> {
        let by = self.lines.name();
        if line == "ok" || line.starts_with("ok ") {
            self.unanswered = self.unanswered.saturating_sub(1);
            // Some versions answer in the same line.
            return Ok(line.strip_prefix("ok ").map(str::to_owned));
        }
        if line == "start" {
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

    /// Where the machine stands, in millimetres.
    fn ask_place(&mut self) -> Result<[f64; 2], StageError> {
        let answers = self.command("M114")?;
        answers.iter().find_map(|answer| place_in(answer)).ok_or_else(|| StageError::Protocol {
            from: self.lines.name(),
            found: answers.join(" / "),
            expected: "X:0.00 Y:0.00 ... of M114".into(),
        })
    }

    /// Takes what came meanwhile. Whether anything did.
    fn listen(&mut self, sent: &str) -> Result<bool, StageError> {
        /// More than comes between two calls.
        const MOST: usize = 64;
        for heard in 0..MOST {
            match self.lines.next(Instant::now())? {
                Some(line) => self.take(line, sent).map(drop)?,
                None => return Ok(heard > 0),
            }
        }
        Ok(true)
    }

    fn restarted(&self) -> StageError {
        StageError::Restarted { by: self.lines.name() }
    }

    fn is_moving(&self) -> bool {
        matches!(self.motion, Motion::Until { .. } | Motion::Ending { .. })
    }
}

impl<P: Read + Write> Stage for Marlin<P> {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.admit(position)?;
        let start = self.start.ok_or_else(|| self.restarted())?;
        if self.is_moving() {
            self.stop()?;
        }
        self.command("G21")?;
        self.command("G90")?;
        let target = to_machine(start, position);
        let duration = Duration::from_secs_f64(distance(self.place, target) / self.limits.speed_mm_s);
        // From here on it may move, even if the line seems not to be sent.
        self.motion = Motion::Until { due: Instant::now() + duration, duration };
        self.place = target;
        self.command(&linear(target, &self.limits)).map(drop)
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        let is_heard = self.listen("M400")?;
        let now = Instant::now();
        match self.motion {
            Motion::None => Ok(false),
            Motion::Done => Ok(true),
            Motion::Until { due, .. } if now < due => Ok(false),
            Motion::Until { duration, .. } => {
                self.motion = Motion::Ending { asked: now, heard: now, duration };
                self.send("M400").map(|()| false)
            }
            Motion::Ending { .. } if self.unanswered == 0 => {
                self.motion = Motion::Done;
                Ok(true)
            }
            Motion::Ending { asked, heard, duration } => {
                let heard = if is_heard { now } else { heard };
                self.motion = Motion::Ending { asked, heard, duration };
                let (by, Limits { silence_timeout, stall_timeout, .. }) = (self.lines.name(), self.limits);
                // A machine that is slower than it was told to be may need as long again.
                match (now - heard > duration + silence_timeout, heard - asked > duration + stall_timeout) {
                    (true, _) => Err(StageError::Silent { from: by, after: now - heard }),
                    (_, true) => Err(StageError::Late { by, after: now - asked }),
                    _ => Ok(false),
                }
            }
        }
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        let start = self.start.ok_or_else(|| self.restarted())?;
        match self.is_moving() {
            true => Ok(None),
            false => self.ask_place().map(|place| Some(to_position(start, place))),
        }
    }

    /// Tells the machine to stop, and asks where it stands then.
    fn stop(&mut self) -> Result<(), StageError> {
        self.motion = Motion::None;
        self.command("M410")?;
        self.place = self.ask_place()?;
        Ok(())
    }
}

impl<P: Read + Write> Drop for Marlin<P> {
    fn drop(&mut self) {
        if self.is_moving() {
            // Nobody is left to be told.
            let _ = self.stop();
        }
    }
}

/// The place in an answer to `M114`, such as `X:0.00 Y:127.00 Z:145.00 E:0.00 Count X: 0 Y:10160 Z:116000`.
fn place_in(answer: &str) -> Option<[f64; 2]> {
    let number = |name: &str| {
        let rest = answer.split_once(name)?.1.trim_start();
        coordinate(rest.split(char::is_whitespace).next()?)
    };
    Some([number("X:")?, number("Y:")?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places() {
        assert_eq!(place_in("X:0.50 Y:127.00 Z:145.00 E:0.00 Count X: 0 Y:10160 Z:116000"), Some([0.5, 127.0]));
        assert_eq!(place_in("X: -1.00 Y: 2.00"), Some([-1.0, 2.0]));
        assert_eq!(place_in("X:nan Y:0"), None);
        assert_eq!(place_in("T:20.0"), None);
    }
}
