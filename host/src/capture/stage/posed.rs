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

    /// Returns the way in which its place is known while it moves, which a sweep needs.
    fn tracking(&self) -> Tracking {
        Tracking::None
    }
}

/// The way in which the place of a stage is known while it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tracking {
    /// It is not: the stage may stop on its way, or its speed is not known.
    None,
    /// [`Stage::position`] tells it.
    Measured,
    /// By time: a move has this speed in mm/s, but for even ramps at both ends.
    Planned(f64),
}
