//! The operating mode of an arm.

use std::fmt;

/// The operating mode of an arm, numbered like `robot_mode` of RTDE.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RobotMode(pub i32);

impl RobotMode {
    /// The arm is on, and its brakes are released.
    pub const RUNNING: RobotMode = RobotMode(7);

    /// Descriptions by number, starting from -1.
    const DESCRIPTIONS: [&str; 10] = [
        "without a controller",
        "disconnected from its controller",
        "waiting for its safety to be confirmed",
        "booting",
        "switched off",
        "switched on, but not started",
        "idle with its brakes on",
        "in backdrive mode",
        "running",
        "updating its firmware",
    ];
}

/// Completes the sentence "the arm is ...".
impl fmt::Display for RobotMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let index = usize::try_from(i64::from(self.0) + 1).ok();
        match index.and_then(|index| Self::DESCRIPTIONS.get(index)) {
            Some(description) => f.write_str(description),
            None => write!(f, "in mode {}", self.0),
        }
    }
}
