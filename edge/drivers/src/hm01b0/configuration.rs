//! The sensor's settings for frames.

use embedded_hal::i2c::{ErrorKind, I2c};

use super::sensor_registers::{self, Mode, Register};

/// The settings for frames. They stay fixed for a whole sequence, so that all its frames are exposed alike.
///
/// ```
/// use multiscopic_drivers::hm01b0::{ClockDivider, Configuration, Gain, Size};
/// const CONFIGURATION: Configuration =
///     Configuration { exposure_lines: 120, gain: Gain::X2, ..Configuration::new(Size::Qvga) };
/// // A master clock of 12 MHz, divided by 4: 125 us a line, 15 ms of exposure.
/// assert_eq!((CONFIGURATION.clock, CONFIGURATION.line_clocks), (ClockDivider::By4, 376));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Configuration {
    /// The size of a frame.
    pub size: Size,
    /// The exposure in line times, clamped to 2..=65533. A frame takes at least as long.
    pub exposure_lines: u16,
    /// The analogue gain.
    pub gain: Gain,
    /// The divider of the sensor's master clock.
    pub clock: ClockDivider,
    /// The line time in cycles of the divided clock, raised to [`Size::least_line_clocks`]. Longer lines give
    /// the program more time to match a frame during readout.
    pub line_clocks: u16,
    /// True if the last frame of a plan is read by the line during readout instead of being stored.
    pub stream_last: bool,
}

impl Configuration {
    /// The fastest readout at a quarter of the master clock. Half a frame of exposure, no gain, the last
    /// frame streamed.
    pub const fn new(size: Size) -> Configuration {
        Configuration {
            size,
            exposure_lines: (size.lines() / 2) as u16,
            gain: Gain::X1,
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
        let bytes = [
            (Register::ModeSelect, Mode::Standby as u8),
            (Register::BitControl, 2),
            (Register::ReadoutX, readout),
            (Register::ReadoutY, readout),
            (Register::Binning, binning),
            (Register::QvgaWindow, 1),
            (Register::ClockDivider, 1 << 3 | self.clock as u8),
            (Register::AutoExposure, 0),
            (Register::AnalogGain, (self.gain as u8) << 4),
            (Register::FrameCount, 1),
        ];
        for (register, value) in bytes {
            sensor_registers::write(i2c, register, value)?;
        }
        let words = [
            (Register::LineLength, self.line_clocks.max(self.size.least_line_clocks())),
            (Register::FrameLength, self.size.least_frame_lines().max(exposure + 2)),
            (Register::Integration, exposure),
        ];
        for (register, value) in words {
            sensor_registers::write_wide(i2c, register, value)?;
        }
        sensor_registers::write(i2c, Register::GroupHold, 1)
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
