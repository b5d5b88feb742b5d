//! The mechanics of a machine, and the parts of Grbl 1.1 and of the RepRap family that move it, after their documentation.

use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

use crate::simulated::pose::Motion;

/// Acceleration in millimetres per second squared.
const ACCELERATION: f64 = 2000.0;

/// A fault of the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Fault {
    /// Nothing.
    #[default]
    None,
    /// Each move hits a limit switch.
    LimitSwitch {
        /// The distance after which it happens.
        after_mm: f64,
    },
    /// It stands still but reports that it moves.
    Stuck,
    /// It sends nothing.
    Silent,
    /// It rejects every move.
    Refusing,
    /// It ignores orders to stop. Not in the RepRap family, which has none.
    Unstoppable,
    /// It cuts moves off at an X in millimetres, without a word. In the RepRap family only.
    SoftLimit {
        /// The largest X.
        at_x: f64,
    },
    /// Another device is connected, which sends lines of its own.
    OtherProtocol,
}

/// The state of the mechanics and of the electronics.
pub(super) struct Machine {
    /// The time of this state.
    pub now: Instant,
    /// Position in millimetres.
    pub place: [f64; 2],
    pub motion: Option<Motion>,
    pub fault: Fault,
    pub heard: Vec<String>,
    /// The time at which the firmware will have booted, while it has not.
    pub restart: Option<Instant>,
    pub is_locked: bool,
    pub is_unplugged: bool,
    /// True if moves take no time.
    pub is_instant: bool,
}

impl Machine {
    /// A machine that stands still at `place`, in millimetres, at time `now`.
    pub fn at(place: [f64; 2], now: Instant) -> Machine {
        Machine {
            now,
            place,
            motion: None,
            fault: Fault::None,
            heard: Vec::new(),
            restart: None,
            is_locked: false,
            is_unplugged: false,
            is_instant: false,
        }
    }

    /// Lets it move until `now`.
    pub fn advance(&mut self, now: Instant) {
        // Another thread may have asked for the time before this one.
        self.now = now.max(self.now);
        let Some(motion) = &mut self.motion else { return };
        motion.advance(self.now, if self.fault == Fault::Stuck { 0.0 } else { 1.0 }, f64::INFINITY);
        if matches!(self.fault, Fault::LimitSwitch { after_mm } if motion.gone() * 1e3 >= after_mm) {
            motion.halt();
            self.is_locked = true;
        }
        let [x, y, ..] = motion.pose();
        self.place = [x * 1e3, y * 1e3];
        if motion.has_ended() {
            self.motion = None;
        }
    }

    /// Starts a move to `target` in millimetres at `speed` in millimetres per second.
    pub fn go(&mut self, target: [f64; 2], speed: f64) {
        if self.is_instant {
            self.place = target;
            return;
        }
        let pose = |place: [f64; 2]| [place[0] * 1e-3, place[1] * 1e-3, 0.0, 0.0, 0.0, 0.0];
        self.motion = Some(Motion::new(pose(self.place), pose(target), speed * 1e-3, ACCELERATION * 1e-3, self.now));
    }
}

/// The firmware of a machine.
pub(super) trait Control: Send {
    /// The greeting it sends when it starts.
    fn start(&mut self) -> &'static str;

    /// Processes a byte and returns the answer.
    fn take(&mut self, byte: u8, machine: &mut Machine) -> String;

    /// The words that it sends unasked.
    fn say(&mut self, machine: &mut Machine) -> String;
}

/// Splits a line of G-code into its words: letters and their numbers. `None` if it is not G-code.
fn words(line: &str) -> Option<Vec<(char, f64)>> {
    let ends = line.char_indices().skip(1).filter(|(_, c)| c.is_ascii_uppercase()).map(|(i, _)| i).chain([line.len()]);
    let mut begin = 0;
    let words = ends.map(|end| {
        let word = &line[std::mem::replace(&mut begin, end)..end];
        let letter = word.chars().next().filter(char::is_ascii_uppercase)?;
        let number: f64 = word[1..].trim().parse().ok()?;
        Some((letter, number))
    });
    words.collect()
}

/// The number of the first word with a letter.
fn value(words: &[(char, f64)], letter: char) -> Option<f64> {
    words.iter().find(|(found, _)| *found == letter).map(|(_, number)| *number)
}

