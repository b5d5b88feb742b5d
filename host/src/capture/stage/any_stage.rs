//! A stage whose kind is only known at run time.

use multiscopic_core::capture::{Position, Stage};

use super::error::StageError;

/// A stage of any kind.
pub struct AnyStage(Box<dyn Stage<Error = StageError> + Send>);

impl AnyStage {
    /// Boxes a stage.
    pub fn new(stage: impl Stage<Error = StageError> + Send + 'static) -> AnyStage {
        AnyStage(Box::new(stage))
    }
}

impl Stage for AnyStage {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.0.move_to(position)
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        self.0.has_arrived()
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        self.0.position()
    }

    fn stop(&mut self) -> Result<(), StageError> {
        self.0.stop()
    }
}
