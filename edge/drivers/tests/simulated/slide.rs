//! A slide with two screws and their motors, as the pins of a microcontroller see it.

use core::{cell::RefCell, convert::Infallible, ops::Range};
use embedded_hal::{
    delay::DelayNs,
    digital::{ErrorType, InputPin, OutputPin, PinState},
};
use multiscopic_drivers::stepper::Pins;

/// What the drivers of the motors need, in nanoseconds: the length of a pulse, and of a direction before it.
const PULSE: u64 = 1900;
const SETUP: u64 = 650;
/// How far behind its switch an end is, in steps: there the motor turns no more.
const STOP: i32 = 800;

/// A slide in a time of its own, which passes while it is waited for.
pub struct Slide {
    /// Nanoseconds since the start.
    pub now: u64,
    /// How many times as long as it should every wait takes.
    pub pace: u64,
    /// To the right and down.
    pub screws: [Screw; 2],
}

/// An axis.
#[derive(Clone)]
pub struct Screw {
    /// Where the camera is, in steps from the centre.
    pub at: i32,
    /// From where the switch at the low end is pressed, and that at the high end.
    pub ends: [i32; 2],
    /// The shortest time between steps that the motor follows, in nanoseconds.
    pub shortest: u64,
    /// How many pulses came.
    pub pulses: u32,
    /// When the last pulse came.
    pub pulsed: u64,
    /// What is wrong.
    pub fault: Option<Fault>,
    is_forward: bool,
    directed: u64,
    is_high: bool,
}

/// What is wrong with an axis.
#[derive(Clone)]
pub enum Fault {
    /// The motor does not follow the pulses of these numbers.
    Jam(Range<u32>),
    /// The switch at the low end or the high end is pressed, from the pulse of a number on.
    Pressed(usize, u32),
    /// The switch at the low end is never pressed.
    Released,
}

impl Slide {
    /// A slide whose camera is so many steps from the centre, along each axis.
    pub fn new(at: [i32; 2], ends: [i32; 2], shortest: u64) -> Slide {
        let screw =
            |at| Screw { at, ends, shortest, pulses: 0, pulsed: 0, fault: None, is_forward: false, directed: 0, is_high: false };
        Slide { now: 0, pace: 1, screws: at.map(screw) }
    }
}

impl Screw {
    fn set_step(&mut self, now: u64, high: bool) {
        if !high && self.is_high && now - self.pulsed < PULSE {
            self.at -= self.way(); // too short to be seen
        }
        if high && !self.is_high {
            let jammed = matches!(&self.fault, Some(Fault::Jam(pulses)) if pulses.contains(&self.pulses));
            let follows = self.pulses == 0 || now - self.pulsed >= self.shortest;
            if follows && now - self.directed >= SETUP && !jammed {
                self.at = (self.at + self.way()).clamp(self.ends[0] - STOP, self.ends[1] + STOP);
            }
            self.pulses += 1;
            self.pulsed = now;
        }
        self.is_high = high;
    }

    fn way(&self) -> i32 {
        if self.is_forward { 1 } else { -1 }
    }

    fn is_pressed(&self, end: usize) -> bool {
        match self.fault {
            Some(Fault::Pressed(stuck, from)) if stuck == end && self.pulses >= from => true,
            Some(Fault::Released) if end == 0 => false,
            _ if end == 0 => self.at <= self.ends[0],
            _ => self.at >= self.ends[1],
        }
    }
}

/// What a pin is connected to.
#[derive(Clone, Copy)]
pub enum Role {
    /// The step input of a motor's driver.
    Step,
    /// The direction input: high is forward.
    Dir,
    /// The switch at an end: high is pressed.
    Switch(usize),
}

/// A pin.
#[derive(Clone, Copy)]
pub struct Pin<'s> {
    slide: &'s RefCell<Slide>,
    axis: usize,
    role: Role,
}

/// The pins of an axis.
pub fn pins(slide: &RefCell<Slide>, axis: usize) -> Pins<Pin<'_>, Pin<'_>, Pin<'_>, Pin<'_>> {
    let pin = |role| Pin { slide, axis, role };
    Pins { step: pin(Role::Step), dir: pin(Role::Dir), low: pin(Role::Switch(0)), high: pin(Role::Switch(1)) }
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
        let (now, high) = (slide.now, state == PinState::High);
        let screw = &mut slide.screws[self.axis];
        match self.role {
            Role::Step => screw.set_step(now, high),
            Role::Dir => (screw.is_forward, screw.directed) = (high, now),
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
        self.is_high().map(|high| !high)
    }
}

/// The time of the slide passes.
#[derive(Clone, Copy)]
pub struct Clock<'s>(pub &'s RefCell<Slide>);

impl DelayNs for Clock<'_> {
    fn delay_ns(&mut self, ns: u32) {
        let mut slide = self.0.borrow_mut();
        slide.now += slide.pace * u64::from(ns);
    }
}
