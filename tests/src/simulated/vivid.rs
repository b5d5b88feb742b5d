//! Linux's virtual video driver vivid: cameras that show patterns and fail on demand.

use std::{io, path::Path};

use v4l::{Control, Device, control::Value};

/// The driver's control for the test pattern, and the one for its text overlay.
const PATTERN: u32 = 0x00F0_F000;
const TEXT: u32 = 0x00F0_F001;

/// A still test pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// Eight bars of equal width: white, yellow, cyan, green, magenta, red, blue, black.
    Bars = 1,
    /// Black.
    Black = 5,
    /// White.
    White = 6,
}

/// A fault of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// This percentage of frames is dropped from now on.
    Dropped(u8),
    /// The device is disconnected until nobody has it open.
    Disconnected,
    /// The next frame is flagged as damaged.
    Damaged,
    /// The next request for buffers fails.
    Buffers,
    /// The next buffer cannot be queued.
    Queue,
    /// The next stream does not start.
    Start,
    /// The stream fails for good.
    Fatal,
}

/// Shows `pattern` without a text overlay.
///
/// # Errors
/// If `device` does not belong to this driver.
pub fn show(device: &Path, pattern: Pattern) -> io::Result<()> {
    let device = Device::with_path(device)?;
    set(&device, TEXT, 2)?;
    set(&device, PATTERN, pattern as i64)
}

/// Makes a camera fail.
///
/// # Errors
/// If `device` does not belong to this driver.
pub fn inject(device: &Path, fault: Fault) -> io::Result<()> {
    let device = Device::with_path(device)?;
    match fault {
        Fault::Dropped(percent) => set(&device, 0x00F0_F040, percent.into()),
        Fault::Disconnected => set(&device, 0x00F0_F041, 1),
        Fault::Damaged => set(&device, 0x00F0_F042, 1),
        Fault::Buffers => set(&device, 0x00F0_F043, 1),
        Fault::Queue => set(&device, 0x00F0_F044, 1),
        Fault::Start => set(&device, 0x00F0_F045, 1),
        Fault::Fatal => set(&device, 0x00F0_F046, 1),
    }
}

fn set(device: &Device, id: u32, value: i64) -> io::Result<()> {
    device.set_control(Control { id, value: Value::Integer(value) })
}
