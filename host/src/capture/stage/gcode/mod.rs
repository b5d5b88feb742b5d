//! Machines that take G-code on a serial port: an XY slide, a mill, a printer, with Grbl 1.1 or a firmware of the RepRap family.
//!
//! The machine's X points to the right of the image and its Y up, as seen along the camera's view. A
//! [`Position`](multiscopic_core::capture::Position) has `y_um` pointing down, so it is the negated Y of the
//! machine. Directions are set in the firmware.
//!
//! Moves are absolute, relative to where the machine was when it was opened, so that repeating a command does
//! not move twice. The machine's zero is left alone: neither `G92` nor a work coordinate system changes. The
//! modes `G21` and `G90` are set before each move.

mod grbl;
mod line_port;
mod reprap;

use std::{
    io::{self, Read, Write},
    sync::Arc,
    time::Duration,
};

use super::{adapters::AnyStage, error::StageError, limits::Limits};
use crate::capture::{Clock, SystemClock};

use line_port::LinePort;

pub use grbl::Grbl;
pub use reprap::RepRap;

/// The default baud rate.
pub const BAUD: u32 = 115_200;

/// The time for which one read of the port blocks.
const READ_TIMEOUT: Duration = Duration::from_millis(10);

/// The time that a machine may take to answer once it has booted.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(500);

/// Opens the machine on a serial port, with any known firmware. It does not move.
///
/// # Errors
/// The limits are out of range, the port cannot be opened, no known firmware answers, or the machine is not
/// ready to move.
pub fn open(path: &str, baud: u32, limits: &Limits) -> Result<AnyStage, StageError> {
    let port = serialport::new(path, baud).timeout(READ_TIMEOUT).open().map_err(|error| {
        let advice = match error.kind() {
            serialport::ErrorKind::Io(io::ErrorKind::PermissionDenied) => "add yourself to the group of serial ports (dialout)",
            _ => "check the cable and the port's name, and that no other program uses it",
        };
        StageError::Connect { to: path.into(), source: error.into(), advice }
    })?;
    connect(port, path, limits)
}

/// Opens the machine at the other end of `port`, which messages call `name`. Reads of the port must time out
/// after a short while.
///
/// # Errors
/// The limits are out of range, no known firmware answers, or the machine is not ready to move.
pub fn connect<P: Read + Write + Send + 'static>(port: P, name: &str, limits: &Limits) -> Result<AnyStage, StageError> {
    connect_with_clock(port, name, limits, Arc::new(SystemClock))
}

/// Opens a machine like [`connect`], in the time of `clock`, in which reads of the port must time out after a short while.
///
/// # Errors
/// Those of [`connect`].
pub fn connect_with_clock<P: Read + Write + Send + 'static>(
    port: P,
    name: &str,
    limits: &Limits,
    clock: Arc<dyn Clock>,
) -> Result<AnyStage, StageError> {
    limits.check()?;
    let mut port = LinePort::new(port, name, limits.silence_timeout, clock);
    let deadline = port.now() + limits.connect_timeout;
    let mut last_line = None;
    while port.now() < deadline {
        // Each firmware answers one of them, and rejects the other without harm.
        for query in ["\n?", FIRMWARE_QUERY] {
            port.send(query)?;
            let until = deadline.min(port.now() + ANSWER_TIMEOUT);
            // Checked for each line: a machine may report without end.
            while port.now() < until {
                let Some(line) = port.next(until)? else { break };
                let name = firmware_name(&line);
                if grbl::is_banner(&line) || line.starts_with('<') || name.is_some() {
                    port.discard_pending()?;
                    return open_known(port, name, limits);
                }
                last_line = Some(line);
            }
        }
    }
    Err(match last_line {
        None => StageError::Silent { from: name.into(), after: limits.connect_timeout },
        Some(line) => StageError::Protocol {
            from: name.into(),
            found: format!("`{line}`"),
            expected: format!("{} at the port's baud rate (gcode:{name}@BAUD)", known_firmwares()),
        },
    })
}

/// Asks for the firmware's name and version. Grbl and FluidNC do not know the question.
const FIRMWARE_QUERY: &str = "M115";

/// The firmware's name and version in an answer.
fn firmware_name(line: &str) -> Option<String> {
    line.split_once("FIRMWARE_NAME:").map(|(_, rest)| rest.trim().to_owned())
}

/// Opens a machine that answers, by the name of its firmware. One that reports as Grbl does may be another, and is asked.
fn open_known<P: Read + Write + Send + 'static>(
    mut port: LinePort<P>,
    mut name: Option<String>,
    limits: &Limits,
) -> Result<AnyStage, StageError> {
    if name.is_none() {
        port.send(FIRMWARE_QUERY)?;
        let deadline = port.now() + ANSWER_TIMEOUT;
        while port.now() < deadline {
            let Some(line) = port.next(deadline)? else { break };
            name = firmware_name(&line);
            if name.is_some() || line == "ok" || line.starts_with("error:") {
                break;
            }
        }
        port.discard_pending()?;
    }
    let Some(name) = name else { return Grbl::open(port, limits).map(AnyStage::new) };
    let is_any = |known: &[&str]| known.iter().any(|known| name.to_lowercase().contains(&known.to_lowercase()));
    match (is_any(&reprap::FIRMWARES), is_any(&["grbl"])) {
        (true, _) => RepRap::open(port, limits).map(AnyStage::new),
        (false, true) => Grbl::open(port, limits).map(AnyStage::new),
        (false, false) => {
            let found = format!("the firmware {name:.60}");
            Err(StageError::Protocol { from: port.name(), found, expected: known_firmwares() })
        }
    }
}

fn known_firmwares() -> String {
    format!("Grbl 1.1, or one of {}", reprap::FIRMWARES.join(", "))
}
