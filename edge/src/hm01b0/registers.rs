//! The registers of the HM01B0: 8 bits each, at addresses of 16 bits.

use embedded_hal::i2c::{Error, ErrorKind, I2c};

/// The sensor's address on the bus.
pub const ADDRESS: u8 = 0x24;
/// What it says that it is.
pub const MODEL: u16 = 0x01b0;

/// An address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Register {
    /// The high byte of the model, and after it the low one.
    Model = 0x0000,
    /// What it does: see [`Mode`].
    ModeSelect = 0x0100,
    /// 1 resets every register.
    SoftwareReset = 0x0103,
    /// 1 has the settings of exposure and gain taken together.
    GroupHold = 0x0104,
    /// Lines of exposure, 16 bits, the high byte first.
    Integration = 0x0202,
    /// Bits 6..4: the power of two that analogue amplification is.
    AnalogGain = 0x0205,
    /// Lines of a frame with its blanking, 16 bits.
    FrameLength = 0x0340,
    /// Pixel clocks of a line with its blanking, 16 bits.
    LineLength = 0x0342,
    /// 1: every column, 3: columns are binned.
    ReadoutX = 0x0383,
    /// 1: every line, 3: lines are binned.
    ReadoutY = 0x0387,
    /// Bit 0: lines are binned, bit 1: columns are.
    Binning = 0x0390,
    /// Bit 0: exposure and gain are automatic.
    AutoExposure = 0x2100,
    /// 1: 244 lines, 0: 324.
    QvgaWindow = 0x3010,
    /// How many frames a start makes.
    FrameCount = 0x3020,
    /// How many bits of the bus are used: 2 is all eight.
    BitControl = 0x3059,
    /// Bits 1..0: the divider of the master clock, 8 for 0 down to 1 for 3. Bit 3 is set.
    ClockDivider = 0x3060,
}

/// What the sensor does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    /// Nothing.
    Standby = 0,
    /// As many frames as the frame count says, and then nothing.
    Frames = 3,
}

/// Writes a register.
pub fn write<I: I2c>(bus: &mut I, register: Register, value: u8) -> Result<(), ErrorKind> {
    write_at(bus, register as u16, value)
}

/// Writes a register of 16 bits.
pub fn write_wide<I: I2c>(bus: &mut I, register: Register, value: u16) -> Result<(), ErrorKind> {
    let [high, low] = value.to_be_bytes();
    write_at(bus, register as u16, high)?;
    write_at(bus, register as u16 + 1, low)
}

fn write_at<I: I2c>(bus: &mut I, address: u16, value: u8) -> Result<(), ErrorKind> {
    let [high, low] = address.to_be_bytes();
    bus.write(ADDRESS, &[high, low, value]).map_err(|error| error.kind())
}

/// Reads a register.
pub fn read<I: I2c>(bus: &mut I, register: Register) -> Result<u8, ErrorKind> {
    read_at(bus, register as u16)
}

/// Reads a register of 16 bits.
pub fn read_wide<I: I2c>(bus: &mut I, register: Register) -> Result<u16, ErrorKind> {
    Ok(u16::from_be_bytes([read_at(bus, register as u16)?, read_at(bus, register as u16 + 1)?]))
}

fn read_at<I: I2c>(bus: &mut I, address: u16) -> Result<u8, ErrorKind> {
    let mut value = [0];
    bus.write_read(ADDRESS, &address.to_be_bytes(), &mut value).map_err(|error| error.kind())?;
    Ok(value[0])
}
