//! Processes, threads and folders.

pub mod background_task;
pub mod folders;
pub mod free_ports;
pub mod process;
pub mod workers;
