//! What moves the camera: a robot arm, a machine that takes G-code, a person.
//!
//! | item | what it is |
//! | --- | --- |
//! | [`StageSpec`] | which stage, as `--stage` names it |
//! | [`Limits`] | how far and how fast it may go, and how long it is waited for |
//! | [`open`], [`AnyStage`] | any of them |
//! | [`Arm`] | an arm of Universal Robots |
//! | [`gcode`] | machines with Grbl or Marlin on a serial port |
//! | [`Manual`] | a person who is asked |
//!
//! Where a stage is when it is opened is its [centre](multiscopic_core::capture::Position::CENTER); what it is sent to and where it measures to
//! be is relative to that.

pub mod arm;
mod error;
pub mod gcode;
mod limits;
mod manual;
mod spec;

pub use arm::{Arm, ArmAddress, SafetyMode};
pub use error::StageError;
pub use limits::Limits;
pub use manual::Manual;
pub use spec::StageSpec;

use multiscopic_core::capture::{Position, Stage};

/// Opens the stage that `spec` names.
///
/// # Errors
/// The limits are out of range, or nothing that can move answers there within [`Limits::connect_timeout`].
pub fn open(spec: &StageSpec, limits: &Limits) -> Result<AnyStage, StageError> {
    match spec {
        StageSpec::Ur10(address) => Arm::connect(address, limits).map(AnyStage::new),
        StageSpec::Gcode { path, baud } => gcode::open(path, *baud, limits),
        StageSpec::Manual => Manual::at_terminal(limits).map(AnyStage::new),
    }
}

/// A stage of any kind.
pub struct AnyStage(Box<dyn Stage<Error = StageError> + Send>);

impl AnyStage {
    /// A stage whose kind does not matter any more.
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
