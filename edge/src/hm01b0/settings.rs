//! How the sensor takes frames.

use embedded_hal::i2c::{ErrorKind, I2c};

use super::registers::{self, Mode, Register};

/// How frames are taken: the same way from the beginning of a sequence to its end.
///
/// ```
/// use multiscopic_edge::hm01b0::{ClockDivider, Gain, Settings, Size};
/// const SETTINGS: Settings = Settings { exposure_lines: 120, gain: Gain::X2, ..Settings::new(Size::Qvga) };
/// // A clock of 12 MHz by 4: 125 us a line, 15 ms of exposure.
/// assert_eq!((SETTINGS.clock, SETTINGS.line_clocks), (ClockDivider::By4, 376));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Pixels of a frame.
    pub size: Size,
    /// How long a line is exposed, in times of a line: 2 to 65533, and what is beyond is taken as the nearest. A frame takes at least so long.
    pub exposure_lines: u16,
    /// Analogue amplification.
    pub gain: Gain,
    /// The sensor's clock.
    pub clock: ClockDivider,
    /// How long a line takes, in cycles of the divided clock: at least [`Size::least_line_clocks`]. More of them give the program more time for
    /// a frame that is matched while it is read out.
    pub line_clocks: u16,
    /// Whether the last frame of a plan is not stored, but read from the sensor line by line.
    pub stream_last: bool,
}

impl Settings {
    /// Frames of a size, as fast as a quarter of the master clock allows, exposed for half of a frame's time and not amplified. The last
    /// one is streamed.
    pub const fn new(size: Size) -> Settings {
        Settings {
            size,
            exposure_lines: (size.lines() / 2) as u16,
            gain: Gain::X1,
            clock: ClockDivider::By4,
            line_clocks: size.least_line_clocks(),
            stream_last: true,
        }
    }

    /// Writes all that differs from what the sensor has after a reset.
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
            registers::write(i2c, register, value)?;
        }
        let words = [
            (Register::LineLength, self.line_clocks.max(self.size.least_line_clocks())),
            (Register::FrameLength, self.size.least_frame_lines().max(exposure + 2)),
            (Register::Integration, exposure),
        ];
        for (register, value) in words {
            registers::write_wide(i2c, register, value)?;
        }
        registers::write(i2c, Register::GroupHold, 1)
    }
}

/// How many pixels a frame has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// 320x240 pixels, of the sensor's 324x244 the middle.
    Qvga,
    /// 160x120 pixels: each is four of the sensor's.
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

    /// Pixels in a line of the sensor: the length of a buffer.
    pub const fn columns(self) -> usize {
        match self {
            Size::Qvga => 324,
            Size::Qqvga => 162,
        }
    }

    /// Lines of the sensor.
    pub const fn lines(self) -> usize {
        match self {
            Size::Qvga => 244,
            Size::Qqvga => 122,
        }
    }

    /// The least number of clock cycles in which a line can be read out.
    pub const fn least_line_clocks(self) -> u16 {
        match self {
            Size::Qvga => 376,
            Size::Qqvga => 215,
        }
    }

    /// How many of the sensor's pixels lie around a frame, on each side.
    pub(super) const fn border(self) -> usize {
        match self {
            Size::Qvga => 2,
            Size::Qqvga => 1,
        }
    }

    /// The least number of lines that a frame takes, with the time between frames.
    const fn least_frame_lines(self) -> u16 {
        match self {
            Size::Qvga => 260,
            Size::Qqvga => 132,
        }
    }
}

/// Analogue amplification.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Gain {
    /// None.
    X1 = 0,
    /// Twice.
    X2 = 1,
    /// Four times.
    X4 = 2,
    /// Eight times.
    X8 = 3,
}

/// By how much the sensor divides the master clock for its pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ClockDivider {
    /// 8.
    By8 = 0,
    /// 4.
    By4 = 1,
    /// 2.
    By2 = 2,
    /// Not.
    By1 = 3,
}
