//! Emulated boards: the firmware is built for them, run, and measured.

pub mod build;
pub mod counter;
pub mod emulated_board;
pub mod emulator;
pub mod footprint;
pub mod log;
pub mod setup;
