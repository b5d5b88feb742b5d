//! Processes, threads and folders.

pub mod background;
pub mod folders;
pub mod process;
pub mod workers;
