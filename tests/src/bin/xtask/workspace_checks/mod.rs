//! Checks of the whole workspace.

pub mod cluster;
pub mod emulated_arm64;
pub mod failing;
pub mod fuzzing;
pub mod mutating;
pub mod pages;
pub mod python_package;
pub mod sanitizing;
