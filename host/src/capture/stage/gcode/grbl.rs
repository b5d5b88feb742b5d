//! A machine with Grbl 1.1, or one that speaks like it (FluidNC, grblHAL).
//!
//! After Grbl's documentation of its interface. Moves are lines `G53 G1`, in machine coordinates, which no offset changes. A status report is
//! asked for with `?` at any time; a feed hold `!` slows the machine to a stand, from where a soft reset forgets the move without losing the place.

use std::{
    io::{Read, Write},
    time::Instant,
};

use multiscopic_core::capture::{Position, Stage};

use super::{Lines, coordinate, distance, linear, to_machine, to_position};
use crate::capture::stage::{Limits, StageError};

/// How near the machine must report to be to where it was sent, in millimetres: some steps of a coarse one.
const NEAR_MM: f64 = 0.05;

const SOFT_RESET: u8 = 0x18;

/// Whether Grbl says that it has started.
pub fn is_banner(line: &str) -> bool {
    line.get(..4).is_some_and(|start| start.eq_ignore_ascii_case("grbl")) && line.contains("'$'")
}

/// A machine with Grbl.
///
/// Each call asks the machine and waits for the answer, [`Limits::silence_timeout`] at most for each line; that is some milliseconds
/// when all is well. When it is dropped, a motion is stopped.
pub struct Grbl<P: Read + Write> {
    lines: Lines<P>,
    limits: Limits,
    /// What it reports in, in millimetres.
    unit_mm: f64,
    /// From work to machine coordinates, in its unit.
    offset: Option<[f64; 2]>,
    /// Where it was when it was opened, in millimetres; `None` once that is lost.
    start: Option<[f64; 2]>,
    order: Option<Order>,
}

/// Where the machine was sent.
#[derive(Clone, Copy, Debug)]
struct Order {
    /// In machine coordinates, in millimetres.
    target: [f64; 2],
    /// How near it came, and when.
    nearest: f64,
    nearer_at: Instant,
    is_done: bool,
}

/// What the machine reports.
struct Report {
    state: String,
    /// In machine coordinates, in millimetres.
    place: [f64; 2],
}

impl<P: Read + Write> Grbl<P> {
    /// Takes over a machine that has said that it is Grbl.
    pub(super) fn open(lines: Lines<P>, limits: &Limits) -> Result<Self, StageError> {
        let mut grbl = Grbl { lines, limits: *limits, unit_mm: 1.0, offset: None, start: None, order: None };
        // It can be set to report inches.
        if grbl.command("$$")?.iter().any(|line| line.starts_with("$13=1")) {
            grbl.unit_mm = 25.4;
        }
        let report = grbl.report()?;
        grbl.ready(&report)?;
        grbl.start = Some(report.place);
        Ok(grbl)
    }

    /// Sends a line and gives what is answered before `ok`.
    fn command(&mut self, line: &str) -> Result<Vec<String>, StageError> {
        self.lines.send(line)?;
        let (mut answers, deadline) = (Vec::new(), Instant::now() + self.limits.silence_timeout);
        loop {
            let answer = self.answer(deadline)?;
            match answer.strip_prefix("error:") {
                _ if answer == "ok" => return Ok(answers),
                Some(code) => {
                    let reason = describe(code);
                    return Err(StageError::Refused { by: self.lines.name(), line: line.into(), reason });
                }
                None => answers.push(answer),
            }
        }
    }

    /// The next line, unless it tells of something bad.
    fn answer(&mut self, deadline: Instant) -> Result<String, StageError> {
        let line = self.lines.expect(deadline)?;
        if let Some(code) = line.strip_prefix("ALARM:") {
            return Err(self.alarm(describe_alarm(code)));
        }
        if is_banner(&line) {
            self.start = None;
            return Err(self.restarted());
        }
        Ok(line)
    }

    /// Asks where the machine is, and what it does.
    fn report(&mut self) -> Result<Report, StageError> {
        let deadline = Instant::now() + self.limits.silence_timeout;
        // Offsets are part of some reports only, and needed if it reports in work coordinates.
        while Instant::now() < deadline {
            self.lines.send_bytes(b"?")?;
            let line = loop {
                let line = self.answer(deadline)?;
                if let Some(report) = line.strip_prefix('<') {
                    break report.to_owned();
                }
            };
            if let Some(report) = self.read(line.trim_end_matches('>')) {
                return Ok(report);
            }
        }
        Err(StageError::Protocol {
            from: self.lines.name(),
            found: "status reports without a place".into(),
            expected: "<Idle|MPos:0.000,0.000,0.000|...> of Grbl 1.1".into(),
        })
    }

    /// Reads a status report. `None` if it does not say where the machine is.
    fn read(&mut self, report: &str) -> Option<Report> {
        let mut fields = report.split('|');
        let state = fields.next()?.to_owned();
        let (mut machine, mut work) = (None, None);
        for (name, value) in fields.filter_map(|field| field.split_once(':')) {
            let mut numbers = value.split(',').map(coordinate);
            let mut place = || Some([numbers.next()??, numbers.next()??]);
            match name {
                "MPos" => machine = place(),
                "WPos" => work = place(),
                "WCO" => self.offset = place(),
                _ => {}
            }
        }
        let from_work = || Some([work?[0] + self.offset?[0], work?[1] + self.offset?[1]]);
        let place = machine.or_else(from_work)?.map(|number| number * self.unit_mm);
        Some(Report { state, place })
    }

