//! The fault that is injected into a capture, as the command line names it.

use multiscopic_core::capture::CaptureProgress;

use super::slide::ScrewFault;

/// The kind of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultKind {
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
    /// Somebody bumps the slide while a frame is taken.
    Bumped,
    /// The sensor is another model.
    Model,
    /// The sensor does not respond when it is started.
    NotStarted,
    /// The sensor does not respond when it is released.
    Unreleased,
    /// The frame never arrives.
    Silent,
    /// The frame ends half-way.
    Torn,
    /// A line of the frame is too short.
    Short,
    /// The sensor leaves out a line of the frame.
    Missing,
    /// The sensor sends a line of the frame twice.
    Doubled,
    /// Lines arrive faster than they are matched or stored.
    Burst,
    /// The capture is aborted when it reaches a stage.
    Abort(CaptureStage),
}

/// A stage of a capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CaptureStage {
    /// The camera moves to the place of a frame.
    Move,
    /// Vibrations fade.
    Settle,
    /// A frame is taken.
    Capture,
    /// The camera returns to the centre.
    Return,
}

/// A fault, and the attempts that it affects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Injection {
    /// Its kind.
    pub kind: FaultKind,
    /// The index of the frame that it affects.
    pub frame: usize,
    /// True if it affects every attempt at the frame, not the first alone.
    pub is_permanent: bool,
}

impl Injection {
    /// Nothing goes wrong.
    pub const NONE: Injection = Injection { kind: FaultKind::Nothing, frame: 0, is_permanent: false };

    /// Parses the words of the command line: the fault, the index of a frame, and `once` or `always`.
    pub fn parse<'a>(mut words: impl Iterator<Item = &'a str>) -> Option<Injection> {
        let kind = match words.next()? {
            "nothing" => FaultKind::Nothing,
            "limit" => FaultKind::Limit,
            "pressed" => FaultKind::Pressed,
            "released" => FaultKind::Released,
            "jam" => FaultKind::Jam,
            "lost" => FaultKind::Lost,
            "slow" => FaultKind::Slow,
            "beyond" => FaultKind::Beyond,
            "bumped" => FaultKind::Bumped,
            "model" => FaultKind::Model,
            "not-started" => FaultKind::NotStarted,
            "unreleased" => FaultKind::Unreleased,
            "silent" => FaultKind::Silent,
            "torn" => FaultKind::Torn,
            "short" => FaultKind::Short,
            "missing" => FaultKind::Missing,
            "doubled" => FaultKind::Doubled,
            "burst" => FaultKind::Burst,
            "abort-move" => FaultKind::Abort(CaptureStage::Move),
            "abort-settle" => FaultKind::Abort(CaptureStage::Settle),
            "abort-capture" => FaultKind::Abort(CaptureStage::Capture),
            "abort-return" => FaultKind::Abort(CaptureStage::Return),
            _ => return None,
        };
        let frame = words.next()?.parse().ok()?;
        let is_permanent = match words.next()? {
            "once" => false,
            "always" => true,
            _ => return None,
        };
        Some(Injection { kind, frame, is_permanent })
    }

    /// True if it is a fault of `kind` that affects this attempt at a frame.
    pub fn affects(&self, kind: FaultKind, frame: usize, is_first_attempt: bool) -> bool {
        self.kind == kind && self.frame == frame && (is_first_attempt || self.is_permanent)
    }

    /// True if the capture is to be aborted now.
    pub fn aborts(&self, progress: CaptureProgress) -> bool {
        let reached = match progress {
            CaptureProgress::Moving(index) => (CaptureStage::Move, index),
            CaptureProgress::Settling(index) => (CaptureStage::Settle, index),
            CaptureProgress::Capturing(index) => (CaptureStage::Capture, index),
            CaptureProgress::Returning => (CaptureStage::Return, self.frame),
            _ => return false,
        };
        matches!(self.kind, FaultKind::Abort(stage) if (stage, self.frame) == reached)
    }

    /// The fault of a screw: one of homing, or one that follows some pulses after homing.
    pub fn of_screw(&self, axis: usize, homed_pulses: Option<u32>) -> Option<ScrewFault> {
        match (self.kind, axis, homed_pulses) {
            (FaultKind::Pressed, 1, _) => Some(ScrewFault::Pressed(0, 0)),
            (FaultKind::Released, 0, _) => Some(ScrewFault::Released),
            (FaultKind::Jam, 0, _) => Some(ScrewFault::Jam(0..u32::MAX)),
            (FaultKind::Limit, 0, Some(pulses)) => Some(ScrewFault::Pressed(1, pulses + 5000)),
            (FaultKind::Lost, 0, Some(pulses)) => Some(ScrewFault::Jam(pulses + 5000..pulses + 5400)),
            _ => None,
        }
    }
}
