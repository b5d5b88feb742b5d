//! The sensor: its settings for frames, and its registers, which hold 8 bits each at addresses of 16 bits.

use embedded_hal::i2c::{Error, ErrorKind, I2c};

/// The settings for frames. They stay fixed for a whole sequence, so that all its frames are exposed alike.
///
/// ```
/// use multiscopic_drivers::hm01b0::{ClockDivider, Configuration, DataLines, Gain, Size};
/// const CONFIGURATION: Configuration =
///     Configuration { exposure_lines: 120, gain: Gain::X2, ..Configuration::new(Size::Qvga) };
/// // A master clock of 12 MHz, divided by 4: 125 us a line, 15 ms of exposure.
/// assert_eq!((CONFIGURATION.clock, CONFIGURATION.line_clocks), (ClockDivider::By4, 376));
/// // The pixel bus has eight data lines, and a clock of 3 MHz.
/// assert_eq!((CONFIGURATION.data_lines, CONFIGURATION.data_lines.clocks()), (DataLines::Eight, 1));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Configuration {
    /// The size of a frame.
    pub size: Size,
    /// The exposure in line times, clamped to 2..=65533. A frame takes at least as long.
    pub exposure_lines: u16,
    /// The analogue gain.
    pub gain: Gain,
    /// The data lines of the pixel bus.
    pub data_lines: DataLines,
    /// The divider of the sensor's master clock, raised to what the [data lines](DataLines) allow.
    pub clock: ClockDivider,
    /// The line time in cycles of the divided clock, raised to [`Size::least_line_clocks`]. Longer lines give
    /// the program more time to match a frame during readout.
    pub line_clocks: u16,
    /// True if the last frame of a plan is read by the line during readout instead of being stored.
    pub stream_last: bool,
}

impl Configuration {
    /// The fastest readout at a quarter of the master clock, over eight data lines. Half a frame of exposure, no gain,
    /// the last frame streamed.
    pub const fn new(size: Size) -> Configuration {
        Configuration {
            size,
            exposure_lines: (size.lines() / 2) as u16,
            gain: Gain::X1,
            data_lines: DataLines::Eight,
            clock: ClockDivider::By4,
            line_clocks: size.least_line_clocks(),
            stream_last: true,
        }
    }

    /// Writes the registers that differ from their values after a reset.
    pub(super) fn write<I: I2c>(&self, i2c: &mut I) -> Result<(), ErrorKind> {
        let exposure = self.exposure_lines.clamp(2, u16::MAX - 2);
        let (readout, binning) = match self.size {
            Size::Qvga => (1, 0),
            Size::Qqvga => (3, 3),
        };
        let lines = self.data_lines;
        let clock = 1 << 5 | lines.order() | 1 << 3 | (self.clock as u8).min(lines.least_divider() as u8);
        let bytes = [
            (Register::ModeSelect, Mode::Standby as u8),
            (Register::BitControl, lines.bit_control()),
            (Register::OutputPins, 4),
            (Register::ReadoutX, readout),
            (Register::ReadoutY, readout),
            (Register::Binning, binning),
            (Register::QvgaWindow, 1),
            (Register::ClockDivider, clock),
            (Register::AutoExposure, 0),
            (Register::AnalogGain, (self.gain as u8) << 4),
            (Register::FrameCount, 1),
        ];
        for (register, value) in bytes {
            write(i2c, register, value)?;
        }
        let words = [
            (Register::LineLength, self.line_clocks.max(self.size.least_line_clocks())),
            (Register::FrameLength, self.size.least_frame_lines().max(exposure + 2)),
            (Register::Integration, exposure),
        ];
        for (register, value) in words {
            write_wide(i2c, register, value)?;
        }
        write(i2c, Register::GroupHold, 1)
    }
}

/// The size of a frame. The sensor reads out a border around it, which is dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// 320x240 pixels: the middle of the sensor's 324x244.
    Qvga,
    /// 160x120 pixels, each binned from four of the sensor's.
    Qqvga,
}

