//! Errors of stages, and the modes that an arm reports, which are the reasons of some.

use std::{fmt, io, ops::RangeInclusive, time::Duration};

use multiscopic_core::capture::Position;

use crate::capture::exec::ExecError;

/// An error of a stage, with the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StageError {
    /// The text does not name a stage.
    #[error(
        "`{text}` is not a stage: {problem}; expected ur10:HOST[:PORT[,RTDE_PORT]], gcode:TTY[@BAUD], exec:COMMAND or manual"
    )]
    Spec {
        /// The text.
        text: String,
        /// The mistake in it.
        problem: &'static str,
    },
    /// The stage measures no poses of a tool.
    #[error("{stage} measures no poses; an arm does: ur10:HOST, or exec:COMMAND that tells poses behind positions")]
    NoPose {
        /// The stage.
        stage: String,
    },
    /// A limit is out of range.
    #[error("the stage's {name} is {value}, expected {} to {}", range.start(), range.end())]
    Limits {
        /// The limit and its unit.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The range that it must be in.
        range: RangeInclusive<f64>,
    },
    /// A position is out of reach. Nothing has moved.
    #[error(
        "({}, {}) mm is beyond the reach of {} mm from where the stage started; allow a longer reach if that is safe",
        f64::from(position.x_um) / 1e3, f64::from(position.y_um) / 1e3, f64::from(*reach_um) / 1e3
    )]
    OutOfReach {
        /// The position.
        position: Position,
        /// The allowed distance from the start, in micrometres.
        reach_um: u32,
    },
    /// A host or serial port cannot be reached.
    #[error("cannot connect to {to}: {source}; {advice}")]
    Connect {
        /// The host or port.
        to: String,
        /// The error of the system.
        source: io::Error,
        /// The remedy.
        advice: &'static str,
    },
    /// A connection broke.
    #[error("lost the connection to {from}: {source}; {advice}")]
    Disconnected {
        /// The other end.
        from: String,
        /// The error of the system.
        source: io::Error,
        /// The remedy.
        advice: &'static str,
    },
    /// A stage did not answer, or stopped sending.
    #[error("nothing came from {from} for {:.1} s; check its power and connection", after.as_secs_f32())]
    Silent {
        /// The stage.
        from: String,
        /// The time for which it was waited for.
        after: Duration,
    },
    /// The other end does not speak the expected protocol.
    #[error("{from}: found {found}, expected {expected}")]
    Protocol {
        /// The other end.
        from: String,
        /// The words that it sent.
        found: String,
        /// The words that it should have sent.
        expected: String,
    },
    /// A safety function stopped the arm.
    #[error("the arm has stopped: {0}; release it at the teach pendant")]
    SafetyStop(SafetyMode),
    /// The stage is in a state in which it cannot move.
    #[error("the stage is not ready: {found}; {advice}")]
    NotReady {
        /// The state.
        found: String,
        /// The remedy.
        advice: &'static str,
    },
    /// The arm does not execute what it is sent.
    #[error("the arm has ignored a command for {:.1} s; set it to remote control", after.as_secs_f32())]
    Ignored {
        /// For how long.
        after: Duration,
    },
    /// The stage makes no progress towards its target.
    #[error(
        "the stage is {distance_um} um from its target and came no nearer for {:.1} s; is it blocked, paused, or its speed set to 0?",
        after.as_secs_f32()
    )]
    Stalled {
        /// The distance to the target, in micrometres.
        distance_um: u32,
        /// For how long.
        after: Duration,
    },
    /// The machine is still busy long after a move should have ended.
    #[error("{by} is still busy {:.1} s after the move should have ended; is it blocked or paused?", after.as_secs_f32())]
    Late {
        /// The machine.
        by: String,
        /// For how long.
        after: Duration,
    },
    /// The stage still moves after it was told to stop.
    #[error("the stage still moves {:.1} s after it was told to stop; use its emergency stop", after.as_secs_f32())]
    StillMoving {
        /// For how long.
        after: Duration,
    },
    /// The machine refused a line of G-code.
    #[error("{by} refused `{line}`: {reason}")]
    Refused {
        /// The machine.
        by: String,
        /// The line.
        line: String,
        /// Its answer.
        reason: String,
    },
    /// The machine raised an alarm. It has stopped, and may have lost its position.
    #[error("{by} raised an alarm: {reason}; clear the cause, then home or unlock it")]
    Alarm {
        /// The machine.
        by: String,
        /// Its reason.
        reason: String,
    },
    /// The machine restarted, and lost its position.
    #[error("{by} restarted and lost its position; check its power and cable, then open it again")]
    Restarted {
        /// The machine.
        by: String,
    },
    /// The command that moves the stage failed, or refused an order.
    #[error(transparent)]
    Exec(#[from] ExecError),
    /// The terminal cannot be read or written.
    #[error("cannot prompt at the terminal: {0}")]
    Terminal(#[source] io::Error),
    /// The person at the terminal gave up.
    #[error("given up at the terminal")]
    GivenUp,
}

impl From<StageError> for crate::error::Error {
    fn from(error: StageError) -> crate::error::Error {
        crate::error::Error::Device(Box::new(error))
    }
}

/// The safety mode of an arm of Universal Robots, numbered like `safety_mode` and `safety_status` of RTDE.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SafetyMode(pub i32);

impl SafetyMode {
    /// The arm may move.
    pub const NORMAL: SafetyMode = SafetyMode(1);
    /// The arm may move, but slowly.
    pub const REDUCED: SafetyMode = SafetyMode(2);
    /// The arm met an obstacle, or an unexpected force.
    pub const PROTECTIVE_STOP: SafetyMode = SafetyMode(3);

    /// Descriptions by number, starting from 1. From 12 on, only newer controllers have them.
    const DESCRIPTIONS: [&str; 23] = [
        "normal operation",
        "reduced operation",
        "protective stop",
        "recovery mode",
        "safeguard stop",
        "emergency stop of the installation",
        "emergency stop of the arm",
        "a safety limit was exceeded",
        "a safety fault",
        "the joints are to be validated",
        "an undefined safety mode",
        "safeguard stop of the automatic mode",
        "the installation's three-position enabling device stops it",
        "the teach pendant's three-position enabling device stops it",
        "emergency stop of the injection moulding machine",
        "safeguard stop of the injection moulding machine",
        "PROFIsafe waits for parameters",
        "PROFIsafe's safeguard stop of the automatic mode",
        "PROFIsafe's safeguard stop",
        "PROFIsafe's emergency stop",
        "",
        "safeguard stop of the safety interface",
        "a plane that switches an output stops it",
    ];

    /// Returns true if the arm may move.
    pub fn may_move(self) -> bool {
        [SafetyMode::NORMAL, SafetyMode::REDUCED].contains(&self)
    }
}

/// The description and the number.
impl fmt::Display for SafetyMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match description(&Self::DESCRIPTIONS, 1, self.0) {
            Some(description) => write!(f, "{description} (safety mode {})", self.0),
            None => write!(f, "safety mode {}, which is unknown", self.0),
        }
    }
}

