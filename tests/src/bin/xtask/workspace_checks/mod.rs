//! Checks of the whole workspace.

pub mod cluster;
pub mod crashes;
pub mod emulated_arm64;
pub mod emulated_cameras;
pub mod fuzzing;
pub mod host_instructions;
pub mod interpreting;
pub mod mutating;
pub mod pages;
pub mod python_package;
pub mod sanitizing;
pub mod soaking;
