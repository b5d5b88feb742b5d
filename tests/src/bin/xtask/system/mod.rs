//! Processes, threads and folders.

pub mod folders;
pub mod process;
pub mod workers;
