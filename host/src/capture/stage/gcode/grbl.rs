//! A machine with Grbl 1.1, or a compatible firmware (FluidNC, grblHAL), after Grbl's interface
//! documentation.
//!
//! Moves are lines `G53 G1`, in machine coordinates, which offsets do not affect. A status report is
//! requested with `?` at any time. To stop, a feed hold `!` decelerates the machine to a standstill, and a
//! soft reset discards the move without losing the position.

use std::{
    io::{Read, Write},
    mem,
    time::{Duration, Instant},
};

use multiscopic_core::capture::{Position, Stage};

use super::line_port::{LinePort, distance, linear_move, parse_coordinate, to_machine, to_position};
use crate::capture::stage::{
    error::StageError,
    limits::{Limits, StallTimer},
    posed::{PosedStage, Tracking},
};

/// The distance from its target at which the machine has arrived, in millimetres: a few steps of a coarse machine.
const TOLERANCE_MM: f64 = 0.05;

/// A machine with Grbl.
///
/// Each call queries the machine and waits for the answer: milliseconds as a rule, and at most
/// [`Limits::silence_timeout`] for each line. Dropping it stops any move.
pub struct Grbl<P: Read + Write> {
    link: GrblLink<P>,
    limits: Limits,
    /// Machine coordinates when it was opened, in millimetres.
    start: [f64; 2],
    current_move: Option<Move>,
}

#[derive(Clone, Copy, Debug)]
struct Move {
    /// Machine coordinates in millimetres.
    target: [f64; 2],
    stall_timer: StallTimer,
    is_done: bool,
}

impl<P: Read + Write> Grbl<P> {
    /// Takes over a port at which Grbl has answered.
    pub(super) fn open(port: LinePort<P>, limits: &Limits) -> Result<Self, StageError> {
        let mut link = GrblLink::open(port, limits.silence_timeout)?;
        let status = link.status()?;
        link.check_state(&status, &["Idle"])?;
        Ok(Grbl { link, limits: *limits, start: status.coordinates, current_move: None })
    }
}

impl<P: Read + Write> Stage for Grbl<P> {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.check_reach(position)?;
        if self.current_move.is_some_and(|current| !current.is_done) {
            self.stop()?;
        }
        // Only now: a restart may be among what is read while the machine stops.
        self.link.check_not_restarted()?;
        let status = self.link.status()?;
        self.link.check_state(&status, &["Idle", "Run"])?;
        let target = to_machine(self.start, position);
        // Set before sending: the machine may move even if sending seems to fail.
        let stall_timer = StallTimer::start(distance(status.coordinates, target), 0.0, self.link.now());
        self.current_move = Some(Move { target, stall_timer, is_done: false });
        self.link.command(&format!("G90 G21 G94 G53 {}", linear_move(target, &self.limits))).map(drop)
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        self.link.check_not_restarted()?;
        let status = self.link.status()?;
        self.link.check_state(&status, &["Idle", "Run"])?;
        let Some(mut current) = self.current_move else { return Ok(false) };
        let distance = distance(status.coordinates, current.target);
        // `Idle` is not enough: the machine is also idle for a moment before it starts to move.
        current.is_done = status.state == "Idle" && distance <= TOLERANCE_MM;
        let after = current.stall_timer.update(distance, self.link.now());
        self.current_move = Some(current);
        match current.is_done || after <= self.limits.stall_timeout {
            true => Ok(current.is_done),
            false => Err(StageError::Stalled { distance_um: (distance * 1e3) as u32, after }),
        }
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        self.link.check_not_restarted()?;
        Ok(Some(to_position(self.start, self.link.status()?.coordinates)))
    }

    /// Holds the machine until it stands still, then resets it softly. The position stays known, unless the hold fails and the
    /// reset stops the machine abruptly: then it is locked.
    fn stop(&mut self) -> Result<(), StageError> {
        self.current_move = None;
        let _ = self.link.feed_hold();
        self.link.soft_reset()?;
        self.link.check_standstill()
    }
}

impl<P: Read + Write> PosedStage for Grbl<P> {
    fn tracking(&self) -> Tracking {
        Tracking::Measured
    }
}

