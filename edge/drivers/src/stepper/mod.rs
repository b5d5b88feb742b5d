//! A stage of two axes with stepping motors.
//!
//! Motor drivers with step and direction inputs move the axes; limit switches at the ends stop them. Homing
//! finds the switches at the low ends, and the stage counts steps from there.
//!
//! ```
//! use embedded_hal::{delay::DelayNs, digital::{InputPin, OutputPin, PinState}};
//! use multiscopic_core::capture::{Position, Stage};
//! use multiscopic_drivers::stepper::{Axis, Fixed, Pins, Stepper, StepperError};
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
mod motion;

pub use axis::{Axis, AxisEnd, AxisError, AxisId, Drive, Fixed, Pins, StepperError};

use core::mem;
use embedded_hal::{delay::DelayNs, digital::PinState};
use multiscopic_core::capture::{Position, Stage};

use motion::{Homing, HomingAction, StraightLine};

/// The time that a call of [`has_arrived`](Stage::has_arrived) spends on a motion, or a step if that is
/// longer.
const SLICE_NS: u32 = 10_000_000;

const AXES: [AxisId; 2] = [AxisId::X, AxisId::Y];

/// A stage with stepping motors.
///
/// Each call of [`has_arrived`](Stage::has_arrived) makes the steps of about 10 ms. The motors stand still
/// between two calls, so make the next one at once: any time in between lengthens a step. This does not
/// matter at speeds from which the motors can stop at once.
///
/// [Home](Stepper::home) the stage before it moves, and again after every error but
/// [`Beyond`](StepperError::Beyond): a motor that was stopped at once, or was blocked, may have lost steps.
/// [`stop`](Stage::stop) decelerates, for at most 4 s, and keeps the position. [`position`](Stage::position)
/// counts steps and does not notice those that a motor lost; homing does, see [`drift`](Stepper::drift).
///
/// No call panics, and no arithmetic overflows.
#[derive(Debug)]
pub struct Stepper<X, Y, T> {
    axes: [Axis; 2],
    x: X,
    y: Y,
    delay: T,
    /// The time for which a step pin stays high, in nanoseconds.
    pulse_ns: u32,
    /// The position, the target, and the drift of the last homing, all in steps.
    at: [i32; 2],
    target: [i32; 2],
    drift: [i32; 2],
    is_homed: bool,
    activity: Activity,
}

/// The stage's current work.
#[derive(Clone, Copy, Debug)]
enum Activity {
    Still,
    Moving(StraightLine),
    Homing(Homing),
}

impl<X: Drive, Y: Drive, T: DelayNs> Stepper<X, Y, T> {
    /// A stage of two axes: x to the right, y down. The step pins stay high for `pulse_ns` nanoseconds; 2000
    /// is enough for most motor drivers.
    ///
    /// # Errors
    /// [`StepperError::Axis`].
    pub fn new(axes: [Axis; 2], x: X, y: Y, pulse_ns: u32, delay: T) -> Result<Self, StepperError> {
        for (axis, id) in axes.iter().zip(AXES) {
            axis.check().map_err(|error| StepperError::Axis { axis: id, error })?;
        }
        let (at, activity) = ([0; 2], Activity::Still);
        Ok(Stepper { axes, x, y, delay, pulse_ns, at, target: at, drift: at, is_homed: false, activity })
    }

    /// Starts to look for the switches at the low ends, first along x, then along y.
    ///
    /// Each axis moves towards its switch until it is pressed, then slowly back until it is released. Like
    /// any motion, this goes on in [`has_arrived`](Stage::has_arrived).
    ///
    /// # Errors
    /// Those of the pins.
    pub fn home(&mut self) -> Result<(), StepperError> {
        self.stop()?;
        let was_homed = mem::take(&mut self.is_homed);
        self.drift = [0; 2];
        self.start_homing(AxisId::X, was_homed)
    }

    /// The steps that each motor had lost when its axis was homed last. Zero after the first homing.
    pub fn drift(&self) -> [i32; 2] {
        self.drift
    }

    /// Gives back the pins and the delay.
    pub fn release(self) -> (X, Y, T) {
        (self.x, self.y, self.delay)
    }

    fn start_homing(&mut self, axis: AxisId, was_homed: bool) -> Result<(), StepperError> {
        self.set_direction(axis, -1)?;
        self.activity = Activity::Homing(Homing::approach(axis, &self.axes[axis as usize], was_homed));
        Ok(())
    }

    /// Makes the next step and returns its time in nanoseconds, or nothing if the stage stands still.
    fn advance(&mut self) -> Result<Option<u32>, StepperError> {
        match mem::replace(&mut self.activity, Activity::Still) {
            Activity::Still => Ok(None),
            Activity::Moving(mut line) => {
                let Some((ways, interval)) = line.next() else { return Ok(None) };
                self.step(ways, interval)?;
                self.activity = Activity::Moving(line);
                Ok(Some(interval))
            }
            Activity::Homing(homing) => self.advance_homing(homing).map(Some),
        }
    }

    fn advance_homing(&mut self, mut homing: Homing) -> Result<u32, StepperError> {
        let axis = homing.axis;
        let is_pressed = self.is_pressed(axis, AxisEnd::Low)?;
        let mut spent = 0;
        match homing.next(is_pressed)? {
            HomingAction::Step { way, interval } => {
                let mut ways = [0; 2];
                ways[axis as usize] = way;
                self.step(ways, interval)?;
                spent = interval;
            }
            HomingAction::Retreat => {
                self.set_direction(axis, 1)?;
                homing = homing.retreat(&self.axes[axis as usize]);
            }
            HomingAction::Found => return self.finish_homing(homing).map(|()| 0),
        }
        self.activity = Activity::Homing(homing);
        Ok(spent)
    }