/// The offset from machine to work coordinates in millimetres, as if G54 had been set.
const OFFSET: [f64; 2] = [-100.0, 40.0];

/// Grbl, with work coordinates.
pub struct Grbl {
    line: Vec<u8>,
    /// True if it reports work coordinates in inches.
    is_inches: bool,
    is_absolute: bool,
    is_held: bool,
    was_locked: bool,
    reports: u32,
}

impl Grbl {
    pub fn new(is_inches: bool) -> Grbl {
        Grbl { line: Vec::new(), is_inches, is_absolute: true, is_held: false, was_locked: false, reports: 0 }
    }

    fn state(&self, machine: &Machine) -> &'static str {
        match (machine.is_locked, self.is_held, machine.motion.is_some()) {
            (true, ..) => "Alarm",
            (_, true, true) => "Hold:1",
            (_, true, false) => "Hold:0",
            (_, false, true) => "Run",
            (_, false, false) => "Idle",
        }
    }

    fn report(&mut self, machine: &Machine) -> String {
        let unit = if self.is_inches { 25.4 } else { 1.0 };
        let offset = if self.is_inches { OFFSET } else { [0.0; 2] };
        let place = [0, 1].map(|i| (machine.place[i] - offset[i]) / unit);
        let name = if self.is_inches { "WPos" } else { "MPos" };
        let mut report = format!("<{}|{name}:{:.4},{:.4},0.0000|FS:0,0", self.state(machine), place[0], place[1]);
        // Grbl reports the offset only now and then.
        if self.reports.is_multiple_of(3) {
            report += &format!("|WCO:{:.4},{:.4},0.0000", OFFSET[0] / unit, OFFSET[1] / unit);
        }
        self.reports += 1;
        report + ">\r\n"
    }

    fn execute(&mut self, line: &str, machine: &mut Machine) -> Result<String, u8> {
        match line {
            "" => return Ok(String::new()),
            "$$" => return Ok(format!("$0=10\r\n$10={}\r\n$13={}\r\n", u8::from(!self.is_inches), u8::from(self.is_inches))),
            _ if machine.is_locked => return Err(9),
            _ => {}
        }
        let words = words(line).ok_or(1)?;
        let (mut moves, mut in_machine) = (false, false);
        for &(letter, number) in &words {
            match (letter, number as u8) {
                ('G', 0 | 1) => moves = true,
                ('G', 53) => in_machine = true,
                ('G', 90) => self.is_absolute = true,
                ('G', 91) => self.is_absolute = false,
                ('G', 21 | 94) | ('X' | 'Y' | 'F', _) => {}
                _ => return Err(20),
            }
        }
        if !moves {
            return Ok(String::new());
        }
        let speed = value(&words, 'F').filter(|speed| *speed > 0.0).ok_or(22)? / 60.0;
        if machine.fault == Fault::Refusing {
            return Err(33);
        }
        let base = match (self.is_absolute, in_machine) {
            (true, true) => [0.0; 2],
            (true, false) => OFFSET,
            (false, _) => machine.place,
        };
        let target =
            [('X', 0), ('Y', 1)].map(|(axis, i)| value(&words, axis).map_or(machine.place[i], |number| base[i] + number));
        machine.go(target, speed);
        Ok(String::new())
    }
}

impl Control for Grbl {
    fn start(&mut self) -> &'static str {
        (self.is_held, self.is_absolute) = (false, true);
        self.line.clear();
        "\r\nGrbl 1.1h ['$' for help]\r\n"
    }

    fn take(&mut self, byte: u8, machine: &mut Machine) -> String {
        match byte {
            b'?' => self.report(machine),
            b'!' => {
                machine.heard.push("!".into());
                if machine.fault != Fault::Unstoppable && !machine.is_locked {
                    self.is_held = true;
                    if let Some(motion) = &mut machine.motion {
                        motion.stop(ACCELERATION * 1e-3);
                    }
                }
                String::new()
            }
            0x18 => {
                machine.heard.push("^X".into());
                let is_lost = machine.motion.take().is_some();
                machine.is_locked |= is_lost;
                self.was_locked = machine.is_locked;
                let alarm = if is_lost { "ALARM:3\r\n" } else { "" };
                format!("{alarm}{}", self.start())
            }
            b'\n' | b'\r' => {
                let line = String::from_utf8_lossy(&std::mem::take(&mut self.line)).into_owned();
                if !line.is_empty() {
                    machine.heard.push(line.clone());
                }
                match self.execute(&line, machine) {
                    Ok(answer) => answer + "ok\r\n",
                    Err(code) => format!("error:{code}\r\n"),
                }
            }
            byte => {
                self.line.push(byte);
                String::new()
            }
        }
    }

    fn say(&mut self, machine: &mut Machine) -> String {
        let is_alarm = machine.is_locked && !self.was_locked && matches!(machine.fault, Fault::LimitSwitch { .. });
        self.was_locked = machine.is_locked;
        if is_alarm { "ALARM:1\r\n".into() } else { String::new() }
    }
}

