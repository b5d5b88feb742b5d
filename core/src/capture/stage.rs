//! What moves the camera.

use super::Position;

/// A stage that moves the camera in its image plane: a robot arm, an XY slide.
///
/// No call waits for a motion to end. Each returns within a time that the implementation bounds, also when what it talks to is gone.
pub trait Stage {
    /// Why the stage cannot move, or tell where it is.
    type Error;

    /// Starts to move straight to `position`, instead of where it is moving now.
    ///
    /// # Errors
    /// The stage cannot take the order, or the position is beyond where it may go.
    fn move_to(&mut self, position: Position) -> Result<(), Self::Error>;

    /// Whether the stage stands still where it was last sent. It is asked again and again, and may do a part of the motion each time.
    ///
    /// # Errors
    /// The stage stopped for another reason, or does not answer.
    fn has_arrived(&mut self) -> Result<bool, Self::Error>;

    /// Where the stage measures that it is; `None` if it cannot tell.
    ///
    /// # Errors
    /// The stage does not answer.
    fn position(&mut self) -> Result<Option<Position>, Self::Error>;

    /// Stops the motion, if there is one. It is called at any time, also after errors, and more than once.
    ///
    /// # Errors
    /// The stage cannot be told. It may still be moving.
    fn stop(&mut self) -> Result<(), Self::Error>;
}
