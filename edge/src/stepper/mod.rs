//! A stage of two axes with stepping motors.
//!
//! Drivers that take step and direction signals move the axes; switches at their ends stop them. The stage finds its place with the switches
//! at the low ends, and counts steps from there.
//!
//! ```
//! use embedded_hal::{delay::DelayNs, digital::{InputPin, OutputPin, PinState}};
//! use multiscopic_core::capture::{Position, Stage};
//! use multiscopic_edge::stepper::{Axis, Fixed, Pins, Stepper, StepperError};
//!
//! const AXIS: Axis = Axis {
//!     steps: 3200, // for 2 mm of the screw
//!     um: 2000,
//!     home_um: -31_000,
//!     min_um: -30_000,
//!     max_um: 30_000,
//!     release_um: 2000,
//!     speed_um_per_s: 20_000,
//!     acceleration_um_per_s2: 100_000,
//!     homing_um_per_s: 2000,
//!     forward: PinState::High,
//!     pressed: PinState::High,
//! };
//!
//! /// The pins and the delay are those of any HAL.
//! fn run<O: OutputPin, I: InputPin>(out: [O; 4], switches: [I; 2], delay: impl DelayNs) -> Result<(), StepperError> {
//!     let ([x_step, x_dir, y_step, y_dir], [left, top]) = (out, switches);
//!     let x = Pins { step: x_step, dir: x_dir, low: left, high: Fixed(PinState::Low) };
//!     let y = Pins { step: y_step, dir: y_dir, low: top, high: Fixed(PinState::Low) };
//!     let mut stage = Stepper::new([AXIS, AXIS], x, y, 2000, delay)?;
//!     stage.home()?;
//!     while !stage.has_arrived()? {}
//!     stage.move_to(Position { x_um: 20_000, y_um: 0 })?;
//!     while !stage.has_arrived()? {}
//!     Ok(())
//! }
//! ```

mod axis;
mod drive;
mod line;
mod ramp;

pub use axis::{Axis, AxisError};
pub use drive::{Direction, Drive, End, Fixed, Pins};

use core::{error, fmt, mem};
use embedded_hal::{
    delay::DelayNs,
    digital::{ErrorKind, PinState},
};
use multiscopic_core::capture::{Position, Stage};

use line::Line;
use ramp::Ramp;

/// How much of a motion a call makes, in nanoseconds: 10 ms, or a single step.
const SLICE: u32 = 10_000_000;

/// The way back from a switch is that much slower than the way to it.
const BACK: u32 = 8;

const AXES: [Direction; 2] = [Direction::X, Direction::Y];

/// A stage whose steps are made by [`has_arrived`](Stage::has_arrived), some 10 ms of the motion each time.
///
/// Between two of these calls the motors stand still, so make the next one at once: what the caller does in between is added to the time of a
/// step. A speed that the motors can stop from at once does not mind.
///
/// It must be [homed](Stepper::home) before it moves, and again after every error but [`Beyond`](StepperError::Beyond): a motor that was
/// stopped at once, or that ran against something, may not be where its steps are. [`stop`](Stage::stop) slows down as it speeds up, for 4 s
/// at most, and so knows where it is. [`position`](Stage::position) is the count of steps: it does not notice steps that a motor lost. Homing
/// does: see [`drift`](Stepper::drift).
///
/// No call panics, and no number overflows.
#[derive(Debug)]
pub struct Stepper<X, Y, T> {
    axes: [Axis; 2],
    x: X,
    y: Y,
    delay: T,
    /// How long a step pin is high, in nanoseconds.
    pulse: u32,
    /// Where it is, where it was sent, and by how much it was off: in steps.
    at: [i32; 2],
    target: [i32; 2],
    drift: [i32; 2],
    is_homed: bool,
    motion: Motion,
}

#[derive(Clone, Copy, Debug)]
enum Motion {
    Still,
    Line(Line),
    Homing(Homing),
}

/// An axis looks for its switch.
#[derive(Clone, Copy, Debug)]
struct Homing {
    axis: Direction,
    phase: Phase,
    /// How many steps may be made.
    left: u32,
    ramp: Ramp,
    /// Whether it knew where it was.
    was_homed: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// Towards the switch until it is pressed.
    Towards,
    /// Away from it until it is not.
    Away,
}

impl<X: Drive, Y: Drive, T: DelayNs> Stepper<X, Y, T> {
    /// A stage of two axes, to the right and down, whose drivers want pulses of so many nanoseconds: 2000 is long enough for most.
    ///
    /// # Errors
    /// [`StepperError::Axis`].
    pub fn new(axes: [Axis; 2], x: X, y: Y, pulse_ns: u32, delay: T) -> Result<Self, StepperError> {
        for (axis, direction) in axes.iter().zip(AXES) {
            axis.check().map_err(|error| StepperError::Axis { axis: direction, error })?;
        }
        let (at, motion) = ([0; 2], Motion::Still);
        Ok(Stepper { axes, x, y, delay, pulse: pulse_ns, at, target: at, drift: at, is_homed: false, motion })
    }