/// The interval of `busy` messages. Marlin's is longer.
const BUSY: Duration = Duration::from_millis(200);

/// A firmware of the RepRap family, with its words.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RepRapKind {
    /// Marlin 2, which says when it is busy.
    Marlin,
    /// Marlin 1 of 2012, without blanks between coordinates.
    OldMarlin,
    /// Klipper, which answers on the line of `ok`.
    Klipper,
    /// RepRapFirmware 3.
    RepRapFirmware,
    /// Repetier 1.
    Repetier,
    /// Smoothieware, which reports to `?` as Grbl does.
    Smoothieware,
    /// Teacup, which the drivers do not know.
    Other,
}

impl RepRapKind {
    /// The answer to `M115`.
    fn name(self) -> &'static str {
        match self {
            RepRapKind::Marlin => {
                "FIRMWARE_NAME:Marlin 2.1.2 (Nov  1 2023) SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0\n\
                 Cap:EEPROM:1\nCap:EMERGENCY_PARSER:0\nok\n"
            }
            RepRapKind::OldMarlin => "FIRMWARE_NAME:Marlin V1; Sprinter/grbl mashup for gen6 PROTOCOL_VERSION:1.0\nok\n",
            RepRapKind::Klipper => "ok FIRMWARE_VERSION:v0.12.0-85 FIRMWARE_NAME:Klipper\n",
            RepRapKind::RepRapFirmware => {
                "FIRMWARE_NAME: RepRapFirmware for Duet 3 Mini 5+ FIRMWARE_VERSION: 3.5.2 ELECTRONICS: Duet 3 Mini5plus WiFi\nok\n"
            }
            RepRapKind::Repetier => "FIRMWARE_NAME:Repetier_1.0.3 PROTOCOL_VERSION:1.0 REPETIER_PROTOCOL:3\nok\n",
            RepRapKind::Other => "FIRMWARE_NAME:Teacup FIRMWARE_URL:http://github.com/traumflug/Teacup_Firmware/\nok\n",
            RepRapKind::Smoothieware => {
                "FIRMWARE_NAME:Smoothieware, FIRMWARE_VERSION:edge-94de12c, PROTOCOL_VERSION:1.0, X-GRBL_MODE:0\nok\n"
            }
        }
    }

    /// The answer to `M114`.
    fn report(self, [x, y]: [f64; 2]) -> String {
        let [a, b] = [x, y].map(|place| (place * 80.0).round());
        match self {
            RepRapKind::Marlin => format!("X:{x:.2} Y:{y:.2} Z:0.00 E:0.00 Count X:{a} Y:{b} Z:0\nok\n"),
            RepRapKind::OldMarlin => {
                format!("X:{x:.2}Y:{y:.2}Z:0.00E:0.00 Count X: {x:.2}Y:{y:.2}Z:0.00\nok\n")
            }
            RepRapKind::Klipper => format!("ok X:{x:.3} Y:{y:.3} Z:0.000 E:0.000\n"),
            RepRapKind::RepRapFirmware => {
                format!("X:{x:.3} Y:{y:.3} Z:0.000 E:0.000 Count {a} {b} 0 Machine {x:.3} {y:.3} 0.000 Bed comp 0.000\nok\n")
            }
            RepRapKind::Repetier | RepRapKind::Other => format!("X:{x:.2} Y:{y:.2} Z:0.000 E:0.0000\nok\n"),
            RepRapKind::Smoothieware => format!("ok C: X:{x:.4} Y:{y:.4} Z:0.0000\n"),
        }
    }

    /// The answer to an unknown line.
    fn unknown(self, line: &str) -> String {
        match self {
            RepRapKind::Klipper => format!("// Unknown command:\"{line}\"\nok\n"),
            RepRapKind::RepRapFirmware => format!("Error: Bad command: {line}\nok\n"),
            RepRapKind::Smoothieware => "error:Unsupported command\n".into(),
            _ => format!("echo:Unknown command: \"{line}\"\nok\n"),
        }
    }

    /// The answer to a move before homing.
    fn refusal(self) -> &'static str {
        match self {
            RepRapKind::Klipper => "!! Must home axis first: 120.500 80.250 0.000 [0.000]\nok\n",
            RepRapKind::RepRapFirmware => "Error: G0/G1: insufficient axes homed\nok\n",
            RepRapKind::Smoothieware => "error:Alarm lock\n",
            _ => "echo:Home XY First\nok\n",
        }
    }
}

