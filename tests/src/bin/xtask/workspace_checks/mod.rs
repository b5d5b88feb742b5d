//! Checks of the whole workspace, and the suites that combine all checks.

pub mod aarch64;
pub mod host_instructions;
pub mod packaging;
pub mod suite;
pub mod v4l2;
