//! External programs, and their installation.

pub mod debian;
pub mod tool;
pub mod toolchain;
