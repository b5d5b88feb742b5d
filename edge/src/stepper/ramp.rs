//! Speed, step by step.

/// Nanoseconds of a second.
const SECOND: u64 = 1_000_000_000;

/// The times between the steps of a motion that begins and ends at rest: constant acceleration, a speed, constant deceleration.
///
/// From rest, step `n` is due after `sqrt(2 n / acceleration)`. That time is computed anew for each step, as an integer square root in
/// nanoseconds, so errors do not add up: every interval is within 1.1 ns of the exact one, and never shorter than at full speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ramp {
    /// The square of the time of the first step from rest, in square nanoseconds.
    first: u64,
    /// How many steps from rest full speed is.
    top: u32,
    /// The time between steps at full speed, in nanoseconds.
    cruise: u32,
    /// How many steps from rest the speed is.
    level: u32,
    /// When the step of that level is due, from rest, in nanoseconds.
    due: u32,
}

impl Ramp {
    /// The greatest speed, in steps/s.
    const FASTEST: u64 = 1_000_000;
    /// The longest time from rest to full speed, in seconds; its square in nanoseconds fits 64 bits.
    const LONGEST: u64 = 4;

    /// A motion at rest, with a speed in steps/s and an acceleration in steps/s². Both are at least 1. The speed is at most a million
    /// steps/s, and what is reached in 4 s.
    pub const fn new(speed: u32, acceleration: u32) -> Ramp {
        let acceleration = if acceleration == 0 { 1 } else { acceleration as u64 };
        let mut speed = if speed == 0 { 1 } else { speed as u64 };
        if speed > Ramp::FASTEST {
            speed = Ramp::FASTEST;
        }
        if speed > Ramp::LONGEST * acceleration {
            speed = Ramp::LONGEST * acceleration;
        }
        let top = speed * speed / (2 * acceleration);
        let top = if top == 0 { 1 } else { top as u32 };
        let mut ramp = Ramp { first: 2 * SECOND * SECOND / acceleration, top, cruise: 0, level: 0, due: 0 };
        // The speed of the last step of the ramp may be a little less than the one asked for.
        let (asked, reached) = (SECOND.div_ceil(speed), (ramp.time(top) as u64).div_ceil(2 * top as u64));
        ramp.cruise = if asked > reached { asked as u32 } else { reached as u32 };
        ramp
    }

    /// When a step is due that is accelerated from rest, in nanoseconds.
    const fn time(&self, step: u32) -> u32 {
        // The ramp takes at most 4 s, or is a single step of at most 1.5 s.
        (self.first.saturating_mul(step as u64)).isqrt() as u32
    }

    /// How many steps it takes to come to rest.
    pub const fn steps_to_rest(&self) -> u32 {
        self.level
    }

    /// The time to the next step of so many that remain until rest, in nanoseconds.
    pub fn interval(&mut self, remaining: u32) -> u32 {
        let interval = if remaining <= self.level {
            let before = self.time(self.level.saturating_sub(1));
            self.level = self.level.saturating_sub(1);
            core::mem::replace(&mut self.due, before) - before
        } else if self.level < self.top && remaining - self.level >= 2 {
            self.level += 1;
            let due = self.time(self.level);
            due - core::mem::replace(&mut self.due, due)
        } else {
            // As fast as it is, or a single step from rest.
            self.due.checked_div(self.level).map_or(self.time(1), |twice| twice.div_ceil(2))
        };
        interval.max(self.cruise)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::vec::Vec;

    const NS: f64 = 1e-9;

    /// Speeds and accelerations of every kind: of slides, of the slowest, of the shortest ramps.
    const MOTORS: [(u32, u32); 10] = [
        (4000, 20_000),
        (800, 5000),
        (100_000, 1_000_000),
        (1_000_000, 250_000),
        (1, 1),
        (3, 100),
        (20, 5),
        (999_999, 4_000_000_000),
        (17, 144),
        (u32::MAX, u32::MAX),
    ];

    fn intervals(speed: u32, acceleration: u32, steps: u32) -> Vec<u32> {
        let mut ramp = Ramp::new(speed, acceleration);
        let intervals = (0..steps).map(|done| ramp.interval(steps - done)).collect();
        assert_eq!(ramp.steps_to_rest(), 0);
        intervals
    }

    #[test]
    fn intervals_are_the_exact_ones() {
        for (speed, acceleration) in MOTORS {
            let mut ramp = Ramp::new(speed, acceleration);
            let (top, cruise) = (ramp.top, f64::from(ramp.cruise));
            let time = |n: u32| (2.0 * f64::from(n) / f64::from(acceleration)).sqrt() / NS;
            let mut worst: f64 = 0.0;
            for n in 1..=top.min(200_000) {
                let exact = (time(n) - time(n - 1)).max(cruise);
                worst = worst.max((f64::from(ramp.interval(u32::MAX)) - exact).abs());
            }
            assert!(worst <= 1.1, "{speed} steps/s, {acceleration} steps/s²: {worst} ns off");
            let asked = f64::from(speed).min(1e6).min(4.0 * f64::from(acceleration));
            let reached = 1.0 / (cruise * NS);
            assert!(reached <= asked, "{reached} of {asked} steps/s");
            // What is missing is less than a step of the ramp makes, and rounding.
            let slack = f64::from(acceleration) / asked + asked * asked * 2.0 * NS;
            assert!(reached >= asked.min(f64::from(acceleration).sqrt()) - slack, "{reached} of {asked} steps/s");
        }
    }

    #[test]
    fn no_motion_is_too_fast_or_too_sudden() {
        for (speed, acceleration) in MOTORS {
            for steps in (1..40).chain([100, 999, 5000]) {
                let intervals = intervals(speed, acceleration, steps);
                let (limit, mut before) = (f64::from(acceleration), 0.0);
                // From rest to rest.
                let mut last: Option<f64> = None;
                for &ns in intervals.iter() {
                    let seconds = f64::from(ns) * NS;
                    let now = 1.0 / seconds;
                    assert!(now <= f64::from(speed), "{now} of {speed} steps/s");
                    // Speeds are those in the middles of the intervals, which are rounded.
                    let between = last.map_or(seconds / 2.0, |last: f64| (last + seconds) / 2.0);
                    let noise = 2.2 * NS * (now * now + before * before);
                    let change: f64 = now - before;
                    assert!(change.abs() <= limit * between * (1.0 + 1e-6) + noise, "{steps} steps of {speed} steps/s: {change}");
                    (before, last) = (now, Some(seconds));
                }
                assert!(before <= limit * last.unwrap() / 2.0 * (1.0 + 1e-6) + 2.2 * NS * before * before);
            }
        }
    }

    #[test]
    fn a_motion_that_is_cut_comes_to_rest() {
        let mut ramp = Ramp::new(4000, 20_000);
        for _ in 0..150 {
            ramp.interval(10_000);
        }
        assert_eq!(ramp.steps_to_rest(), 150);
        let slowing: Vec<u32> = (0..150).map(|done| ramp.interval(150 - done)).collect();
        assert!(slowing.is_sorted());
        assert_eq!((ramp.steps_to_rest(), slowing[149]), (0, 10_000_000));
    }
}
