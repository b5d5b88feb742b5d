//! Why captures fail.

use core::{error, fmt, time::Duration};

use super::position::Position;

/// Why a capture failed, with a stage's error `S` and a camera's error `C`.
///
/// The text does not name the frame; [`index`](CaptureError::index) does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum CaptureError<S, C> {
    /// The stage failed.
    Stage(S),
    /// The stage did not arrive in time.
    MoveTimeout {
        /// The time-out.
        after: Duration,
    },
    /// The stage reported that it had arrived, but measured another position.
    Missed {
        /// The index of the position.
        index: usize,
        /// The position asked for.
        target: Position,
        /// The position measured.
        measured: Position,
    },
    /// The camera failed.
    Camera {
        /// The index of the frame.
        index: usize,
        /// The camera's error.
        error: C,
    },
    /// The camera did not complete a frame in time.
    FrameTimeout {
        /// The index of the frame.
        index: usize,
        /// The time-out.
        after: Duration,
    },
    /// [`Sequence::abort`](super::Sequence::abort) was called.
    Aborted,
    /// The sequence had already ended.
    Ended,
}

impl<S, C> CaptureError<S, C> {
    /// The index of the position or frame that the error concerns, if it concerns one.
    pub fn index(&self) -> Option<usize> {
        match *self {
            CaptureError::Missed { index, .. }
            | CaptureError::Camera { index, .. }
            | CaptureError::FrameTimeout { index, .. } => Some(index),
            _ => None,
        }
    }

    /// Whether the stage failed, so that it must not be moved any more.
    pub fn is_of_stage(&self) -> bool {
        matches!(self, CaptureError::Stage(_) | CaptureError::MoveTimeout { .. } | CaptureError::Missed { .. })
    }
}

impl<S: fmt::Display, C: fmt::Display> fmt::Display for CaptureError<S, C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            CaptureError::Stage(error) => write!(f, "{error}"),
            CaptureError::MoveTimeout { after } => write!(f, "the stage did not arrive within {} s", after.as_secs_f32()),
            CaptureError::Missed { target, measured, .. } => write!(
                f,
                "the stage measures to be at ({}, {}) um, expected ({}, {}) um",
                measured.x_um, measured.y_um, target.x_um, target.y_um
            ),
            CaptureError::Camera { error, .. } => write!(f, "{error}"),
            CaptureError::FrameTimeout { after, .. } => write!(f, "the camera gave no frame within {} s", after.as_secs_f32()),
            CaptureError::Aborted => f.write_str("the capture was aborted"),
            CaptureError::Ended => f.write_str("the capture has ended"),
        }
    }
}

impl<S: error::Error, C: error::Error> error::Error for CaptureError<S, C> {}
