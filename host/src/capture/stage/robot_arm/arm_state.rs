//! The state of an arm over time.

use std::time::Instant;

use super::{robot_mode::RobotMode, rtde::Sample};
use crate::capture::stage::error::StageError;

/// The tool counts as standing still below these speeds, in metres and radians per second: what the sensors
/// report of a tool at rest.
const STILL_SPEED: [f64; 2] = [1e-3, 1e-2];

/// Samples in a row below [`STILL_SPEED`] for the tool to count as still.
const STILL_SAMPLES: u64 = 5;

/// The latest sample of an arm's state, and what happened up to it.
#[derive(Clone, Copy, Debug)]
pub struct ArmState {
    /// The latest sample.
    pub sample: Sample,
    /// When it arrived.
    pub at: Instant,
    /// Number of samples so far.
    pub count: u64,
    /// The value of `count` when the tool last moved.
    pub last_moved: u64,
    /// The value of `count` when a program last ran.
    pub last_playing: u64,
}

impl ArmState {
    /// The state at the first sample, which arrived at time `at`.
    pub fn first(sample: Sample, at: Instant) -> ArmState {
        ArmState { sample, at, count: 0, last_moved: 0, last_playing: 0 }.next(sample, at)
    }

    /// The state after another sample, which arrived at time `at`.
    pub fn next(self, sample: Sample, at: Instant) -> ArmState {
        let count = self.count + 1;
        let speeds = sample.speed.map(|[x, y, z]| x.hypot(y).hypot(z));
        let is_moving = speeds.iter().zip(STILL_SPEED).any(|(&speed, still)| speed > still);
        ArmState {
            sample,
            at,
            count,
            last_moved: if is_moving { count } else { self.last_moved },
            last_playing: if sample.is_playing { count } else { self.last_playing },
        }
    }

    /// Returns true if the tool has stood still for some samples, all of them after sample number `since`.
    pub fn is_still(&self, since: u64) -> bool {
        self.count >= self.last_moved.max(since) + STILL_SAMPLES
    }

    /// Fails unless the arm can move.
    ///
    /// # Errors
    /// [`StageError::SafetyStop`] or [`StageError::NotReady`].
    pub fn check_ready(self) -> Result<ArmState, StageError> {
        let Sample { safety, robot_mode, .. } = self.sample;
        if !safety.may_move() {
            return Err(StageError::SafetyStop(safety));
        }
        if robot_mode != RobotMode::RUNNING {
            let found = format!("the arm is {robot_mode}");
            return Err(StageError::NotReady { found, advice: "switch it on and release its brakes at the teach pendant" });
        }
        Ok(self)
    }
}
