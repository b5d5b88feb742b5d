//! The errors of the camera.

use core::{error, fmt};
use embedded_hal::i2c::ErrorKind;

use super::{readout::FrameDefect, sensor_registers};

/// An error that left no frame, or no line of one. `S` is the error of the frame store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Hm01b0Error<S> {
    /// The I2C bus failed.
    I2c(ErrorKind),
    /// The sensor is another one, or there is none.
    Model {
        /// Its model number; an HM01B0 has 0x01b0.
        found: u16,
    },
    /// The sensor did not complete its reset within 20 ms.
    NotReset,
    /// The plan has no frame of this index.
    NoFrame {
        /// The index.
        index: usize,
    },
    /// Lines arrived faster than they were taken, and some were lost.
    Lost {
        /// The first lost line, counted from the top of the sensor, border included.
        line: usize,
    },
    /// The frame ended too early or too late.
    Torn {
        /// The number of its lines, border included.
        lines: usize,
    },
    /// A line is too short or too long, or follows the last one.
    Line {
        /// The line, counted from the top of the sensor, border included.
        line: usize,
        /// The number of its pixels.
        pixels: usize,
    },
    /// The line has not arrived yet.
    Waiting {
        /// The requested line.
        line: usize,
    },
    /// The frame is read out by the line, and another line is next; or the requested line has another width.
    NotThisLine {
        /// The requested line.
        line: usize,
    },
    /// A line could not be stored, or read from the store.
    Store(S),
}

impl<S> From<ErrorKind> for Hm01b0Error<S> {
    fn from(kind: ErrorKind) -> Self {
        Hm01b0Error::I2c(kind)
    }
}

impl<S> From<FrameDefect> for Hm01b0Error<S> {
    fn from(defect: FrameDefect) -> Self {
        match defect {
            FrameDefect::Lost { line } => Hm01b0Error::Lost { line },
            FrameDefect::Torn { lines } => Hm01b0Error::Torn { lines },
            FrameDefect::Line { line, pixels } => Hm01b0Error::Line { line, pixels },
        }
    }
}

impl<S: fmt::Display> fmt::Display for Hm01b0Error<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Hm01b0Error::I2c(kind) => write!(f, "the sensor's registers cannot be reached: {kind}"),
            Hm01b0Error::Model { found } => {
                write!(f, "the sensor is {found:#06x}, an HM01B0 is {:#06x}", sensor_registers::MODEL)
            }
            Hm01b0Error::NotReset => f.write_str("the sensor did not complete its reset"),
            Hm01b0Error::NoFrame { index } => write!(f, "the plan has no frame {index}"),
            Hm01b0Error::Lost { line } => write!(f, "lines from {line} on came faster than they were taken"),
            Hm01b0Error::Torn { lines } => write!(f, "the frame is torn: it ended after {lines} lines"),
            Hm01b0Error::Line { line, pixels } => write!(f, "line {line} of the sensor came with {pixels} pixels"),
            Hm01b0Error::Waiting { line } => write!(f, "line {line} has not come yet"),
            Hm01b0Error::NotThisLine { line } => write!(f, "line {line} is not the next one of the sensor"),
            Hm01b0Error::Store(error) => write!(f, "{error}"),
        }
    }
}

impl<S: error::Error> error::Error for Hm01b0Error<S> {}
