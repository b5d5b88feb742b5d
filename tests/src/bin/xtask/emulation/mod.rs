//! Emulated boards: builds firmware for them, runs and measures it.

pub mod build;
pub mod counter;
pub mod debugger;
pub mod emulated_board;
pub mod emulator;
pub mod setup;
