//! Talking to Grbl: commands and their answers, status queries, real-time commands.

use std::{
    io::{Read, Write},
    time::{Duration, Instant},
};

use super::status::{self, Status, StatusParser};
use crate::capture::stage::{error::StageError, gcode::line_port::LinePort};

/// Real-time commands are single bytes, which Grbl takes at any time.
const STATUS_QUERY: u8 = b'?';
const FEED_HOLD: u8 = b'!';
const SOFT_RESET: u8 = 0x18;

/// A connection to Grbl.
pub struct GrblLink<P> {
    port: LinePort<P>,
    parser: StatusParser,
    silence_timeout: Duration,
    /// True if Grbl has restarted by itself, so that its coordinates are void.
    has_restarted: bool,
}

impl<P: Read + Write> GrblLink<P> {
    /// Takes over a port at which Grbl has answered.
    pub fn open(port: LinePort<P>, silence_timeout: Duration) -> Result<GrblLink<P>, StageError> {
        let mut link = GrblLink { port, parser: StatusParser::new(1.0), silence_timeout, has_restarted: false };
        link.port.send("$$")?;
        let deadline = link.now() + silence_timeout;
        let mut refusal = None;
        let settings = loop {
            // Without settings, it is the late answer to an earlier line. That may be refused, too.
            match link.answers("$$", deadline) {
                Ok(answers) if answers.iter().any(|line| line.starts_with('$')) => break answers,
                Ok(_) => {}
                Err(error @ StageError::Refused { .. }) if refusal.is_none() => refusal = Some(error),
                Err(error @ StageError::Silent { .. }) => return Err(refusal.unwrap_or(error)),
                Err(error) => return Err(error),
            }
        };
        // Setting 13 makes it report inches.
        if settings.iter().any(|line| line.starts_with("$13=1")) {
            link.parser = StatusParser::new(25.4);
        }
        Ok(link)
    }

    /// The current time.
    pub fn now(&self) -> Instant {
        self.port.now()
    }

    /// Sends a line, and returns the answers before `ok`.
    pub fn command(&mut self, line: &str) -> Result<Vec<String>, StageError> {
        self.port.send(line)?;
        self.answers(line, self.now() + self.silence_timeout)
    }

    /// Receives the answers to `line` before `ok`.
    fn answers(&mut self, line: &str, deadline: Instant) -> Result<Vec<String>, StageError> {
        let mut answers = Vec::new();
        loop {
            let answer = self.receive(deadline)?;
            match answer.strip_prefix("error:") {
                _ if answer == "ok" => return Ok(answers),
                Some(code) => {
                    let reason = status::describe_error(code);
                    return Err(StageError::Refused { by: self.port.name(), line: line.into(), reason });
                }
                None => answers.push(answer),
            }
        }
    }

    /// Receives a line. Fails if it reports an alarm or a restart.
    fn receive(&mut self, deadline: Instant) -> Result<String, StageError> {
        let line = self.port.expect(deadline)?;
        if let Some(code) = line.strip_prefix("ALARM:") {
            return Err(self.alarm(status::describe_alarm(code)));
        }
        if status::is_banner(&line) {
            self.has_restarted = true;
            return Err(self.restarted());
        }
        Ok(line)
    }

    /// Queries the machine's state and coordinates.
    pub fn status(&mut self) -> Result<Status, StageError> {
        let deadline = self.now() + self.silence_timeout;
        // Again and again: a machine that reports work coordinates tells their offset only in some of the
        // reports.
        while self.now() < deadline {
            self.port.send_bytes(&[STATUS_QUERY])?;
            let report = loop {
                let line = self.receive(deadline)?;
                if line.starts_with('<') {
                    break line;
                }
            };
            if let Some(status) = self.parser.parse(&report) {
                return Ok(status);
            }
        }
        Err(StageError::Protocol {
            from: self.port.name(),
            found: "status reports without a position".into(),
            expected: "<Idle|MPos:0.000,0.000,0.000|...> of Grbl 1.1".into(),
        })
    }

    /// Fails unless the machine can move.
    pub fn check_ready(&self, status: &Status) -> Result<(), StageError> {
        match status.state.split(':').next().unwrap_or_default() {
            "Idle" | "Run" => Ok(()),
            "Alarm" => Err(self.alarm("it is locked".into())),
            _ => {
                let found = format!("{} is in state {}", self.port.name(), status.state);
                Err(StageError::NotReady { found, advice: "release or reset it at its panel" })
            }
        }
    }

    /// Fails if the machine has restarted by itself.
    pub fn check_not_restarted(&self) -> Result<(), StageError> {
        if self.has_restarted { Err(self.restarted()) } else { Ok(()) }
    }

    /// Decelerates the machine to a standstill.
    pub fn feed_hold(&mut self) -> Result<(), StageError> {
        let deadline = self.now() + self.silence_timeout;
        self.port.send_bytes(&[FEED_HOLD])?;
        while self.now() < deadline {
            // In `Hold:1` it is still decelerating. In other states there is no motion to hold.
            if !["Run", "Jog", "Hold:1"].contains(&self.status()?.state.as_str()) {
                return Ok(());
            }
        }
        Err(StageError::StillMoving { after: self.silence_timeout })
    }

    /// Resets the controller, which discards the move.
    pub fn soft_reset(&mut self) -> Result<(), StageError> {
        self.port.send_bytes(&[SOFT_RESET])?;
        let deadline = self.now() + self.silence_timeout;
        while !status::is_banner(&self.port.expect(deadline)?) {}
        Ok(())
    }

    fn alarm(&self, reason: String) -> StageError {
        StageError::Alarm { by: self.port.name(), reason }
    }

    fn restarted(&self) -> StageError {
        StageError::Restarted { by: self.port.name() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::SystemClock;
    use std::{io, sync::Arc};

    /// Brings these bytes, whatever is sent.
    struct Port(&'static [u8]);

    impl Read for Port {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            self.0.read(buffer)
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

    #[test]
    fn a_late_answer_does_not_hide_the_unit() {
        let port = Port(b"ok\r\nerror:20\r\nok\r\n$0=10\r\n$13=1\r\nok\r\n<Idle|MPos:1.000,2.000,0.000|FS:0,0>\r\n");
        let patience = Duration::from_secs(60);
        let mut link = GrblLink::open(LinePort::new(port, "port", patience, Arc::new(SystemClock)), patience).unwrap();
        assert_eq!(link.status().unwrap().coordinates, [25.4, 50.8]);
    }
}