    /// Starts to find out where the stage is, with the switches at the low ends, the one of x first: towards it until it is pressed, then
    /// slowly back until it is released. The motion goes on as any other, in [`has_arrived`](Stage::has_arrived).
    ///
    /// # Errors
    /// The pins'.
    pub fn home(&mut self) -> Result<(), StepperError> {
        self.stop()?;
        let was_homed = mem::take(&mut self.is_homed);
        self.drift = [0; 2];
        self.seek(Direction::X, was_homed)
    }

    /// How many steps each axis was off as it was homed the last time: what its motor had lost since the time before. 0 after the first
    /// time.
    pub fn drift(&self) -> [i32; 2] {
        self.drift
    }

    /// Gives back the pins and the delay.
    pub fn release(self) -> (X, Y, T) {
        (self.x, self.y, self.delay)
    }

    fn seek(&mut self, axis: Direction, was_homed: bool) -> Result<(), StepperError> {
        let settings = self.axes[axis as usize];
        let ramp = Ramp::new(settings.steps_of(settings.homing_um_per_s), settings.steps_of(settings.acceleration_um_per_s2));
        self.set_direction(axis, -1)?;
        self.motion = Motion::Homing(Homing { axis, phase: Phase::Towards, left: settings.whole_way(), ramp, was_homed });
        Ok(())
    }

    /// Makes the next step of the motion, and says how long that took, in nanoseconds; none if there is nothing to do.
    fn advance(&mut self) -> Result<Option<u32>, StepperError> {
        match mem::replace(&mut self.motion, Motion::Still) {
            Motion::Still => Ok(None),
            Motion::Line(mut line) => {
                let Some((ways, interval)) = line.next() else { return Ok(None) };
                self.step(ways, interval)?;
                self.motion = Motion::Line(line);
                Ok(Some(interval))
            }
            Motion::Homing(homing) => self.advance_homing(homing),
        }
    }

    fn advance_homing(&mut self, mut homing: Homing) -> Result<Option<u32>, StepperError> {
        let axis = homing.axis;
        let is_pressed = self.is_pressed(axis, End::Low)?;
        let mut interval = 0;
        match homing.phase {
            Phase::Towards if is_pressed => {
                let settings = self.axes[axis as usize];
                let speed = settings.steps_of(settings.homing_um_per_s / BACK);
                let ramp = Ramp::new(speed, settings.steps_of(settings.acceleration_um_per_s2));
                self.set_direction(axis, 1)?;
                homing = Homing { phase: Phase::Away, left: settings.steps_of(settings.release_um), ramp, ..homing };
            }
            Phase::Away if !is_pressed => return self.found(homing).map(|()| Some(0)),
            Phase::Towards if homing.left == 0 => return Err(StepperError::SwitchNotFound { axis }),
            Phase::Away if homing.left == 0 => return Err(StepperError::SwitchStuck { axis }),
            phase => {
                interval = homing.ramp.interval(homing.left);
                homing.left -= 1;
                let mut ways = [0; 2];
                ways[axis as usize] = if phase == Phase::Towards { -1 } else { 1 };
                self.step(ways, interval)?;
            }
        }
        self.motion = Motion::Homing(homing);
        Ok(Some(interval))
    }

    /// An axis is where its switch is released.
    fn found(&mut self, homing: Homing) -> Result<(), StepperError> {
        let axis = homing.axis as usize;
        let home = self.axes[axis].to_steps(self.axes[axis].home_um);
        if homing.was_homed {
            self.drift[axis] = self.at[axis].saturating_sub(home);
        }
        (self.at[axis], self.target[axis]) = (home, home);
        match homing.axis {
            Direction::X => self.seek(Direction::Y, homing.was_homed),
            Direction::Y => {
                self.is_homed = true;
                Ok(())
            }
        }
    }

    /// Waits, and makes a step of the axes that have a way.
    fn step(&mut self, ways: [i32; 2], interval: u32) -> Result<(), StepperError> {
        self.delay.delay_ns(interval.saturating_sub(self.pulse));
        let moving = AXES.into_iter().zip(ways).filter(|&(_, way)| way != 0);
        for (axis, way) in moving.clone() {
            let end = if way < 0 { End::Low } else { End::High };
            if self.is_pressed(axis, end)? {
                return Err(StepperError::Limit { axis, end });
            }
        }
        for (axis, way) in moving.clone() {
            self.drive(axis).set_step(PinState::High).map_err(|kind| StepperError::Pin { axis, kind })?;
            self.at[axis as usize] = self.at[axis as usize].saturating_add(way);
        }
        self.delay.delay_ns(self.pulse);
        for (axis, _) in moving {
            self.drive(axis).set_step(PinState::Low).map_err(|kind| StepperError::Pin { axis, kind })?;
        }
        Ok(())
    }