    /// Fails unless the machine can move.
    fn ready(&self, report: &Report) -> Result<(), StageError> {
        match report.state.split(':').next().unwrap_or_default() {
            "Idle" | "Run" => Ok(()),
            "Alarm" => Err(self.alarm("it is locked".into())),
            _ => {
                let found = format!("{} is in state {}", self.lines.name(), report.state);
                Err(StageError::NotReady { found, advice: "release or reset it at its panel" })
            }
        }
    }

    fn alarm(&self, reason: String) -> StageError {
        StageError::Alarm { by: self.lines.name(), reason }
    }

    fn restarted(&self) -> StageError {
        StageError::Restarted { by: self.lines.name() }
    }

    /// Slows the machine to a stand.
    fn hold(&mut self) -> Result<(), StageError> {
        let deadline = Instant::now() + self.limits.silence_timeout;
        self.lines.send_bytes(b"!")?;
        while Instant::now() < deadline {
            // Hold:1 is still slowing down, and any other state cannot be held.
            if !["Run", "Jog", "Hold:1"].contains(&self.report()?.state.as_str()) {
                return Ok(());
            }
        }
        Err(StageError::StillMoving { after: self.limits.silence_timeout })
    }

    /// Forgets the move.
    fn reset(&mut self) -> Result<(), StageError> {
        self.lines.send_bytes(&[SOFT_RESET])?;
        let deadline = Instant::now() + self.limits.silence_timeout;
        while !is_banner(&self.lines.expect(deadline)?) {}
        Ok(())
    }
}

impl<P: Read + Write> Stage for Grbl<P> {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.admit(position)?;
        let start = self.start.ok_or_else(|| self.restarted())?;
        if self.order.is_some_and(|order| !order.is_done) {
            self.stop()?;
        }
        let report = self.report()?;
        self.ready(&report)?;
        let target = to_machine(start, position);
        // From here on it may move, even if the line seems not to be sent.
        let nearest = distance(report.place, target);
        self.order = Some(Order { target, nearest, nearer_at: Instant::now(), is_done: false });
        self.command(&format!("G90 G21 G94 G53 {}", linear(target, &self.limits))).map(drop)
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        let report = self.report()?;
        self.ready(&report)?;
        let Some(mut order) = self.order else { return Ok(false) };
        let distance = distance(report.place, order.target);
        // It is idle for a moment before it begins.
        order.is_done = report.state == "Idle" && distance <= NEAR_MM;
        if distance < order.nearest {
            (order.nearest, order.nearer_at) = (distance, Instant::now());
        }
        self.order = Some(order);
        let after = order.nearer_at.elapsed();
        match order.is_done || after <= self.limits.stall_timeout {
            true => Ok(order.is_done),
            false => Err(StageError::Stalled { distance_um: (distance * 1e3) as u32, after }),
        }
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        let start = self.start.ok_or_else(|| self.restarted())?;
        Ok(Some(to_position(start, self.report()?.place)))
    }

    /// Holds the machine and waits until it stands, then resets it softly. Its place is known as before.
    fn stop(&mut self) -> Result<(), StageError> {
        self.order = None;
        let held = self.hold();
        // Also if it was not held: that stops it too, if not softly.
        let reset = self.reset();
        held.and(reset)
    }
}

impl<P: Read + Write> Drop for Grbl<P> {
    fn drop(&mut self) {
        if self.order.is_some_and(|order| !order.is_done) {
            // Nobody is left to be told.
            let _ = self.stop();
        }
    }
}

/// What the number of an error means, as far as a move can cause it.
fn describe(code: &str) -> String {
    let meaning = match code {
        "8" | "9" => "it is locked: home or unlock it",
        "13" => "its safety door is open",
        "15" | "33" => "the target is out of the machine's travel",
        "20" | "29" => "it does not know this G-code",
        _ => "see its manual",
    };
    format!("error {code}, {meaning}")
}

/// What the number of an alarm means.
fn describe_alarm(code: &str) -> String {
    let meaning = match code {
        "1" => "a limit switch was hit",
        "2" => "the target is out of the machine's travel",
        "3" => "it was reset while it moved",
        "6" | "7" | "8" | "9" => "it could not be homed",
        _ => "see its manual",
    };
    format!("alarm {code}, {meaning}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn grbl() -> Grbl<Cursor<Vec<u8>>> {
        let limits = Limits::default();
        let lines = Lines::new(Cursor::new(Vec::new()), "port", limits.silence_timeout);
        Grbl { lines, limits, unit_mm: 1.0, offset: None, start: None, order: None }
    }

    #[test]
    fn reports() {
        let mut grbl = grbl();
        let place = |grbl: &mut Grbl<_>, report: &str| grbl.read(report).map(|report| report.place);
        assert_eq!(place(&mut grbl, "Idle|MPos:1.000,-2.500,0.000|FS:0,0"), Some([1.0, -2.5]));
        // Work coordinates need their offset, which stays known.
        assert_eq!(place(&mut grbl, "Idle|WPos:1.000,2.000,0.000|FS:0,0"), None);
        assert_eq!(place(&mut grbl, "Hold:0|WPos:1.000,2.000,0.000|WCO:10.000,20.000,0.000"), Some([11.0, 22.0]));
        assert_eq!(place(&mut grbl, "Run|WPos:2.000,2.000,0.000|Ov:100,100,100"), Some([12.0, 22.0]));
        grbl.unit_mm = 25.4;
        assert_eq!(place(&mut grbl, "Idle|MPos:1.000,0.500,0.000"), Some([25.4, 12.7]));
        for report in ["", "Idle", "Idle|MPos:", "Idle|MPos:1", "Idle|MPos:1,x", "Idle|MPos:nan,0", "Idle|MPos:1e9,0", "|:|,:"] {
            assert_eq!(place(&mut grbl, report), None, "{report}");
        }
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
