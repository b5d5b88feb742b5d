//! A machine without a port and without time.

use super::{
    Firmware,
    mechanics::{Control, Machine},
};

/// A machine whose moves take no time. It has no port either: it takes bytes and returns answers.
pub struct InstantMachine {
    machine: Machine,
    control: Box<dyn Control>,
}

impl InstantMachine {
    /// A machine that has booted and stands at `place`, in millimetres.
    pub fn new(firmware: Firmware, place: [f64; 2]) -> InstantMachine {
        InstantMachine { machine: Machine { is_instant: true, ..Machine::at(place) }, control: firmware.control() }
    }

    /// Takes a byte and returns the answer, which is empty until a line is complete.
    pub fn take(&mut self, byte: u8) -> String {
        self.control.take(byte, &mut self.machine) + &self.control.say(&mut self.machine)
    }

    /// Restarts it, as after a loss of power, and returns its greeting. It has lost its coordinates.
    pub fn restart(&mut self) -> &'static str {
        self.machine.place = [0.0; 2];
        self.control.start()
    }
}
