//! The mechanics of a machine, the interface of its firmware, and the words of G-code.

use std::time::Instant;

use crate::simulated::motion::Motion;

/// Acceleration in millimetres per second squared.
pub(super) const ACCELERATION: f64 = 2000.0;

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
    /// It ignores orders to stop.
    Unstoppable,
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
pub(super) fn words(line: &str) -> Option<Vec<(char, f64)>> {
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
pub(super) fn value(words: &[(char, f64)], letter: char) -> Option<f64> {
    words.iter().find(|(found, _)| *found == letter).map(|(_, number)| *number)
}
