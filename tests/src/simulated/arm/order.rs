//! The orders that an arm was given.

use crate::simulated::pose::Pose;

/// What the arm was told.
#[derive(Clone, Debug, PartialEq)]
pub enum Heard {
    /// To move to a pose.
    Move(Pose),
    /// To stop.
    Stop,
    /// Something that is no script that it knows.
    Nonsense(String),
}
