//! Stages that measure poses.

use multiscopic_core::capture::Stage;

use crate::images::Transform;

/// A stage of a host, which may measure more than the core's [`Stage::position`]: the pose of what it carries.
pub trait PosedStage: Stage {
    /// The pose of the tool in the frame of the stage's base, as it was measured last. `None` if the stage measures none. It
    /// returns at once.
    ///
    /// # Errors
    /// The stage has failed, or no longer answers.
    fn pose(&mut self) -> Result<Option<Transform>, Self::Error> {
        Ok(None)
    }

    /// Returns true if a move has a constant speed but for its ramps, and [`Stage::position`] tells where the stage is meanwhile:
    /// what a sweep needs.
    fn is_tracked(&self) -> bool {
        false
    }
}