    fn is_pressed(&mut self, axis: Direction, end: End) -> Result<bool, StepperError> {
        let level = self.drive(axis).switch(end).map_err(|kind| StepperError::Pin { axis, kind })?;
        Ok(level == self.axes[axis as usize].pressed)
    }

    fn set_direction(&mut self, axis: Direction, way: i32) -> Result<(), StepperError> {
        let forward = self.axes[axis as usize].forward;
        let level = if way < 0 { !forward } else { forward };
        self.drive(axis).set_direction(level).map_err(|kind| StepperError::Pin { axis, kind })
    }

    fn drive(&mut self, axis: Direction) -> &mut dyn Drive {
        match axis {
            Direction::X => &mut self.x,
            Direction::Y => &mut self.y,
        }
    }

    /// Forgets where the stage is if it is not certain any more.
    fn checked<R>(&mut self, result: Result<R, StepperError>) -> Result<R, StepperError> {
        result.inspect_err(|_| {
            self.motion = Motion::Still;
            self.is_homed = false;
        })
    }

    /// Makes steps for at least so many nanoseconds, unless the motion ends before.
    fn advance_for(&mut self, time: u64) -> Result<(), StepperError> {
        let mut spent = 0;
        while spent < time {
            let advanced = self.advance();
            match self.checked(advanced)? {
                Some(interval) => spent += u64::from(interval),
                None => break,
            }
        }
        Ok(())
    }

    /// The step of a position, which the stage may go to.
    fn steps_to(&self, axis: Direction, um: i32) -> Result<i32, StepperError> {
        let settings = self.axes[axis as usize];
        let (min_um, max_um) = (settings.min_um, settings.max_um);
        match (min_um..=max_um).contains(&um) {
            true => Ok(settings.to_steps(um)),
            false => Err(StepperError::Beyond { axis, um, min_um, max_um }),
        }
    }
}

impl<X: Drive, Y: Drive, T: DelayNs> Stage for Stepper<X, Y, T> {
    type Error = StepperError;

    fn move_to(&mut self, position: Position) -> Result<(), StepperError> {
        let target = [self.steps_to(Direction::X, position.x_um)?, self.steps_to(Direction::Y, position.y_um)?];
        self.stop()?;
        if !self.is_homed {
            return Err(StepperError::NotHomed);
        }
        self.target = target;
        if let Some(line) = Line::new(&self.axes, self.at, target) {
            for (axis, way) in AXES.into_iter().zip(line.ways).filter(|&(_, way)| way != 0) {
                let set = self.set_direction(axis, way);
                self.checked(set)?;
            }
            self.motion = Motion::Line(line);
        }
        Ok(())
    }

    fn has_arrived(&mut self) -> Result<bool, StepperError> {
        self.advance_for(SLICE.into())?;
        Ok(matches!(self.motion, Motion::Still) && self.is_homed && self.at == self.target)
    }

    fn position(&mut self) -> Result<Option<Position>, StepperError> {
        let [x_um, y_um] = [0, 1].map(|axis| self.axes[axis].to_um(self.at[axis]));
        Ok(self.is_homed.then_some(Position { x_um, y_um }))
    }

    fn stop(&mut self) -> Result<(), StepperError> {
        match &mut self.motion {
            Motion::Still => Ok(()),
            Motion::Line(line) => {
                line.cut();
                self.advance_for(u64::MAX)
            }
            // Slow enough to stop at once.
            Motion::Homing(_) => {
                self.motion = Motion::Still;
                Ok(())
            }
        }
    }
}

/// Why the stage cannot move, or does not any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StepperError {
    /// An axis is none.
    Axis {
        /// Which.
        axis: Direction,
        /// Why.
        error: AxisError,
    },
    /// A pin cannot be set or read.
    Pin {
        /// Of which axis.
        axis: Direction,
        /// What the HAL says.
        kind: ErrorKind,
    },
    /// A switch at an end stopped the motion at once.
    Limit {
        /// Of which axis.
        axis: Direction,
        /// At which end.
        end: End,
    },
    /// The position is not one that the stage may go to. It goes on with what it does.
    Beyond {
        /// Along which axis.
        axis: Direction,
        /// The position, in micrometres.
        um: i32,
        /// The least that there is.
        min_um: i32,
        /// The greatest that there is.
        max_um: i32,
    },
    /// The stage does not know where it is.
    NotHomed,
    /// The switch at the low end was not pressed all the way.
    SwitchNotFound {
        /// Of which axis.
        axis: Direction,
    },
    /// The switch at the low end was not released on the way back.
    SwitchStuck {
        /// Of which axis.
        axis: Direction,
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
            StepperError::NotHomed => f.write_str("the stage does not know where it is: home it first"),
            StepperError::SwitchNotFound { axis } => write!(f, "the switch at the low end of axis {axis} was not found"),
            StepperError::SwitchStuck { axis } => write!(f, "the switch at the low end of axis {axis} stays pressed"),
        }
    }
}

impl error::Error for StepperError {}
