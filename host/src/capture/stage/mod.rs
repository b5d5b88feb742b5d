//! Stages, which move the camera: a robot arm, a machine that takes G-code, a person.
//!
//! | item | what it is |
//! | --- | --- |
//! | [`StageSpec`] | which stage, as `--stage` spells it |
//! | [`Limits`] | how far and how fast a stage may go, and how long to wait for it |
//! | [`open`], [`AnyStage`] | opens a stage of any kind |
//! | [`Arm`] | an arm of Universal Robots |
//! | [`gcode`] | machines with Grbl or Marlin on a serial port |
//! | [`ManualStage`] | a person who is prompted |
//! | [`SimulatedStage`], [`StageImperfections`] | none: for trying things out, with the errors of real ones |
//! | [`TurnedStage`] | moves along the axes of a camera that is mounted at an angle |
//! | [`StageError`] | what went wrong, and what to do |
//!
//! A stage's [centre](multiscopic_core::capture::Position::CENTER) is where it is when it is opened. All
//! positions are relative to it.

mod adapters;
mod arm_modes;
mod error;
pub mod gcode;
mod limits;
mod manual;
pub mod robot_arm;
mod simulated;
mod spec;

pub use adapters::{AnyStage, TurnedStage};
pub use arm_modes::SafetyMode;
pub use error::StageError;
pub use limits::Limits;
pub use manual::ManualStage;
pub use robot_arm::{Arm, ArmAddress};
pub use simulated::{SimulatedPlace, SimulatedStage, StageImperfections, StagePose};
pub use spec::StageSpec;

/// Opens the stage that `spec` names.
///
/// # Errors
/// The limits are out of range, or no stage that is ready to move answers within [`Limits::connect_timeout`].
pub fn open(spec: &StageSpec, limits: &Limits) -> Result<AnyStage, StageError> {
    match spec {
        StageSpec::Ur10(address) => Arm::connect(address, limits).map(AnyStage::new),
        StageSpec::Gcode { path, baud } => gcode::open(path, *baud, limits),
        StageSpec::Manual => ManualStage::at_terminal(limits).map(AnyStage::new),
        StageSpec::Simulated => SimulatedStage::new(limits, StageImperfections::default()).map(AnyStage::new),
    }
}
