//! The electronics of an axis.

use core::{convert::Infallible, fmt};
use embedded_hal::digital::{Error, ErrorKind, ErrorType, InputPin, OutputPin, PinState};

/// The electronics of an axis: a motor driver with step and direction inputs, and two limit switches.
pub trait Drive {
    /// Sets the direction of the next steps.
    ///
    /// # Errors
    /// That of the pin.
    fn set_direction(&mut self, level: PinState) -> Result<(), ErrorKind>;

    /// Sets the step pin. The motor makes a step on the rising edge.
    ///
    /// # Errors
    /// That of the pin.
    fn set_step(&mut self, level: PinState) -> Result<(), ErrorKind>;

    /// Reads the level of the switch at `end`.
    ///
    /// # Errors
    /// That of the pin.
    fn switch(&mut self, end: AxisEnd) -> Result<PinState, ErrorKind>;
}

/// The pins of an axis, of any HAL.
#[derive(Clone, Copy, Debug)]
pub struct Pins<Step, Dir, Low, High> {
    /// The step input of the motor driver, active on the rising edge.
    pub step: Step,
    /// The direction input of the motor driver.
    pub dir: Dir,
    /// The switch at the low end.
    pub low: Low,
    /// The switch at the high end, or [`Fixed`] if there is none.
    pub high: High,
}

impl<Step: OutputPin, Dir: OutputPin, Low: InputPin, High: InputPin> Drive for Pins<Step, Dir, Low, High> {
    fn set_direction(&mut self, level: PinState) -> Result<(), ErrorKind> {
        self.dir.set_state(level).map_err(|error| error.kind())
    }

    fn set_step(&mut self, level: PinState) -> Result<(), ErrorKind> {
        self.step.set_state(level).map_err(|error| error.kind())
    }

    fn switch(&mut self, end: AxisEnd) -> Result<PinState, ErrorKind> {
        let is_high = match end {
            AxisEnd::Low => self.low.is_high().map_err(|error| error.kind()),
            AxisEnd::High => self.high.is_high().map_err(|error| error.kind()),
        };
        is_high.map(PinState::from)
    }
}

/// A pin with a constant level, in place of a missing switch.
#[derive(Clone, Copy, Debug)]
pub struct Fixed(pub PinState);

impl ErrorType for Fixed {
    type Error = Infallible;
}

impl InputPin for Fixed {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(self.0 == PinState::High)
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(self.0 == PinState::Low)
    }
}

/// Names an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisId {
    /// The axis to the right.
    X,
    /// The axis down.
    Y,
}

impl fmt::Display for AxisId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            AxisId::X => "x",
            AxisId::Y => "y",
        })
    }
}

/// An end of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisEnd {
    /// The left or the top.
    Low,
    /// The right or the bottom.
    High,
}

impl fmt::Display for AxisEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            AxisEnd::Low => "low",
            AxisEnd::High => "high",
        })
    }
}
