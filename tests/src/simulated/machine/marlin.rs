//! The part of Marlin that moves a machine, after its documentation. Without an emergency parser, each line
//! waits for those before it.

use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

use super::mechanics::{Control, Fault, Machine, value, words};

/// The interval of `busy` messages. Marlin's is longer.
const BUSY: Duration = Duration::from_millis(200);

#[derive(Default)]
pub struct Marlin {
    line: Vec<u8>,
    queue: VecDeque<String>,
    is_relative: bool,
    /// The time at which it last reported that it is busy, while it waits for a motion to end.
    busy: Option<Instant>,
    is_halted: bool,
}

impl Marlin {
    fn execute(&mut self, line: &str, machine: &mut Machine) -> String {
        let unknown = format!("echo:Unknown command: \"{line}\"\nok\n");
        let Some(words) = words(line) else { return unknown };
        match words.first().map(|&(letter, number)| (letter, number as u16)) {
            Some(('G', 0 | 1)) if machine.fault == Fault::Refusing => return "Error:Axis not homed\nok\n".into(),
            Some(('G', 0 | 1)) => {
                let base = if self.is_relative { machine.place } else { [0.0; 2] };
                let target =
                    [('X', 0), ('Y', 1)].map(|(axis, i)| value(&words, axis).map_or(machine.place[i], |number| base[i] + number));
                machine.go(target, value(&words, 'F').unwrap_or(60.0) / 60.0);
            }
            Some(('G', 21) | ('M', 400)) => {}
            Some(('G', 90)) => self.is_relative = false,
            Some(('G', 91)) => self.is_relative = true,
            Some(('M', 410)) if machine.fault == Fault::Unstoppable => {}
            Some(('M', 410)) => machine.motion = None,
            Some(('M', 114)) => {
                let [x, y] = machine.place;
                let steps = [x, y].map(|place| (place * 80.0).round());
                return format!("X:{x:.2} Y:{y:.2} Z:0.00 E:0.00 Count X:{} Y:{} Z:0\nok\n", steps[0], steps[1]);
            }
            Some(('M', 115)) => {
                return "FIRMWARE_NAME:Marlin 2.1.2 (Nov  1 2023) SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0\n\
                        Cap:EEPROM:1\nCap:EMERGENCY_PARSER:0\nok\n"
                    .into();
            }
            _ => return unknown,
        }
        "ok\n".into()
    }
}

impl Control for Marlin {
    fn start(&mut self) -> &'static str {
        *self = Marlin::default();
        "start\necho: External Reset\nMarlin 2.1.2\necho:SD init fail\n"
    }

    fn take(&mut self, byte: u8, machine: &mut Machine) -> String {
        match byte {
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
                if self.busy.is_none_or(|time| machine.now - time >= BUSY) {
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
