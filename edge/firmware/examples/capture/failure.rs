//! The errors of a capture.

use core::fmt;
use multiscopic_core::{MatchError, MemoryTooSmall, capture::CaptureError};
use multiscopic_drivers::{
    hm01b0::{Hm01b0Error, NoRoom},
    stepper::StepperError,
};
use multiscopic_edge::packet::BufferTooSmall;
use multiscopic_firmware::HostError;

/// The error of the camera.
pub type CameraError = Hm01b0Error<NoRoom>;

/// An error that left a capture without disparities.
pub enum CaptureFailure {
    Homing(StepperError),
    HomingTimeout,
    Capture(CaptureError<StepperError, CameraError>),
    StepsLost { steps: [i32; 2] },
    Match(MatchError<CameraError>),
    Memory(MemoryTooSmall),
    Packet(BufferTooSmall),
    Send(HostError),
}

impl fmt::Display for CaptureFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            CaptureFailure::Homing(error) => write!(f, "homing: {error}"),
            CaptureFailure::HomingTimeout => write!(f, "homing took too long"),
            CaptureFailure::Capture(error) => {
                error.index().map_or(Ok(()), |index| write!(f, "frame {index}: "))?;
                write!(f, "{error}")
            }
            CaptureFailure::StepsLost { steps: [x, y] } => {
                write!(f, "the motors lost {x} and {y} steps: the frames are of no use")
            }
            CaptureFailure::Match(error) => write!(f, "{error}"),
            CaptureFailure::Memory(error) => write!(f, "{error}"),
            CaptureFailure::Packet(error) => write!(f, "{error}"),
            CaptureFailure::Send(error) => write!(f, "cannot send a disparity line: {error}"),
        }
    }
}
