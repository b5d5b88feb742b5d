//! Active perception: moving the camera and taking the frames.
//!
//! [`Stage`], which moves the camera, and [`Camera`], which takes the frames, are implemented for hardware.
//!
//! | module | what it is |
//! | --- | --- |
//! | `plan` | [`Position`]: where the camera is; [`Plan`]: the frames of a capture and their positions |
//! | `sequence` | [`Sequence`]: moves, settles, captures, checks, and goes on to the next position, as a [`Policy`] says |
//!
//! The same sequence runs on a host and on a microcontroller. It is a state machine that is polled with the
//! time and never waits, so the caller is free to do other work in between.
//!
//! ```
//! use core::{convert::Infallible, time::Duration};
//! use multiscopic_core::Views;
//! use multiscopic_core::capture::{Camera, Plan, Policy, Position, CaptureProgress, Sequence, Stage};
//!
//! /// A stage that arrives at once.
//! struct Teleport(Option<Position>);
//!
//! impl Stage for Teleport {
//!     type Error = Infallible;
//!
//!     fn move_to(&mut self, position: Position) -> Result<(), Infallible> {
//!         self.0 = Some(position);
//!         Ok(())
//!     }
//!
//!     fn has_arrived(&mut self) -> Result<bool, Infallible> {
//!         Ok(true)
//!     }
//!
//!     fn position(&mut self) -> Result<Option<Position>, Infallible> {
//!         Ok(self.0)
//!     }
//!
//!     fn stop(&mut self) -> Result<(), Infallible> {
//!         Ok(())
//!     }
//! }
//!
//! /// A camera that counts its frames.
//! struct Counter(usize);
//!
//! impl Camera for Counter {
//!     type Error = Infallible;
//!
//!     fn begin(&mut self) -> Result<(), Infallible> {
//!         Ok(())
//!     }
//!
//!     fn start(&mut self, _: usize) -> Result<(), Infallible> {
//!         self.0 += 1;
//!         Ok(())
//!     }
//!
//!     fn is_complete(&mut self) -> Result<bool, Infallible> {
//!         Ok(true)
//!     }
//!
//!     fn end(&mut self) -> Result<(), Infallible> {
//!         Ok(())
//!     }
//! }
//!
//! let plan = Plan::new(Views::CROSS, 20_000);
//! let policy = Policy { settle: Duration::from_millis(300), ..Policy::default() };
//! let (mut stage, mut camera) = (Teleport(None), Counter(0));
//! let mut sequence = Sequence::new(plan.positions(), policy);
//! let mut now = Duration::ZERO;
//! while sequence.poll(now, &mut stage, &mut camera).unwrap() != CaptureProgress::Done {
//!     now += Duration::from_millis(10); // a clock
//! }
//! assert_eq!((camera.0, stage.0), (5, Some(Position::CENTER)));
//! assert!(now > Duration::from_millis(5 * 300));
//! ```

mod plan;
mod sequence;

use core::{error, fmt, time::Duration};

pub use plan::{Plan, Position};
pub use sequence::{CaptureProgress, Policy, Sequence};

/// A stage that moves the camera in its image plane, such as a robot arm or an XY slide.
///
/// No call waits for a motion to end. Each returns within a bounded time, even if the hardware is gone.
pub trait Stage {
    /// The reason why the stage cannot move or measure its position.
    type Error;

    /// Starts to move straight to `position`, in place of any motion under way.
    ///
    /// # Errors
    /// The stage does not take the order, or the position is out of its reach.
    fn move_to(&mut self, position: Position) -> Result<(), Self::Error>;

    /// Returns true if the stage stands still where it was last sent. Called repeatedly; each call may do a part of
    /// the motion.
    ///
    /// # Errors
    /// The stage stopped somewhere else, or does not answer.
    fn has_arrived(&mut self) -> Result<bool, Self::Error>;

    /// The measured position, or `None` if the stage cannot measure it.
    ///
    /// # Errors
    /// The stage does not answer.
    fn position(&mut self) -> Result<Option<Position>, Self::Error>;

    /// Stops any motion. Called at any time, even after errors, and possibly more than once.
    ///
    /// # Errors
    /// The stage does not take the order, and may still be moving.
    fn stop(&mut self) -> Result<(), Self::Error>;
}

/// A camera that takes one frame at a time.
///
/// The implementation decides where frames go: into memory, into a file, or line by line to whoever reads
/// them as they arrive. No call waits for a frame. Each returns within a bounded time.
pub trait Camera {
    /// The reason why there is no frame.
    type Error;

    /// Prepares for a sequence: holds exposure, gain and focus, so that frames can be compared.
    ///
    /// # Errors
    /// The camera does not take the settings.
    fn begin(&mut self) -> Result<(), Self::Error>;

    /// Starts to take the frame with this index in the sequence, in place of any frame under way. Nothing
    /// exposed before the call may be part of the frame.
    ///
    /// # Errors
    /// The camera cannot start.
    fn start(&mut self, index: usize) -> Result<(), Self::Error>;

    /// Returns true if the whole frame is there. Called repeatedly; each call may do a part of the work.
    ///
    /// # Errors
    /// The frame is damaged or unusable, or the camera does not answer.
    fn is_complete(&mut self) -> Result<bool, Self::Error>;

    /// Drops any frame under way and releases the settings that [`begin`](Camera::begin) held. Called once
    /// after each sequence, however it ended.
    ///
    /// # Errors
    /// The camera does not answer.
    fn end(&mut self) -> Result<(), Self::Error>;
}

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
    /// The stage was told to stop, after whatever else failed, and it is not known to stand still.
    NotStopped(S),
    /// [`Sequence::abort`](Sequence::abort) was called.
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
        use CaptureError::{Missed, MoveTimeout, NotStopped, Stage};
        matches!(self, Stage(_) | MoveTimeout { .. } | Missed { .. } | NotStopped(_))
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
            CaptureError::NotStopped(error) => {
                write!(f, "the stage may still move, be ready to use its emergency stop: {error}")
            }
            CaptureError::Aborted => f.write_str("the capture was aborted; the stage stands still"),
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
        let errors: [(CaptureError<&str, &str>, _, _, _); 8] = [
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
            (
                CaptureError::NotStopped("it is silent"),
                None,
                true,
                "the stage may still move, be ready to use its emergency stop: it is silent",
            ),
            (CaptureError::Aborted, None, false, "the capture was aborted; the stage stands still"),
            (CaptureError::Ended, None, false, "the capture has ended"),
        ];
        for (error, index, is_of_stage, text) in errors {
            assert_eq!((error.index(), error.is_of_stage(), &*error.to_string()), (index, is_of_stage, text));
        }
    }
}
