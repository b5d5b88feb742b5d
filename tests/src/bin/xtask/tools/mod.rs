//! External programs, and their installation.

pub mod cargo_tool;
pub mod debian;
pub mod tool;
pub mod toolchain;
