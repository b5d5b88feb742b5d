//! The errors of the stage.

use core::{error, fmt};
use embedded_hal::digital::ErrorKind;

use super::{
    axis::AxisError,
    drive::{AxisEnd, AxisId},
};

/// An error that keeps the stage from moving, or has stopped it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StepperError {
    /// The description of an axis is invalid.
    Axis {
        /// The axis.
        axis: AxisId,
        /// The fault.
        error: AxisError,
    },
    /// A pin cannot be set or read.
    Pin {
        /// The axis of the pin.
        axis: AxisId,
        /// The error of the HAL.
        kind: ErrorKind,
    },
    /// A limit switch was pressed and stopped the motion at once.
    Limit {
        /// The axis of the switch.
        axis: AxisId,
        /// The end of the switch.
        end: AxisEnd,
    },
    /// The position is out of range. What the stage was doing goes on.
    Beyond {
        /// The axis.
        axis: AxisId,
        /// The position in micrometres.
        um: i32,
        /// The least position in micrometres.
        min_um: i32,
        /// The greatest position in micrometres.
        max_um: i32,
    },
    /// The stage does not know its position.
    NotHomed,
    /// Homing travelled the whole axis without reaching the switch at the low end.
    SwitchNotFound {
        /// The axis.
        axis: AxisId,
    },
    /// The switch at the low end was not released on the way back.
    SwitchStuck {
        /// The axis.
        axis: AxisId,
    },
}

impl fmt::Display for StepperError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            StepperError::Axis { axis, error } => write!(f, "axis {axis}: {error}"),
            StepperError::Pin { axis, kind } => write!(f, "a pin of axis {axis} failed: {kind}"),
            StepperError::Limit { axis, end } => write!(f, "the switch at the {end} end of axis {axis} stopped the motion"),
            StepperError::Beyond { axis, um, min_um, max_um } => {
                write!(f, "{um} um along {axis} is beyond {min_um}..={max_um} um")
            }
            StepperError::NotHomed => f.write_str("the stage does not know its position: home it first"),
            StepperError::SwitchNotFound { axis } => write!(f, "the switch at the low end of axis {axis} was not found"),
            StepperError::SwitchStuck { axis } => write!(f, "the switch at the low end of axis {axis} stays pressed"),
        }
    }
}

impl error::Error for StepperError {}
