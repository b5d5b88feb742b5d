//! The modes that an arm reports: those of its safety functions and of its operation.

use std::fmt;

/// The safety mode of an arm of Universal Robots, numbered like `safety_mode` of RTDE.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SafetyMode {
    /// The arm may move.
    Normal,
    /// The arm may move, but slowly.
    Reduced,
    /// The arm met an obstacle, or an unexpected force.
    ProtectiveStop,
    /// The arm must be moved back within its safety limits.
    Recovery,
    /// A safeguard, such as a light curtain, stopped the arm.
    SafeguardStop,
    /// The emergency stop of the installation was pressed.
    SystemEmergencyStop,
    /// The emergency stop of the arm was pressed.
    RobotEmergencyStop,
    /// The arm exceeded a safety limit.
    Violation,
    /// The safety system has a fault.
    Fault,
    /// A mode that only newer controllers have.
    Other(i32),
}

impl SafetyMode {
    /// Returns true if the arm may move.
    pub fn may_move(self) -> bool {
        matches!(self, SafetyMode::Normal | SafetyMode::Reduced)
    }
}

impl From<i32> for SafetyMode {
    fn from(number: i32) -> SafetyMode {
        match number {
            1 => SafetyMode::Normal,
            2 => SafetyMode::Reduced,
            3 => SafetyMode::ProtectiveStop,
            4 => SafetyMode::Recovery,
            5 => SafetyMode::SafeguardStop,
            6 => SafetyMode::SystemEmergencyStop,
            7 => SafetyMode::RobotEmergencyStop,
            8 => SafetyMode::Violation,
            9 => SafetyMode::Fault,
            other => SafetyMode::Other(other),
        }
    }
}

impl fmt::Display for SafetyMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self {
            SafetyMode::Normal => "normal operation",
            SafetyMode::Reduced => "reduced operation",
            SafetyMode::ProtectiveStop => "protective stop",
            SafetyMode::Recovery => "recovery mode",
            SafetyMode::SafeguardStop => "safeguard stop",
            SafetyMode::SystemEmergencyStop => "emergency stop of the installation",
            SafetyMode::RobotEmergencyStop => "emergency stop of the arm",
            SafetyMode::Violation => "a safety limit was exceeded",
            SafetyMode::Fault => "a safety fault",
            SafetyMode::Other(number) => return write!(f, "safety mode {number}"),
        };
        f.write_str(name)
    }
}

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
