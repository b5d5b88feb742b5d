//! Processes, threads and folders.

pub mod background_task;
pub mod folders;
pub mod process;
pub mod workers;
