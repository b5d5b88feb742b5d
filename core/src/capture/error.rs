//! Errors of captures.

use core::{error, fmt, time::Duration};

use super::position::Position;

/// The error of a capture, with a stage's error `S` and a camera's error `C`.
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

    /// Returns true if the stage failed, so that it must not be moved any more.
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

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::string::ToString;

    #[test]
    fn errors_tell_what_failed_and_where() {
        let (after, target) = (Duration::from_millis(1500), Position { x_um: 20_000, y_um: -10 });
        let measured = Position { x_um: 19_000, y_um: 3 };
        let errors: [(CaptureError<&str, &str>, _, _, _); 7] = [
            (CaptureError::Stage("stuck"), None, true, "stuck"),
            (CaptureError::MoveTimeout { after }, None, true, "the stage did not arrive within 1.5 s"),
            (
                CaptureError::Missed { index: 3, target, measured },
                Some(3),
                true,
                "the stage measures to be at (19000, 3) um, expected (20000, -10) um",
            ),
            (CaptureError::Camera { index: 4, error: "gone" }, Some(4), false, "gone"),
            (CaptureError::FrameTimeout { index: 2, after }, Some(2), false, "the camera gave no frame within 1.5 s"),
            (CaptureError::Aborted, None, false, "the capture was aborted"),
            (CaptureError::Ended, None, false, "the capture has ended"),
        ];
        for (error, index, is_of_stage, text) in errors {
            assert_eq!((error.index(), error.is_of_stage(), &*error.to_string()), (index, is_of_stage, text));
        }
    }
}