/// The description of a number, given those from the number `first` on.
fn description<'a>(descriptions: &[&'a str], first: i32, number: i32) -> Option<&'a str> {
    let index = usize::try_from(number.checked_sub(first)?).ok()?;
    descriptions.get(index).copied().filter(|description| !description.is_empty())
}

/// The operating mode of an arm, numbered like `robot_mode` of RTDE.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RobotMode(pub i32);

impl RobotMode {
    /// The arm is on, and its brakes are released.
    pub const RUNNING: RobotMode = RobotMode(7);

    /// Descriptions by number, starting from -1.
    const DESCRIPTIONS: [&str; 10] = [
        "without a controller",
        "disconnected from its controller",
        "waiting for its safety to be confirmed",
        "booting",
        "switched off",
        "switched on, but not started",
        "idle with its brakes on",
        "in backdrive mode",
        "running",
        "updating its firmware",
    ];
}

/// Completes the sentence "the arm is ...".
impl fmt::Display for RobotMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match description(&Self::DESCRIPTIONS, -1, self.0) {
            Some(description) => f.write_str(description),
            None => write!(f, "in mode {}, which is unknown", self.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_known_safe_modes_may_move() {
        for number in [i32::MIN, -1, 0, 3, 4, 11, 12, 21, 23, 24, i32::MAX] {
            assert!(!SafetyMode(number).may_move(), "{number}");
        }
        assert!([1, 2].map(SafetyMode).into_iter().all(SafetyMode::may_move));
        for (number, text) in [
            (1, "normal operation (safety mode 1)"),
            (12, "safeguard stop of the automatic mode (safety mode 12)"),
            (13, "the installation's three-position enabling device stops it (safety mode 13)"),
            (21, "safety mode 21, which is unknown"),
            (-7, "safety mode -7, which is unknown"),
            (i32::MIN, "safety mode -2147483648, which is unknown"),
        ] {
            assert_eq!(SafetyMode(number).to_string(), text);
        }
        assert_eq!([-1, 9].map(|mode| RobotMode(mode).to_string()), ["without a controller", "in mode 9, which is unknown"]);
    }
}
