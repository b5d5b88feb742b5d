//! The mechanics of a machine, and the interface of its firmware.

use std::time::Instant;

use super::fault::Fault;
use crate::simulated::motion::Motion;

/// Acceleration in millimetres per second squared.
pub(super) const ACCELERATION: f64 = 2000.0;

/// The state of the mechanics and of the electronics.
pub(super) struct Machine {
    /// Position in millimetres.
    pub place: [f64; 2],
    pub motion: Option<Motion>,
    pub fault: Fault,
    pub heard: Vec<String>,
    /// When the firmware will have booted, while it has not.
    pub restart: Option<Instant>,
    pub is_locked: bool,
    pub is_unplugged: bool,
    /// Whether moves take no time.
    pub is_instant: bool,
}

impl Machine {
    /// A machine that stands still at `place`, in millimetres.
    pub fn at(place: [f64; 2]) -> Machine {
        Machine {
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

    /// Starts a move to `target` in millimetres at `speed` in millimetres per second.
    pub fn go(&mut self, target: [f64; 2], speed: f64) {
        if self.is_instant {
            self.place = target;
            return;
        }
        let pose = |place: [f64; 2]| [place[0] * 1e-3, place[1] * 1e-3, 0.0, 0.0, 0.0, 0.0];
        self.motion = Some(Motion::new(pose(self.place), pose(target), speed * 1e-3, ACCELERATION * 1e-3));
    }
}

/// The firmware of a machine.
pub(super) trait Control: Send {
    /// The greeting it sends when it starts.
    fn start(&mut self) -> &'static str;

    /// Processes a byte and returns the answer.
    fn take(&mut self, byte: u8, machine: &mut Machine) -> String;

    /// What it sends unasked.
    fn say(&mut self, machine: &mut Machine) -> String;
}
