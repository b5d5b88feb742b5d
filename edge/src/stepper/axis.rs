//! How an axis is built, and what it may do.

use core::{error, fmt};
use embedded_hal::digital::PinState;

/// An axis of a slide: how its steps are micrometres, how far it goes and how fast.
///
/// Switches are at both ends; the one at the low end, which is to the left of the camera's view or above it, is where the axis finds its place.
///
/// ```
/// use embedded_hal::digital::PinState;
/// use multiscopic_edge::stepper::Axis;
///
/// /// A screw that moves 2 mm a turn, on a motor of 200 steps in 16 micro-steps.
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
    /// So many steps are [`um`](Axis::um) micrometres.
    pub steps: u32,
    /// So many micrometres are [`steps`](Axis::steps) steps.
    pub um: u32,
    /// Where the low end's switch is released, in micrometres from the centre.
    pub home_um: i32,
    /// The least position, in micrometres from the centre: not below the switch.
    pub min_um: i32,
    /// The greatest position, in micrometres from the centre.
    pub max_um: i32,
    /// How far from where it is pressed the low end's switch is released, at most, in micrometres.
    pub release_um: u32,
    /// The greatest speed, in micrometres/s.
    pub speed_um_per_s: u32,
    /// The acceleration to that speed and from it, in micrometres/s². What is not reached within 4 s is not used.
    pub acceleration_um_per_s2: u32,
    /// The speed towards the switch, in micrometres/s: one from which the motor stops at once. Away from it it is an eighth.
    pub homing_um_per_s: u32,
    /// The level of the direction pin for the way to the right or down.
    pub forward: PinState,
    /// The level of a switch that is pressed. High fits a switch that opens a connection to ground: a broken wire is then one that is
    /// pressed.
    pub pressed: PinState,
}

impl Axis {
    /// Whether such an axis can be moved.
    ///
    /// # Errors
    /// What is not possible.
    pub const fn check(&self) -> Result<(), AxisError> {
        if self.steps == 0 || self.um == 0 {
            return Err(AxisError::Ratio { steps: self.steps, um: self.um });
        }
        if self.home_um > self.min_um || self.min_um > self.max_um {
            return Err(AxisError::Range { home_um: self.home_um, min_um: self.min_um, max_um: self.max_um });
        }
        // Twice: homing goes further than the ends.
        let most = if self.home_um.unsigned_abs() > self.max_um.unsigned_abs() { self.home_um } else { self.max_um };
        if self.exact_steps(most).unsigned_abs() > i32::MAX as u64 / 4 {
            return Err(AxisError::TooManySteps { um: most });
        }
        Ok(())
    }

    /// The step nearest to a position. Positions are always converted as a whole, so that nothing adds up.
    pub(super) const fn to_steps(self, um: i32) -> i32 {
        clamped(self.exact_steps(um))
    }

    /// The micrometre nearest to a step.
    pub(super) const fn to_um(self, steps: i32) -> i32 {
        clamped(rounded(steps, self.um, self.steps))
    }

    /// How many steps a distance is, at least 1.
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

    /// How many steps it is from end to end, and a quarter more.
    pub(super) const fn whole_way(self) -> u32 {
        let way = self.steps_of(self.max_um.abs_diff(self.home_um));
        way.saturating_add(way / 4)
    }

    const fn exact_steps(&self, um: i32) -> i64 {
        rounded(um, self.steps, self.um)
    }
}

/// The integer nearest to `number * numerator / denominator`, halves away from zero. 64 bits are enough for any; the denominator is checked.
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

/// Why an axis cannot be moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum AxisError {
    /// A step is no distance, or a distance no steps.
    Ratio {
        /// So many steps
        steps: u32,
        /// are so many micrometres.
        um: u32,
    },
    /// The ends are not in their order.
    Range {
        /// Where the switch is released, in micrometres.
        home_um: i32,
        /// The least position, in micrometres.
        min_um: i32,
        /// The greatest position, in micrometres.
        max_um: i32,
    },
    /// A position is more than half a billion steps from the centre.
    TooManySteps {
        /// That position, in micrometres.
        um: i32,
    },
}

impl fmt::Display for AxisError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            AxisError::Ratio { steps, um } => write!(f, "{steps} steps for {um} um: both must be at least 1"),
            AxisError::Range { home_um, min_um, max_um } => {
                write!(f, "the switch at {home_um} um, the least position {min_um} um and the greatest {max_um} um must rise")
            }
            AxisError::TooManySteps { um } => write!(f, "{um} um are too many steps from the centre"),
        }
    }
}

impl error::Error for AxisError {}

#[cfg(test)]
mod tests {
    use super::*;

    /// A belt of 40 teeth of 2.032 mm a turn, in 3200 steps: no whole number of steps is a millimetre.
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
    fn positions_are_the_nearest_steps() {
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
    fn what_cannot_be_is_refused() {
        assert_eq!(BELT.check(), Ok(()));
        assert_eq!(Axis { um: 0, ..BELT }.check(), Err(AxisError::Ratio { steps: 3200, um: 0 }));
        let range = AxisError::Range { home_um: -60_000, min_um: -61_000, max_um: 59_000 };
        assert_eq!(Axis { min_um: -61_000, ..BELT }.check(), Err(range));
        let far = Axis { steps: u32::MAX, um: 1, ..BELT };
        assert_eq!(far.check(), Err(AxisError::TooManySteps { um: -60_000 }));
    }
}