/// A firmware of the RepRap family. Each line waits for those before it, and nothing ends a move.
pub struct RepRap {
    kind: RepRapKind,
    line: Vec<u8>,
    queue: VecDeque<String>,
    is_relative: bool,
    /// The time at which it last reported that it is busy, while it waits for a motion to end.
    busy: Option<Instant>,
    is_halted: bool,
}

impl RepRap {
    pub fn new(kind: RepRapKind) -> RepRap {
        RepRap { kind, line: Vec::new(), queue: VecDeque::new(), is_relative: false, busy: None, is_halted: false }
    }

    fn execute(&mut self, line: &str, machine: &mut Machine) -> String {
        let kind = self.kind;
        let Some(words) = words(line) else { return kind.unknown(line) };
        match words.first().map(|&(letter, number)| (letter, number as u16)) {
            Some(('G', 0 | 1)) if machine.fault == Fault::Refusing => return kind.refusal().into(),
            Some(('G', 0 | 1)) => {
                let base = if self.is_relative { machine.place } else { [0.0; 2] };
                let mut target =
                    [('X', 0), ('Y', 1)].map(|(axis, i)| value(&words, axis).map_or(machine.place[i], |number| base[i] + number));
                if let Fault::SoftLimit { at_x } = machine.fault {
                    target[0] = target[0].min(at_x);
                }
                machine.go(target, value(&words, 'F').unwrap_or(60.0) / 60.0);
            }
            Some(('G', 21) | ('M', 400)) => {}
            Some(('G', 90)) => self.is_relative = false,
            Some(('G', 91)) => self.is_relative = true,
            Some(('M', 114)) => return kind.report(machine.place),
            Some(('M', 115)) => return kind.name().into(),
            _ => return kind.unknown(line),
        }
        "ok\n".into()
    }
}

impl Control for RepRap {
    fn start(&mut self) -> &'static str {
        *self = RepRap::new(self.kind);
        "start\necho: External Reset\necho:SD init fail\n"
    }

    fn take(&mut self, byte: u8, machine: &mut Machine) -> String {
        match byte {
            // Smoothieware answers as Grbl does.
            b'?' if self.kind == RepRapKind::Smoothieware => {
                let ([x, y], state) = (machine.place, if machine.motion.is_some() { "Run" } else { "Idle" });
                return format!("<{state}|MPos:{x:.4},{y:.4},0.0000|WPos:{x:.4},{y:.4},0.0000|F:4000.0,100.0>\n");
            }
            b'\n' | b'\r' => {
                let line = String::from_utf8_lossy(&std::mem::take(&mut self.line)).into_owned();
                if !line.is_empty() {
                    machine.heard.push(line.clone());
                    self.queue.push_back(line);
                }
            }
            byte => self.line.push(byte),
        }
        String::new()
    }

    fn say(&mut self, machine: &mut Machine) -> String {
        let mut said = String::new();
        if machine.is_locked && !self.is_halted {
            self.is_halted = true;
            return "Error:Printer halted. kill() called!\n".into();
        }
        while let Some(line) = self.queue.front().filter(|_| !machine.is_locked).cloned() {
            if line == "M400" && machine.motion.is_some() {
                let says_busy = self.kind == RepRapKind::Marlin && self.busy.is_none_or(|time| machine.now - time >= BUSY);
                if says_busy {
                    self.busy = Some(machine.now);
                    said += "echo:busy: processing\n";
                }
                break;
            }
            self.queue.pop_front();
            self.busy = None;
            said += &self.execute(&line, machine);
        }
        said
    }
}
