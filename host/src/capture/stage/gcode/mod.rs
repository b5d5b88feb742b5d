//! Machines that take G-code on a serial port: an XY slide, a mill, a printer, with Grbl 1.1 or Marlin.
//!
//! The machine's X points to the right of the image and its Y up, as seen along the camera's view, so a
//! [`Position`]'s `y_um`, which points down, is the machine's Y negated. Directions are set in the firmware.
//!
//! Moves are absolute, from where the machine was when it was opened, so an order given twice moves once. No zero is set: neither `G92` nor
//! a work coordinate system changes, and whoever uses the machine next finds it as it was. Other modes (`G21`, `G90`) are set before each move.

mod grbl;
mod lines;
mod marlin;

pub use grbl::Grbl;
pub use marlin::Marlin;

use std::{
    io::{self, Read, Write},
    time::{Duration, Instant},
};

use super::{AnyStage, Limits, StageError};
use lines::Lines;
use multiscopic_core::capture::Position;

/// Symbols per second, if nothing else is said: what both firmwares are built with.
pub const BAUD: u32 = 115_200;

/// How long one read of the port waits.
const READ: Duration = Duration::from_millis(10);

/// How long a machine that has booted takes to answer.
const ANSWER: Duration = Duration::from_millis(500);

/// Opens the machine on a serial port, whichever of both firmwares it has. It does not move.
///
/// # Errors
/// The limits are out of range, the port cannot be opened, nothing answers that is known, or the machine is not ready to move.
pub fn open(path: &str, baud: u32, limits: &Limits) -> Result<AnyStage, StageError> {
    let port = serialport::new(path, baud).timeout(READ).open().map_err(|error| {
        let advice = match error.kind() {
            serialport::ErrorKind::Io(io::ErrorKind::PermissionDenied) => "add yourself to the group of serial ports (dialout)",
            _ => "check the cable and the port's name, and that no other program has it",
        };
        StageError::Connect { to: path.into(), source: error.into(), advice }
    })?;
    connect(port, path, limits)
}

/// Finds out what is at the other end of `port`, which messages call `name`. A read of it must wait a little and then say that it timed out.
///
/// # Errors
/// The limits are out of range, nothing answers that is known, or the machine is not ready to move.
pub fn connect<P: Read + Write + Send + 'static>(port: P, name: &str, limits: &Limits) -> Result<AnyStage, StageError> {
    limits.check()?;
    let mut lines = Lines::new(port, name, limits.silence_timeout);
    let deadline = Instant::now() + limits.connect_timeout;
    let mut last = None;
    while Instant::now() < deadline {
        // Each firmware refuses the question of the other.
        for question in ["\n?", "M115"] {
            lines.send(question)?;
            let until = deadline.min(Instant::now() + ANSWER);
            // It may never stop talking.
            while Instant::now() < until {
                let Some(line) = lines.next(until)? else { break };
                if grbl::is_banner(&line) || line.starts_with('<') {
                    lines.settle()?;
                    return Grbl::open(lines, limits).map(AnyStage::new);
                }
                if line.contains("FIRMWARE_NAME:") {
                    lines.settle()?;
                    return Marlin::open(lines, limits).map(AnyStage::new);
                }
                last = Some(line);
            }
        }
    }
    Err(match last {
        None => StageError::Silent { from: name.into(), after: limits.connect_timeout },
        Some(line) => StageError::Protocol {
            from: name.into(),
            found: format!("`{line}`"),
            expected: format!("Grbl 1.1 or Marlin, at the symbol rate of the port (gcode:{name}@BAUD)"),
        },
    })
}

/// A position in the machine's coordinates, in millimetres, if it started at `start`.
fn to_machine(start: [f64; 2], position: Position) -> [f64; 2] {
    [start[0] + f64::from(position.x_um) / 1e3, start[1] - f64::from(position.y_um) / 1e3]
}

/// The position of a machine that started at `start`.
fn to_position(start: [f64; 2], machine: [f64; 2]) -> Position {
    let um = |millimetres: f64| (millimetres * 1e3).round() as i32;
    Position { x_um: um(machine[0] - start[0]), y_um: um(start[1] - machine[1]) }
}

/// A move in a straight line.
fn linear(target: [f64; 2], limits: &Limits) -> String {
    // Minus nothing is nothing.
    let [x, y] = target.map(|millimetres| (millimetres * 1e4).round() / 1e4 + 0.0);
    format!("G1 X{x:.4} Y{y:.4} F{:.1}", limits.speed_mm_s * 60.0)
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// A number of millimetres, or whatever the machine counts in, that can be meant.
fn coordinate(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|number: &f64| (-1e5..=1e5).contains(number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn down_is_against_y() {
        let position = Position { x_um: 1500, y_um: 250 };
        assert_eq!(to_machine([10.0, 20.0], position), [11.5, 19.75]);
        assert_eq!(to_position([10.0, 20.0], [11.5, 19.75]), position);
        assert_eq!(linear([11.5, -0.00001], &Limits::default()), "G1 X11.5000 Y0.0000 F3000.0");
    }
}
