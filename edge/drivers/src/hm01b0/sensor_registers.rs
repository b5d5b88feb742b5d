//! The registers of the HM01B0, which hold 8 bits each at addresses of 16 bits.

use embedded_hal::i2c::{Error, ErrorKind, I2c};

/// The I2C address of the sensor.
pub const ADDRESS: u8 = 0x24;
/// The model number of the sensor.
pub const MODEL: u16 = 0x01b0;

/// The address of a register. Values of 16 bits take two registers, the high byte first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum Register {
    /// The model number, 16 bits.
    Model = 0x0000,
    /// The operating mode: see [`Mode`].
    ModeSelect = 0x0100,
    /// 1 resets every register.
    SoftwareReset = 0x0103,
    /// 1 applies the settings of exposure and gain together.
    GroupHold = 0x0104,
    /// The exposure in lines, 16 bits.
    Integration = 0x0202,
    /// Bits 6..4: the binary logarithm of the analogue gain.
    AnalogGain = 0x0205,
    /// Lines of a frame, blanking included, 16 bits.
    FrameLength = 0x0340,
    /// Pixel clocks of a line, blanking included, 16 bits.
    LineLength = 0x0342,
    /// 1: every column; 3: columns are binned.
    ReadoutX = 0x0383,
    /// 1: every line; 3: lines are binned.
    ReadoutY = 0x0387,
    /// Bit 0: bin lines; bit 1: bin columns.
    Binning = 0x0390,
    /// Bit 0: automatic exposure and gain.
    AutoExposure = 0x2100,
    /// 1: 244 lines; 0: 324.
    QvgaWindow = 0x3010,
    /// The number of frames that [`Mode::Frames`] takes.
    FrameCount = 0x3020,
    /// The width of the pixel bus; 2 is eight bits.
    BitControl = 0x3059,
    /// Bits 1..0: the divider of the master clock, from 8 for 0 to 1 for 3. Bit 3 must be set.
    ClockDivider = 0x3060,
}

/// The operating mode of the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    /// Waits.
    Standby = 0,
    /// Takes as many frames as [`Register::FrameCount`] says, then waits.
    Frames = 3,
}

/// Writes a register.
pub fn write<I: I2c>(bus: &mut I, register: Register, value: u8) -> Result<(), ErrorKind> {
    write_at(bus, register as u16, value)
}

/// Writes a value of 16 bits.
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

/// Reads a value of 16 bits.
pub fn read_wide<I: I2c>(bus: &mut I, register: Register) -> Result<u16, ErrorKind> {
    Ok(u16::from_be_bytes([read_at(bus, register as u16)?, read_at(bus, register as u16 + 1)?]))
}

fn read_at<I: I2c>(bus: &mut I, address: u16) -> Result<u8, ErrorKind> {
    let mut value = [0];
    bus.write_read(ADDRESS, &address.to_be_bytes(), &mut value).map_err(|error| error.kind())?;
    Ok(value[0])
}
