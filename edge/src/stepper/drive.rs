//! The pins of an axis.

use core::{convert::Infallible, fmt};
use embedded_hal::digital::{Error, ErrorKind, ErrorType, InputPin, OutputPin, PinState};

/// The electronics of an axis: a driver of its motor, and two switches.
pub trait Drive {
    /// Sets the direction of the steps that follow.
    ///
    /// # Errors
    /// The pin's.
    fn set_direction(&mut self, level: PinState) -> Result<(), ErrorKind>;

    /// Sets the step pin. The motor makes a step when it goes high.
    ///
    /// # Errors
    /// The pin's.
    fn set_step(&mut self, level: PinState) -> Result<(), ErrorKind>;

    /// The level of the switch at an end.
    ///
    /// # Errors
    /// The pin's.
    fn switch(&mut self, end: End) -> Result<PinState, ErrorKind>;
}

/// The pins of an axis, each of any type that a HAL has.
#[derive(Clone, Copy, Debug)]
pub struct Pins<Step, Dir, Low, High> {
    /// Makes a step when it goes high.
    pub step: Step,
    /// The direction of steps.
    pub dir: Dir,
    /// The switch at the low end.
    pub low: Low,
    /// The switch at the high end; [`Fixed`] if there is none.
    pub high: High,
}

impl<Step: OutputPin, Dir: OutputPin, Low: InputPin, High: InputPin> Drive for Pins<Step, Dir, Low, High> {
    fn set_direction(&mut self, level: PinState) -> Result<(), ErrorKind> {
        self.dir.set_state(level).map_err(|error| error.kind())
    }

    fn set_step(&mut self, level: PinState) -> Result<(), ErrorKind> {
        self.step.set_state(level).map_err(|error| error.kind())
    }

    fn switch(&mut self, end: End) -> Result<PinState, ErrorKind> {
        let is_high = match end {
            End::Low => self.low.is_high().map_err(|error| error.kind()),
            End::High => self.high.is_high().map_err(|error| error.kind()),
        };
        is_high.map(PinState::from)
    }
}

/// A pin that always has the same level: a switch that is not there.
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

/// One of the two axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To the right.
    X,
    /// Down.
    Y,
}

impl fmt::Display for Direction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Direction::X => "x",
            Direction::Y => "y",
        })
    }
}

/// An end of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// To the left, or the top.
    Low,
    /// To the right, or the bottom.
    High,
}

impl fmt::Display for End {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            End::Low => "low",
            End::High => "high",
        })
    }
}
