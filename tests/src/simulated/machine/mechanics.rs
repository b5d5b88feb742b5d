//! The axes of a machine, and what its firmware does with them.

use std::time::Instant;

use super::fault::Fault;
use crate::simulated::motion::Motion;

/// How fast it speeds up, in millimetres per second squared.
pub(super) const ACCELERATION: f64 = 2000.0;

/// The mechanics, and what the firmware knows of them.
pub(super) struct Machine {
    /// In millimetres.
    pub place: [f64; 2],
    pub motion: Option<Motion>,
    pub fault: Fault,
    pub heard: Vec<String>,
    /// When it starts, if it has not.
    pub restart: Option<Instant>,
    pub is_locked: bool,
    pub is_unplugged: bool,
}

impl Machine {
    pub fn advance(&mut self) {
        let Some(motion) = &mut self.motion else { return };
        motion.advance(if self.fault == Fault::Stuck { 0.0 } else { 1.0 });
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

    /// Starts a move, in millimetres and per second.
    pub fn go(&mut self, target: [f64; 2], speed: f64) {
        let pose = |place: [f64; 2]| [place[0] * 1e-3, place[1] * 1e-3, 0.0, 0.0, 0.0, 0.0];
        self.motion = Some(Motion::new(pose(self.place), pose(target), speed * 1e-3, ACCELERATION * 1e-3));
    }
}

/// A firmware.
pub(super) trait Control: Send {
    /// What it says when it starts.
    fn start(&mut self) -> &'static str;

    /// Takes a byte, and says something.
    fn take(&mut self, byte: u8, machine: &mut Machine) -> String;

    /// Says something by itself.
    fn say(&mut self, machine: &mut Machine) -> String;
}
