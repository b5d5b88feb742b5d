//! The stage that moves the camera.

use super::position::Position;

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
