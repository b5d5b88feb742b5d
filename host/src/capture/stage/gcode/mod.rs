//! Machines that take G-code on a serial port: an XY slide, a mill, a printer, with Grbl 1.1 or Marlin.
//!
//! The machine's X points to the right of the image and its Y up, as seen along the camera's view. A
//! [`Position`](multiscopic_core::capture::Position) has `y_um` pointing down, so it is the negated Y of the
//! machine. Directions are set in the firmware.
//!
//! Moves are absolute, relative to where the machine was when it was opened, so that repeating a command does
//! not move twice. The machine's zero is left alone: neither `G92` nor a work coordinate system changes. The
//! modes `G21` and `G90` are set before each move.

mod coordinates;
pub(super) mod detection;
mod grbl;
mod line_port;
mod marlin;

pub use detection::{BAUD, connect, connect_with_clock, open};
pub use grbl::Grbl;
pub use marlin::Marlin;
