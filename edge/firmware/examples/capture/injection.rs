//! What is made to go wrong, as the words say that the firmware is started with.

use multiscopic_core::capture::Progress;

use super::slide;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Nothing.
    Nothing,
    /// The switch at the high end of x is pressed on the way to the first frame.
    Limit,
    /// The switch at the low end of y stays pressed.
    Pressed,
    /// The switch at the low end of x is never pressed.
    Released,
    /// The motor of x never turns.
    Jam,
    /// The motor of x loses steps on the way to the first frame.
    Lost,
    /// Every step takes too long.
    Slow,
    /// The baseline is longer than the slide.
    Beyond,
    /// Somebody moves the slide while a frame is taken.
    Bumped,
    /// The sensor is another one.
    Model,
    /// The sensor does not answer as it is started.
    NotStarted,
    /// The sensor does not answer as it is released.
    Unreleased,
    /// The frame never comes.
    Silent,
    /// The frame ends in its middle.
    Torn,
    /// A line of the frame is too short.
    Short,
    /// Lines come faster than they are matched or stored.
    Burst,
    /// It is aborted as soon as it does something.
    Abort(Does),
}

/// What a capture does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Does {
    /// It moves to a frame.
    Move,
    /// Vibrations fade.
    Settle,
    /// It takes a frame.
    Capture,
    /// It goes back.
    Return,
}

/// What goes wrong, and when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fault {
    /// What goes wrong.
    pub kind: Kind,
    /// With which frame.
    pub frame: usize,
    /// Whether it goes on.
    pub lasts: bool,
}

impl Fault {
    /// Nothing goes wrong.
    pub const NONE: Fault = Fault { kind: Kind::Nothing, frame: 0, lasts: false };

    /// What these words say: the fault, the index of a frame, and `once` or `always`.
    pub fn parse<'a>(mut words: impl Iterator<Item = &'a str>) -> Option<Fault> {
        let kind = match words.next()? {
            "nothing" => Kind::Nothing,
            "limit" => Kind::Limit,
            "pressed" => Kind::Pressed,
            "released" => Kind::Released,
            "jam" => Kind::Jam,
            "lost" => Kind::Lost,
            "slow" => Kind::Slow,
            "beyond" => Kind::Beyond,
            "bumped" => Kind::Bumped,
            "model" => Kind::Model,
            "not-started" => Kind::NotStarted,
            "unreleased" => Kind::Unreleased,
            "silent" => Kind::Silent,
            "torn" => Kind::Torn,
            "short" => Kind::Short,
            "burst" => Kind::Burst,
            "abort-move" => Kind::Abort(Does::Move),
            "abort-settle" => Kind::Abort(Does::Settle),
            "abort-capture" => Kind::Abort(Does::Capture),
            "abort-return" => Kind::Abort(Does::Return),
            _ => return None,
        };
        let frame = words.next()?.parse().ok()?;
        let lasts = match words.next()? {
            "once" => false,
            "always" => true,
            _ => return None,
        };
        Some(Fault { kind, frame, lasts })
    }

    /// Whether it hits a start of the sensor: that of a frame's index, for the first time or again.
    pub fn hits(&self, kind: Kind, frame: usize, is_first: bool) -> bool {
        self.kind == kind && self.frame == frame && (is_first || self.lasts)
    }

    /// Whether a capture is aborted now.
    pub fn aborts(&self, progress: Progress) -> bool {
        let does = match progress {
            Progress::Moving(index) => (Does::Move, index),
            Progress::Settling(index) => (Does::Settle, index),
            Progress::Capturing(index) => (Does::Capture, index),
            Progress::Returning => (Does::Return, self.frame),
            _ => return false,
        };
        matches!(self.kind, Kind::Abort(kind) if (kind, self.frame) == does)
    }

    /// What is wrong with an axis of the slide from the beginning, and what from its `homed`th pulse on.
    pub fn of_axis(&self, axis: usize, homed: Option<u32>) -> Option<slide::Fault> {
        match (self.kind, axis, homed) {
            (Kind::Pressed, 1, _) => Some(slide::Fault::Pressed(0, 0)),
            (Kind::Released, 0, _) => Some(slide::Fault::Released),
            (Kind::Jam, 0, _) => Some(slide::Fault::Jam(0..u32::MAX)),
            (Kind::Limit, 0, Some(pulses)) => Some(slide::Fault::Pressed(1, pulses + 5000)),
            (Kind::Lost, 0, Some(pulses)) => Some(slide::Fault::Jam(pulses + 5000..pulses + 5400)),
            _ => None,
        }
    }
}