impl<P: Read + Write> Drop for Grbl<P> {
    fn drop(&mut self) {
        if self.current_move.is_some_and(|current| !current.is_done) {
            // There is nobody to report an error to.
            let _ = self.stop();
        }
    }
}

/// The time in which a machine that still moves reports another place.
const STANDSTILL: Duration = Duration::from_millis(100);

/// Real-time commands are single bytes, which Grbl takes at any time.
const STATUS_QUERY: u8 = b'?';
const FEED_HOLD: u8 = b'!';
const SOFT_RESET: u8 = 0x18;

/// A connection to Grbl.
struct GrblLink<P> {
    port: LinePort<P>,
    parser: StatusParser,
    silence_timeout: Duration,
    /// True if Grbl has restarted by itself, so that its coordinates are void.
    has_restarted: bool,
}

impl<P: Read + Write> GrblLink<P> {
    /// Takes over a port at which Grbl has answered.
    fn open(port: LinePort<P>, silence_timeout: Duration) -> Result<GrblLink<P>, StageError> {
        let mut link = GrblLink { port, parser: StatusParser::new(1.0), silence_timeout, has_restarted: false };
        // In other states Grbl refuses `$$`. The unit of this status is not known yet.
        let status = link.status()?;
        link.check_state(&status, &["Idle"])?;
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
        if link.reports_inches(&settings)? {
            link.parser = StatusParser::new(25.4);
        }
        Ok(link)
    }

    /// Returns true if it reports inches: setting 13. FluidNC before version 3.9.4 has that in its configuration alone.
    fn reports_inches(&mut self, settings: &[String]) -> Result<bool, StageError> {
        let value = |lines: &[String], name: &str| {
            let values: Vec<_> = lines.iter().filter_map(|line| line.split_once(name)).collect();
            values.into_iter().find_map(|(_, value)| match value.split_whitespace().next()? {
                "0" | "false" => Some(false),
                "1" | "true" => Some(true),
                _ => None,
            })
        };
        if let Some(inches) = value(settings, "$13=") {
            return Ok(inches);
        }
        match self.command("$/report_inches") {
            Ok(answers) => value(&answers, "report_inches="),
            Err(StageError::Refused { .. }) => None,
            Err(error) => return Err(error),
        }
        .ok_or_else(|| StageError::NotReady {
            found: format!("{} does not tell if it reports positions in millimetres or inches ($13)", self.port.name()),
            advice: "send $13=0, and if it is refused, update the firmware (FluidNC: 3.9.4 or later)",
        })
    }

    /// The current time.
    fn now(&self) -> Instant {
        self.port.now()
    }

