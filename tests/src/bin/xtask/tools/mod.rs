//! The programs that the checks run, and how they are installed.

pub mod debian;
pub mod tool;
pub mod toolchain;
