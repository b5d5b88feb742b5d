//! The axes of the stage: their mechanics and limits, their electronics, and the errors of a stage.

use core::{convert::Infallible, error, fmt};
use embedded_hal::digital::{Error, ErrorKind, ErrorType, InputPin, OutputPin, PinState};

/// The mechanics and the limits of an axis. Positions are in micrometres from the centre of the plan.
///
/// The switch at the low end, to the left or at the top, is the reference for homing.
///
/// ```
/// use embedded_hal::digital::PinState;
/// use multiscopic_drivers::stepper::Axis;
///
/// /// A screw with a lead of 2 mm, on a motor with 200 steps a turn and 16 micro-steps a step.
/// const SCREW: Axis = Axis {
///     steps: 200 * 16,
///     um: 2000,
///     home_um: -31_000,
///     min_um: -30_000,
///     max_um: 30_000,
///     release_um: 2000,
///     speed_um_per_s: 20_000,
///     acceleration_um_per_s2: 100_000,
///     homing_um_per_s: 2000,
///     forward: PinState::High,
///     pressed: PinState::High,
/// };
/// assert!(SCREW.check().is_ok());
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axis {
    /// The steps that move the axis by [`um`](Axis::um) micrometres.
    pub steps: u32,
    /// The micrometres that [`steps`](Axis::steps) steps move the axis by.
    pub um: u32,
    /// The position where the low switch is released, in micrometres.
    pub home_um: i32,
    /// The least position in micrometres, not below [`home_um`](Axis::home_um).
    pub min_um: i32,
    /// The greatest position in micrometres.
    pub max_um: i32,
    /// The most micrometres between where the low switch is pressed and where it is released.
    pub release_um: u32,
    /// The greatest speed in micrometres/s.
    pub speed_um_per_s: u32,
    /// The acceleration and deceleration in micrometres/s². The speed is also limited to what it reaches
    /// within 4 s.
    pub acceleration_um_per_s2: u32,
    /// The speed of homing towards the switch in micrometres/s, from which the motor must be able to stop at
    /// once. The way back takes an eighth of it.
    pub homing_um_per_s: u32,
    /// The level of the direction pin for motion to the right or down.
    pub forward: PinState,
    /// The level of a pressed switch. Prefer `High`, with a pull-up and a switch that opens a connection to
    /// ground: a broken wire then counts as pressed.
    pub pressed: PinState,
}

impl Axis {
    /// Checks the numbers.
    ///
    /// # Errors
    /// The first contradiction.
    pub const fn check(&self) -> Result<(), AxisError> {
        if self.steps == 0 || self.um == 0 {
            return Err(AxisError::Ratio { steps: self.steps, um: self.um });
        }
        if self.home_um > self.min_um || self.min_um > self.max_um {
            return Err(AxisError::Range { home_um: self.home_um, min_um: self.min_um, max_um: self.max_um });
        }
        // A quarter of the range of `i32`, because homing may pass the ends.
        let farthest = if self.home_um.unsigned_abs() > self.max_um.unsigned_abs() { self.home_um } else { self.max_um };
        if self.exact_steps(farthest).unsigned_abs() > i32::MAX as u64 / 4 {
            return Err(AxisError::TooManySteps { um: farthest });
        }
        Ok(())
    }

    /// The step nearest to a position. Positions are converted, never distances, so errors do not add up.
    pub(super) const fn to_steps(self, um: i32) -> i32 {
        clamped(self.exact_steps(um))
    }

    /// The position nearest to a step, in micrometres.
    pub(super) const fn to_um(self, steps: i32) -> i32 {
        clamped(rounded(steps, self.um, self.steps))
    }

    /// The steps of a distance, at least 1.
    pub(super) const fn steps_of(self, um: u32) -> u32 {
        let steps = (um as u64 * self.steps as u64 + self.um as u64 / 2) / self.um as u64;
        if steps < 1 {
            1
        } else if steps > u32::MAX as u64 {
            u32::MAX
        } else {
            steps as u32
        }
    }

