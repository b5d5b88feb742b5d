//! The errors of a capture.

use core::fmt;
use multiscopic_core::{MatchError, MemoryTooSmall, capture::CaptureError};
use multiscopic_drivers::{
    hm01b0::{Hm01b0Error, NoRoom},
    stepper::StepperError,
};
use multiscopic_edge::packet::BufferTooSmall;

use crate::packet_port::PortError;

/// An error that left a capture without disparities.
pub enum Failure {
    /// The slide does not find its switches.
    Homing(StepperError),
    /// Homing took too long.
    HomingTimeout,
    /// The stage or the camera failed.
    Capture(CaptureError<StepperError, Hm01b0Error<NoRoom>>),
    /// Homing again did not find the switches where they were.
    StepsLost([i32; 2]),
    /// A frame is not in memory.
    Match(MatchError<NoRoom>),
    /// The matcher's memory is too small.
    Memory(MemoryTooSmall),
    /// The packet's buffer is too small.
    Packet(BufferTooSmall),
    /// A packet was not sent.
    Send(PortError),
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Homing(error) => write!(f, "homing: {error}"),
            Failure::HomingTimeout => write!(f, "homing took too long"),
            Failure::Capture(error) => {
                error.index().map_or(Ok(()), |index| write!(f, "frame {index}: "))?;
                write!(f, "{error}")
            }
            Failure::StepsLost([x, y]) => write!(f, "the motors lost {x} and {y} steps: the frames are of no use"),
            Failure::Match(error) => write!(f, "{error}"),
            Failure::Memory(error) => write!(f, "{error}"),
            Failure::Packet(error) => write!(f, "{error}"),
            Failure::Send(error) => write!(f, "cannot send a packet: {error}"),
        }
    }
}
