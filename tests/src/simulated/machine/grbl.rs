//! The part of Grbl 1.1 that moves a machine, after its documentation.

use super::mechanics::{ACCELERATION, Control, Fault, Machine, value, words};

/// The offset from machine to work coordinates in millimetres, as if G54 had been set.
const OFFSET: [f64; 2] = [-100.0, 40.0];

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