    /// The most steps that homing makes towards the switch: the whole axis, and a quarter more.
    pub(super) const fn homing_steps(self) -> u32 {
        let travel = self.steps_of(self.max_um.abs_diff(self.home_um));
        travel.saturating_add(travel / 4)
    }

    const fn exact_steps(&self, um: i32) -> i64 {
        rounded(um, self.steps, self.um)
    }
}

/// `number * numerator / denominator`, rounded to nearest, halves away from zero. The product fits 64 bits,
/// and [`Axis::check`] refuses a denominator of 0.
const fn rounded(number: i32, numerator: u32, denominator: u32) -> i64 {
    let (product, denominator) = (number as i64 * numerator as i64, denominator as i64);
    let half = if product < 0 { -(denominator / 2) } else { denominator / 2 };
    (product + half) / denominator
}

const fn clamped(number: i64) -> i32 {
    if number > i32::MAX as i64 {
        i32::MAX
    } else if number < i32::MIN as i64 {
        i32::MIN
    } else {
        number as i32
    }
}

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

/// An error of an axis whose numbers are invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum AxisError {
    /// The steps or the micrometres of the ratio are 0.
    Ratio {
        /// [`Axis::steps`].
        steps: u32,
        /// [`Axis::um`].
        um: u32,
    },
    /// The positions are not in ascending order.
    Range {
        /// [`Axis::home_um`].
        home_um: i32,
        /// [`Axis::min_um`].
        min_um: i32,
        /// [`Axis::max_um`].
        max_um: i32,
    },
    /// A position is more than half a billion steps from the centre.
    TooManySteps {
        /// That position in micrometres.
        um: i32,
    },
}

impl fmt::Display for AxisError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            AxisError::Ratio { steps, um } => write!(f, "{steps} steps for {um} um: both must be at least 1"),
            AxisError::Range { home_um, min_um, max_um } => {
                write!(f, "positions must ascend: switch at {home_um} um, least {min_um} um, greatest {max_um} um")
            }
            AxisError::TooManySteps { um } => write!(f, "{um} um is too many steps from the centre"),
        }
    }
}

impl error::Error for AxisError {}

#[cfg(test)]
mod tests {
    use super::*;

    /// A belt with 40 teeth of 2.032 mm a turn: no whole number of steps is a millimetre.
    const BELT: Axis = Axis {
        steps: 3200,
        um: 81_280,
        home_um: -60_000,
        min_um: -59_000,
        max_um: 59_000,
        release_um: 2000,
        speed_um_per_s: 100_000,
        acceleration_um_per_s2: 1_000_000,
        homing_um_per_s: 5000,
        forward: PinState::High,
        pressed: PinState::High,
    };

    #[test]
    fn positions_round_to_the_nearest_step() {
        for um in (-59_000..=59_000).step_by(7) {
            let steps = BELT.to_steps(um);
            let exact = f64::from(um) * 3200.0 / 81_280.0;
            assert!((f64::from(steps) - exact).abs() <= 0.5, "{um} um");
            assert_eq!(BELT.to_steps(BELT.to_um(steps)), steps);
            assert_eq!(BELT.to_steps(-um), -steps);
        }
        assert_eq!(Axis { um: 1, steps: u32::MAX, ..BELT }.to_steps(i32::MIN), i32::MIN);
    }

    #[test]
    fn invalid_axes_are_refused() {
        assert_eq!(BELT.check(), Ok(()));
        assert_eq!(Axis { um: 0, ..BELT }.check(), Err(AxisError::Ratio { steps: 3200, um: 0 }));
        let range = AxisError::Range { home_um: -60_000, min_um: -61_000, max_um: 59_000 };
        assert_eq!(Axis { min_um: -61_000, ..BELT }.check(), Err(range));
        let far = Axis { steps: u32::MAX, um: 1, ..BELT };
        assert_eq!(far.check(), Err(AxisError::TooManySteps { um: -60_000 }));
    }
}