    /// Sends a line, and returns the answers before `ok`.
    fn command(&mut self, line: &str) -> Result<Vec<String>, StageError> {
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
                    let reason = describe_error(code);
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
            return Err(self.alarm(describe_alarm(code)));
        }
        if is_banner(&line) {
            self.has_restarted = true;
            return Err(self.restarted());
        }
        Ok(line)
    }

    /// Queries the machine's state and coordinates.
    fn status(&mut self) -> Result<Status, StageError> {
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

    /// Fails unless the machine is in one of these states.
    fn check_state(&self, status: &Status, allowed: &[&str]) -> Result<(), StageError> {
        let advice = match status.state.split(':').next().unwrap_or_default() {
            state if allowed.contains(&state) => return Ok(()),
            "Alarm" => return Err(self.alarm("it is locked".into())),
            "Run" | "Jog" | "Home" => "wait until it stands still",
            _ => "release or reset it at its panel",
        };
        let found = format!("{} is in state {}", self.port.name(), status.state);
        Err(StageError::NotReady { found, advice })
    }

    /// Fails if the machine has restarted by itself.
    fn check_not_restarted(&self) -> Result<(), StageError> {
        if self.has_restarted { Err(self.restarted()) } else { Ok(()) }
    }

    /// Decelerates the machine to a standstill.
    fn feed_hold(&mut self) -> Result<(), StageError> {
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
    fn soft_reset(&mut self) -> Result<(), StageError> {
        self.port.send_bytes(&[SOFT_RESET])?;
        let deadline = self.now() + self.silence_timeout;
        while !is_banner(&self.port.expect(deadline)?) {}
        Ok(())
    }

    /// Waits until two reports, some time apart, tell the same place.
    fn check_standstill(&mut self) -> Result<(), StageError> {
        let deadline = self.now() + self.silence_timeout;
        let mut place = self.status()?.coordinates;
        while self.now() < deadline {
            self.port.wait(STANDSTILL);
            let last = mem::replace(&mut place, self.status()?.coordinates);
            if place == last {
                return Ok(());
            }
        }
        Err(StageError::StillMoving { after: self.silence_timeout })
    }

    fn alarm(&self, reason: String) -> StageError {
        StageError::Alarm { by: self.port.name(), reason }
    }

    fn restarted(&self) -> StageError {
        StageError::Restarted { by: self.port.name() }
    }
}

/// Returns true if this line says that Grbl has started.
pub fn is_banner(line: &str) -> bool {
    line.get(..4).is_some_and(|start| start.eq_ignore_ascii_case("grbl")) && line.contains("'$'")
}

/// A status report.
#[derive(Clone, Debug, PartialEq)]
struct Status {
    /// The machine's state, such as `Idle` or `Hold:0`.
    state: String,
    /// Machine coordinates in millimetres.
    coordinates: [f64; 2],
}

/// Parses status reports. Grbl reports work coordinates if it is configured to, and their offset only now and
/// then.
#[derive(Clone, Debug)]
struct StatusParser {
    /// The unit of reported coordinates, in millimetres.
    unit_mm: f64,
    /// From work to machine coordinates, in that unit.
    work_offset: Option<[f64; 2]>,
}

impl StatusParser {
    /// For reports in units of `unit_mm` millimetres.
    fn new(unit_mm: f64) -> StatusParser {
        StatusParser { unit_mm, work_offset: None }
    }

    /// Parses a report. `None` if it does not tell the machine coordinates.
    fn parse(&mut self, report: &str) -> Option<Status> {
        // A number in a report that broke off may lack digits.
        let mut fields = report.strip_prefix('<')?.strip_suffix('>')?.split('|');
        let state = fields.next()?.to_owned();
        let (mut machine, mut work) = (None, None);
        for (name, value) in fields.filter_map(|field| field.split_once(':')) {
            let mut numbers = value.split(',').map(parse_coordinate);
            let mut xy = || Some([numbers.next()??, numbers.next()??]);
            match name {
                "MPos" => machine = xy(),
                "WPos" => work = xy(),
                "WCO" => self.work_offset = xy(),
                _ => {}
            }
        }
        let from_work = || Some([work?[0] + self.work_offset?[0], work?[1] + self.work_offset?[1]]);
        let coordinates = machine.or_else(from_work)?.map(|number| number * self.unit_mm);
        Some(Status { state, coordinates })
    }
}

/// Describes an error code. Only those that a move can cause are explained.
fn describe_error(code: &str) -> String {
    let meaning = match code {
        "8" => "it is not idle",
        "9" => "it is locked: home or unlock it",
        "13" => "its safety door is open",
        "15" | "33" => "the target is out of the machine's travel",
        "20" | "29" => "it does not know this G-code",
        _ => "see its manual",
    };
    format!("error {code}, {meaning}")
}

/// Describes an alarm code.
fn describe_alarm(code: &str) -> String {
    let meaning = match code {
        "1" => "a limit switch was hit",
        "2" => "the target is out of the machine's travel",
        "3" => "it was reset while it moved",
        "6" | "7" | "8" | "9" => "homing failed",
        _ => "see its manual",
    };
    format!("alarm {code}, {meaning}")
}

#[cfg(test)]
mod tests {
    use std::{io, sync::Arc};

    use super::*;
    use crate::capture::SystemClock;

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
        let port = Port(b"<Idle|MPos:1.000,2.000,0.000|FS:0,0>\r\nok\r\nerror:20\r\nok\r\n$0=10\r\n$13=1\r\nok\r\n<Idle|MPos:1.000,2.000,0.000|FS:0,0>\r\n");
        let patience = Duration::from_secs(60);
        let mut link = GrblLink::open(LinePort::new(port, "port", patience, Arc::new(SystemClock)), patience).unwrap();
        assert_eq!(link.status().unwrap().coordinates, [25.4, 50.8]);
    }

    #[test]
    fn a_unit_that_is_not_told_is_asked_for() {
        let open = |bytes| {
            let patience = Duration::from_millis(50);
            let port = LinePort::new(Port(bytes), "port", patience, Arc::new(SystemClock));
            GrblLink::open(port, patience).map(|link| link.parser.unit_mm).map_err(|error| error.to_string())
        };
        let (inches, millimetres) = (open(b"<Idle|MPos:0,0,0>\r\n$10=1\r\nok\r\n$/report_inches=true\r\nok\r\n"), Ok(1.0));
        assert_eq!(inches, Ok(25.4));
        assert_eq!(open(b"<Idle|MPos:0,0,0>\r\n$10=1\r\nok\r\n/report_inches=false\r\nok\r\n"), millimetres);
        assert_eq!(open(b"<Idle|MPos:0,0,0>\r\n$13=0 (report inches, bool)\r\nok\r\n"), millimetres);
        for unknown in [&b"<Idle|MPos:0,0,0>\r\n$10=1\r\nok\r\nerror:3\r\n"[..], b"<Idle|MPos:0,0,0>\r\n$13=?\r\nok\r\nok\r\n"] {
            let message = open(unknown).unwrap_err();
            assert!(message.contains("does not tell if it reports positions in millimetres or inches"), "{message}");
        }
        for state in ["Run", "Hold:0", "Check", "Jog", "Door:0"] {
            let bytes: &'static [u8] = format!("<{state}|MPos:0,0,0>\r\nerror:8\r\n").into_bytes().leak();
            let message = open(bytes).unwrap_err();
            assert!(message.contains(&format!("is in state {state}")), "{message}");
        }
    }

    #[test]
    fn reports_in_machine_and_work_coordinates() {
        let mut parser = StatusParser::new(1.0);
        let coordinates =
            |parser: &mut StatusParser, report: &str| parser.parse(&format!("<{report}>")).map(|status| status.coordinates);
        assert_eq!(coordinates(&mut parser, "Idle|MPos:1.000,-2.500,0.000|FS:0,0"), Some([1.0, -2.5]));
        // Work coordinates need their offset, which is remembered.
        assert_eq!(coordinates(&mut parser, "Idle|WPos:1.000,2.000,0.000|FS:0,0"), None);
        assert_eq!(coordinates(&mut parser, "Hold:0|WPos:1.000,2.000,0.000|WCO:10.000,20.000,0.000"), Some([11.0, 22.0]));
        assert_eq!(coordinates(&mut parser, "Run|WPos:2.000,2.000,0.000|Ov:100,100,100"), Some([12.0, 22.0]));
        let mut inches = StatusParser::new(25.4);
        assert_eq!(coordinates(&mut inches, "Idle|MPos:1.000,0.500,0.000"), Some([25.4, 12.7]));
        for report in ["", "Idle", "Idle|MPos:", "Idle|MPos:1", "Idle|MPos:1,x", "Idle|MPos:nan,0", "Idle|MPos:1e9,0", "|:|,:"] {
            assert_eq!(coordinates(&mut inches, report), None, "{report}");
        }
    }

    #[test]
    fn a_report_that_breaks_off_tells_nothing() {
        let report = "<Idle|WPos:1.000,2.000,0.000|FS:0,0|WCO:10.000,20.000,0.000>";
        let mut parser = StatusParser::new(1.0);
        assert!((0..report.len()).all(|length| parser.parse(&report[..length]).is_none()));
        // Not even the offset.
        assert_eq!(parser.parse("<Idle|WPos:1.000,2.000,0.000>"), None);
        assert!(parser.parse(report).is_some());
    }

    #[test]
    fn banners() {
        let banners = [
            "Grbl 1.1h ['$' for help]",
            "GrblHAL 1.1f ['$' or '$HELP' for help]",
            "Grbl 3.7 [FluidNC v3.7.8 (wifi) '$' for help]",
        ];
        assert_eq!(banners.map(is_banner), [true; 3]);
        assert_eq!(["grb", "[VER:1.1h.20190825:]", "éé", "ok"].map(is_banner), [false; 4]);
    }
}
