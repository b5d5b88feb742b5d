//! Programs and folders.

pub mod layout;
pub mod process;
pub mod workers;