    /// Sets the position of an axis whose switch was just released, and goes on with the next axis.
    fn finish_homing(&mut self, homing: Homing) -> Result<(), StepperError> {
        let axis = homing.axis as usize;
        let home = self.axes[axis].to_steps(self.axes[axis].home_um);
        if homing.was_homed {
            self.drift[axis] = self.at[axis].saturating_sub(home);
        }
        (self.at[axis], self.target[axis]) = (home, home);
        match homing.axis {
            AxisId::X => self.start_homing(AxisId::Y, homing.was_homed),
            AxisId::Y => {
                self.is_homed = true;
                Ok(())
            }
        }
    }

    /// Waits for `interval` nanoseconds, then makes a step along each axis whose direction is not 0.
    fn step(&mut self, ways: [i32; 2], interval: u32) -> Result<(), StepperError> {
        self.delay.delay_ns(interval.saturating_sub(self.pulse_ns));
        let moving = AXES.into_iter().zip(ways).filter(|&(_, way)| way != 0);
        for (axis, way) in moving.clone() {
            let end = if way < 0 { AxisEnd::Low } else { AxisEnd::High };
            if self.is_pressed(axis, end)? {
                return Err(StepperError::Limit { axis, end });
            }
        }
        for (axis, way) in moving.clone() {
            self.drive(axis).set_step(PinState::High).map_err(|kind| StepperError::Pin { axis, kind })?;
            self.at[axis as usize] = self.at[axis as usize].saturating_add(way);
        }
        self.delay.delay_ns(self.pulse_ns);
        for (axis, _) in moving {
            self.drive(axis).set_step(PinState::Low).map_err(|kind| StepperError::Pin { axis, kind })?;
        }
        Ok(())
    }

    fn is_pressed(&mut self, axis: AxisId, end: AxisEnd) -> Result<bool, StepperError> {
        let level = self.drive(axis).switch(end).map_err(|kind| StepperError::Pin { axis, kind })?;
        Ok(level == self.axes[axis as usize].pressed)
    }

    fn set_direction(&mut self, axis: AxisId, way: i32) -> Result<(), StepperError> {
        let forward = self.axes[axis as usize].forward;
        let level = if way < 0 { !forward } else { forward };
        self.drive(axis).set_direction(level).map_err(|kind| StepperError::Pin { axis, kind })
    }

    fn drive(&mut self, axis: AxisId) -> &mut dyn Drive {
        match axis {
            AxisId::X => &mut self.x,
            AxisId::Y => &mut self.y,
        }
    }

    /// Stops after an error and forgets the position, which is not certain any more.
    fn checked<R>(&mut self, result: Result<R, StepperError>) -> Result<R, StepperError> {
        result.inspect_err(|_| {
            self.activity = Activity::Still;
            self.is_homed = false;
        })
    }

    /// Makes steps for at least `time_ns` nanoseconds, or until the stage stands still.
    fn advance_for(&mut self, time_ns: u64) -> Result<(), StepperError> {
        let mut spent = 0;
        while spent < time_ns {
            let advanced = self.advance();
            match self.checked(advanced)? {
                Some(interval) => spent += u64::from(interval),
                None => break,
            }
        }
        Ok(())
    }

    /// The step of a position, which must be in range.
    fn target_step(&self, axis: AxisId, um: i32) -> Result<i32, StepperError> {
        let limits = self.axes[axis as usize];
        let (min_um, max_um) = (limits.min_um, limits.max_um);
        match (min_um..=max_um).contains(&um) {
            true => Ok(limits.to_steps(um)),
            false => Err(StepperError::Beyond { axis, um, min_um, max_um }),
        }
    }
}

impl<X: Drive, Y: Drive, T: DelayNs> Stage for Stepper<X, Y, T> {
    type Error = StepperError;

    fn move_to(&mut self, position: Position) -> Result<(), StepperError> {
        let target = [self.target_step(AxisId::X, position.x_um)?, self.target_step(AxisId::Y, position.y_um)?];
        self.stop()?;
        if !self.is_homed {
            return Err(StepperError::NotHomed);
        }
        self.target = target;
        if let Some(line) = StraightLine::new(&self.axes, self.at, target) {
            for (axis, way) in AXES.into_iter().zip(line.ways).filter(|&(_, way)| way != 0) {
                let set = self.set_direction(axis, way);
                self.checked(set)?;
            }
            self.activity = Activity::Moving(line);
        }
        Ok(())
    }

    fn has_arrived(&mut self) -> Result<bool, StepperError> {
        self.advance_for(SLICE_NS.into())?;
        Ok(matches!(self.activity, Activity::Still) && self.is_homed && self.at == self.target)
    }

    fn position(&mut self) -> Result<Option<Position>, StepperError> {
        let [x_um, y_um] = [0, 1].map(|axis| self.axes[axis].to_um(self.at[axis]));
        Ok(self.is_homed.then_some(Position { x_um, y_um }))
    }

    fn stop(&mut self) -> Result<(), StepperError> {
        match &mut self.activity {
            Activity::Still => Ok(()),
            Activity::Moving(line) => {
                line.cut();
                self.advance_for(u64::MAX)
            }
            // Homing is slow enough to stop at once.
            Activity::Homing(_) => {
                self.activity = Activity::Still;
                Ok(())
            }
        }
    }
}
