//! The poses of a tool that something else moves.

use super::{StageSpec, error::StageError, exec, limits::Limits, posed::PosedStage as _, robot_arm::ArmMonitor};
use crate::images::Transform;

/// Reads the poses that a stage measures, and never moves it: a person may lead an arm by hand, or by its pendant, meanwhile.
pub struct PoseReader {
    /// The stage, as it is named.
    stage: String,
    read: Box<dyn FnMut() -> Result<Option<Transform>, StageError>>,
}

impl PoseReader {
    /// Connects to a stage.
    ///
    /// # Errors
    /// The limits are out of range, nothing answers within [`Limits::connect_timeout`], or the stage measures no poses.
    pub fn open(spec: &StageSpec, limits: &Limits) -> Result<PoseReader, StageError> {
        let stage = spec.to_string();
        let read: Box<dyn FnMut() -> _> = match spec {
            StageSpec::Ur10(address) => {
                let arm = ArmMonitor::connect(address, limits)?;
                Box::new(move || arm.pose().map(Some))
            }
            StageSpec::Exec(command) => {
                let mut stage = exec::open(command, limits)?;
                Box::new(move || stage.pose())
            }
            StageSpec::Gcode { .. } | StageSpec::Manual | StageSpec::Simulated => return Err(StageError::NoPose { stage }),
        };
        let mut reader = PoseReader { stage, read };
        reader.pose()?;
        Ok(reader)
    }

    /// The pose of the tool in the frame of the stage's base, as it was measured last. It returns within
    /// [`Limits::silence_timeout`].
    ///
    /// # Errors
    /// The stage has failed, no longer answers, or measures no pose.
    pub fn pose(&mut self) -> Result<Transform, StageError> {
        (self.read)()?.ok_or_else(|| StageError::NoPose { stage: self.stage.clone() })
    }
}
