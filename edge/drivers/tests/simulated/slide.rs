//! A simulated slide: two screws and their motors, as seen from the pins of a microcontroller.

use core::{cell::RefCell, convert::Infallible, ops::Range};
use embedded_hal::{
    delay::DelayNs,
    digital::{ErrorType, InputPin, OutputPin, PinState},
};
use multiscopic_drivers::stepper::Pins;

/// The shortest pulse that a motor driver notices, in nanoseconds.
const MIN_PULSE_NS: u64 = 1900;
/// The time for which the direction must be stable before a pulse, in nanoseconds.
const DIRECTION_SETUP_NS: u64 = 650;
/// The distance from a switch to the mechanical stop behind it, in steps.
const STOP_DISTANCE: i32 = 800;

/// A slide with a clock of its own, which advances when the program waits.
pub struct Slide {
    /// Nanoseconds since the start.
    pub now: u64,
    /// Every wait takes this many times as long as requested.
    pub slowdown: u64,
    /// The screws to the right and down.
    pub screws: [Screw; 2],
}

/// A screw, its motor and its switches.
#[derive(Clone)]
pub struct Screw {
    /// The position of the camera in steps from the centre.
    pub at: i32,
    /// The positions from which the low and the high switch are pressed.
    pub ends: [i32; 2],
    /// The shortest interval between steps that the motor follows, in nanoseconds.
    pub min_interval: u64,
    /// The number of pulses so far.
    pub pulses: u32,
    /// The time of the last pulse.
    pub pulsed: u64,
    /// The injected fault.
    pub fault: Option<ScrewFault>,
    is_forward: bool,
    /// The time when the direction was set.
    directed: u64,
    is_step_high: bool,
}

/// A fault of a screw.
#[derive(Clone)]
pub enum ScrewFault {
    /// The motor does not follow the pulses of these numbers.
    Jam(Range<u32>),
    /// The switch at an end (0 is low, 1 is high) is pressed from this pulse on.
    Pressed(usize, u32),
    /// The switch at the low end is never pressed.
    Released,
}

impl Slide {
    /// A slide whose camera is `at` steps from the centre along each axis.
    pub fn new(at: [i32; 2], ends: [i32; 2], min_interval: u64) -> Slide {
        let screw = |at| Screw {
            at,
            ends,
            min_interval,
            pulses: 0,
            pulsed: 0,
            fault: None,
            is_forward: false,
            directed: 0,
            is_step_high: false,
        };
        Slide { now: 0, slowdown: 1, screws: at.map(screw) }
    }
}

impl Screw {
    fn set_step(&mut self, now: u64, is_high: bool) {
        if !is_high && self.is_step_high && now - self.pulsed < MIN_PULSE_NS {
            // The pulse was too short: takes its step back.
            self.at -= self.way();
        }
        if is_high && !self.is_step_high {
            let is_jammed = matches!(&self.fault, Some(ScrewFault::Jam(pulses)) if pulses.contains(&self.pulses));
            let is_slow_enough = self.pulses == 0 || now - self.pulsed >= self.min_interval;
            if is_slow_enough && now - self.directed >= DIRECTION_SETUP_NS && !is_jammed {
                self.at = (self.at + self.way()).clamp(self.ends[0] - STOP_DISTANCE, self.ends[1] + STOP_DISTANCE);
            }
            self.pulses += 1;
            self.pulsed = now;
        }
        self.is_step_high = is_high;
    }

    fn way(&self) -> i32 {
        if self.is_forward { 1 } else { -1 }
    }

    fn is_pressed(&self, end: usize) -> bool {
        match self.fault {
            Some(ScrewFault::Pressed(stuck, from)) if stuck == end && self.pulses >= from => true,
            Some(ScrewFault::Released) if end == 0 => false,
            _ if end == 0 => self.at <= self.ends[0],
            _ => self.at >= self.ends[1],
        }
    }
}

/// The other end of a pin.
#[derive(Clone, Copy)]
pub enum Role {
    /// The step input of the motor driver.
    Step,
    /// The direction input of the motor driver: high is forward.
    Direction,
    /// The switch at an end (0 is low, 1 is high): high is pressed.
    Switch(usize),
}

/// A pin of the microcontroller.
#[derive(Clone, Copy)]
pub struct Pin<'s> {
    slide: &'s RefCell<Slide>,
    axis: usize,
    role: Role,
}

/// The pins of an axis.
pub fn pins(slide: &RefCell<Slide>, axis: usize) -> Pins<Pin<'_>, Pin<'_>, Pin<'_>, Pin<'_>> {
    let pin = |role| Pin { slide, axis, role };
    Pins { step: pin(Role::Step), dir: pin(Role::Direction), low: pin(Role::Switch(0)), high: pin(Role::Switch(1)) }
}

impl ErrorType for Pin<'_> {
    type Error = Infallible;
}

impl OutputPin for Pin<'_> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.set_state(PinState::Low)
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.set_state(PinState::High)
    }

    fn set_state(&mut self, state: PinState) -> Result<(), Infallible> {
        let mut slide = self.slide.borrow_mut();
        let (now, is_high) = (slide.now, state == PinState::High);
        let screw = &mut slide.screws[self.axis];
        match self.role {
            Role::Step => screw.set_step(now, is_high),
            Role::Direction => (screw.is_forward, screw.directed) = (is_high, now),
            Role::Switch(_) => {}
        }
        Ok(())
    }
}

impl InputPin for Pin<'_> {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        let slide = self.slide.borrow();
        Ok(matches!(self.role, Role::Switch(end) if slide.screws[self.axis].is_pressed(end)))
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        self.is_high().map(|is_high| !is_high)
    }
}

/// A delay that advances the slide's clock.
#[derive(Clone, Copy)]
pub struct Clock<'s>(pub &'s RefCell<Slide>);

impl DelayNs for Clock<'_> {
    fn delay_ns(&mut self, ns: u32) {
        let mut slide = self.0.borrow_mut();
        slide.now += slide.slowdown * u64::from(ns);
    }
}