impl Size {
    /// Pixels in a line of a frame.
    pub const fn width(self) -> usize {
        self.columns() - 2 * self.border()
    }

    /// Lines of a frame.
    pub const fn height(self) -> usize {
        self.lines() - 2 * self.border()
    }

    /// Pixels in a line of the sensor, border included: the length of a line buffer.
    pub const fn columns(self) -> usize {
        match self {
            Size::Qvga => 324,
            Size::Qqvga => 162,
        }
    }

    /// Lines of the sensor, border included.
    pub const fn lines(self) -> usize {
        match self {
            Size::Qvga => 244,
            Size::Qqvga => 122,
        }
    }

    /// The least clock cycles of a line.
    pub const fn least_line_clocks(self) -> u16 {
        match self {
            Size::Qvga => 376,
            Size::Qqvga => 215,
        }
    }

    /// The width of the border in pixels, the same on each side.
    pub(super) const fn border(self) -> usize {
        match self {
            Size::Qvga => 2,
            Size::Qqvga => 1,
        }
    }

    /// The least lines of a frame, blanking included.
    const fn least_frame_lines(self) -> u16 {
        match self {
            Size::Qvga => 260,
            Size::Qqvga => 132,
        }
    }
}

/// The analogue gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Gain {
    /// 1.
    X1 = 0,
    /// 2.
    X2 = 1,
    /// 4.
    X4 = 2,
    /// 8.
    X8 = 3,
}

/// The divider from the master clock to the pixel clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ClockDivider {
    /// 8.
    By8 = 0,
    /// 4.
    By4 = 1,
    /// 2.
    By2 = 2,
    /// 1.
    By1 = 3,
}

/// The data lines of the pixel bus. Modules rarely have all eight on their connector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataLines {
    /// D0 to D7: a pixel for each pixel clock.
    Eight,
    /// D0 to D3: the upper half of a pixel, then the lower half. The master clock is divided by 2 or more.
    Four,
    /// D0: the bits of a pixel, the highest first. The master clock is divided by 8.
    One,
}

impl DataLines {
    /// The number of lines.
    pub const fn count(self) -> usize {
        match self {
            DataLines::Eight => 8,
            DataLines::Four => 4,
            DataLines::One => 1,
        }
    }

    /// Pixel clocks for a pixel. The pixel clock is as many times the divided master clock.
    pub const fn clocks(self) -> usize {
        8 / self.count()
    }

    /// The least divider: the pixel clock is no faster than the master clock.
    const fn least_divider(self) -> ClockDivider {
        match self {
            DataLines::Eight => ClockDivider::By1,
            DataLines::Four => ClockDivider::By2,
            DataLines::One => ClockDivider::By8,
        }
    }

    /// The bit of [`Register::ClockDivider`] for the order of the bits of a pixel.
    const fn order(self) -> u8 {
        match self {
            DataLines::Eight => 0,
            DataLines::Four | DataLines::One => 1 << 4,
        }
    }

    /// The value of [`Register::BitControl`].
    const fn bit_control(self) -> u8 {
        match self {
            DataLines::Eight => 0x02,
            DataLines::Four => 0x42,
            DataLines::One => 0x22,
        }
    }
}

/// The I2C address of the sensor.
const ADDRESS: u8 = 0x24;
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
    /// The width of the pixel bus. Bit 6: four lines; bit 5: one line; 2 in the others.
    BitControl = 0x3059,
    /// Bit 5: the pixel clock is gated, so that it runs for pixels alone. Bit 4: the highest bits of a pixel come first. Bits
    /// 3..2: the divider of the clock of the registers, 2 for none. Bits 1..0: the divider of the master clock, from 8 for 0 to
    /// 1 for 3.
    ClockDivider = 0x3060,
    /// The state of the output pins. 4, "pad pull 0", is what the vendor's settings have.
    OutputPins = 0x3065,
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
fn write_wide<I: I2c>(bus: &mut I, register: Register, value: u16) -> Result<(), ErrorKind> {
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
