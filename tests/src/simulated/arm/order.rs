//! Orders that the arm received.

use crate::simulated::pose::Pose;

/// An order that the arm received.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// To move to a pose.
    Move(Pose),
    /// To stop.
    Stop,
    /// A line that is not a known script command.
    Nonsense(String),
}
