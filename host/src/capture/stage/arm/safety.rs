//! What stops an arm.

use std::fmt;

/// What the safety functions of an arm say, as RTDE's `safety_mode` numbers it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SafetyMode {
    /// It may move.
    Normal,
    /// It may move slowly.
    Reduced,
    /// It met a force or an obstacle.
    ProtectiveStop,
    /// It is to be moved back into its limits.
    Recovery,
    /// A safeguard, such as a light curtain, stopped it.
    SafeguardStop,
    /// An emergency stop of the installation was pressed.
    SystemEmergencyStop,
    /// Its own emergency stop was pressed.
    RobotEmergencyStop,
    /// It went beyond a safety limit.
    Violation,
    /// It is broken.
    Fault,
    /// Something else that only newer arms know.
    Other(i32),
}

impl SafetyMode {
    /// Whether it may move.
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
