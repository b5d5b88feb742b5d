//! Why a stage does not move.

use std::{io, ops::RangeInclusive, time::Duration};

use multiscopic_core::capture::Position;

use super::SafetyMode;

/// What went wrong with a stage, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StageError {
    /// A text names no stage.
    #[error("`{text}` is no stage: {problem}; expected ur10:HOST[:PORT[,RTDE_PORT]], gcode:TTY[@BAUD] or manual")]
    Spec {
        /// The text.
        text: String,
        /// What is wrong with it.
        problem: &'static str,
    },
    /// A limit is out of its range.
    #[error("the stage's {name} is {value}, it must be {} to {}", range.start(), range.end())]
    Limits {
        /// Which.
        name: &'static str,
        /// What it is.
        value: f64,
        /// What it may be.
        range: RangeInclusive<f64>,
    },
    /// A position is beyond the reach that was allowed. Nothing moved.
    #[error(
        "the stage may go {} mm from where it began, not to ({}, {}) mm; a longer reach must be allowed first",
        f64::from(*reach_um) / 1e3, f64::from(position.x_um) / 1e3, f64::from(position.y_um) / 1e3
    )]
    OutOfReach {
        /// The position.
        position: Position,
        /// What is allowed, in micrometres.
        reach_um: u32,
    },
    /// A host or serial port cannot be reached.
    #[error("cannot connect to {to}: {source}; {advice}")]
    Connect {
        /// What was to be reached.
        to: String,
        /// What the system said.
        source: io::Error,
        /// What to do.
        advice: &'static str,
    },
    /// A connection broke.
    #[error("lost the connection to {from}: {source}; {advice}")]
    Disconnected {
        /// What it was to.
        from: String,
        /// What the system said.
        source: io::Error,
        /// What to do.
        advice: &'static str,
    },
    /// A stage that should speak said nothing.
    #[error("{from} said nothing for {:.1} s", after.as_secs_f32())]
    Silent {
        /// What should have spoken.
        from: String,
        /// How long it was waited for.
        after: Duration,
    },
    /// What is there speaks another language.
    #[error("{from}: found {found}, expected {expected}")]
    Protocol {
        /// What spoke.
        from: String,
        /// What it said.
        found: String,
        /// What it should have said.
        expected: String,
    },
    /// A safety function of the arm stopped it.
    #[error("the arm has stopped: {0}; release it at the teach pendant")]
    SafetyStop(SafetyMode),
    /// The stage cannot take orders as it is.
    #[error("the stage is not ready: {found}; {advice}")]
    NotReady {
        /// What it is.
        found: String,
        /// What to do.
        advice: &'static str,
    },
    /// The stage does nothing about what it was told.
    #[error("the arm ignored an order for {:.1} s: set it to remote control", after.as_secs_f32())]
    Ignored {
        /// How long.
        after: Duration,
    },
    /// The stage comes no nearer to where it was sent.
    #[error(
        "the stage is {distance_um} um from where it was sent and came no nearer for {:.1} s: is it blocked, paused, or its speed at 0?",
        after.as_secs_f32()
    )]
    Stalled {
        /// How far it has to go, in micrometres.
        distance_um: u32,
        /// For how long.
        after: Duration,
    },
    /// The stage is busy long after it should have ended a move.
    #[error("{by} is busy {:.1} s after the move should have ended: is it blocked or paused?", after.as_secs_f32())]
    Late {
        /// The machine.
        by: String,
        /// How long.
        after: Duration,
    },
    /// The stage still moves after it was told to stop.
    #[error("the stage still moves {:.1} s after it was told to stop: use its emergency stop", after.as_secs_f32())]
    StillMoving {
        /// How long.
        after: Duration,
    },
    /// A machine refused a line of G-code.
    #[error("{by} refused `{line}`: {reason}")]
    Refused {
        /// The machine.
        by: String,
        /// The line.
        line: String,
        /// What it answered.
        reason: String,
    },
    /// A machine raised an alarm. It has stopped and may have lost its place.
    #[error("{by} raised an alarm: {reason}; free it, then home or unlock it")]
    Alarm {
        /// The machine.
        by: String,
        /// What it said.
        reason: String,
    },
    /// A machine restarted, and does not know where it is any more.
    #[error("{by} restarted and lost its place: check its power and cable, then open it again")]
    Restarted {
        /// The machine.
        by: String,
    },
    /// The person at the terminal cannot be asked.
    #[error("cannot ask at the terminal: {0}")]
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
