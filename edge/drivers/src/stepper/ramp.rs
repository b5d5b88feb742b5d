//! Acceleration and deceleration, step by step.

/// Nanoseconds in a second.
const SECOND: u64 = 1_000_000_000;

/// The intervals between steps, from rest to rest: constant acceleration, constant speed, deceleration.
///
/// Accelerated from rest, step `n` is due after `sqrt(2 n / acceleration)`. This time is an integer square
/// root in nanoseconds, computed afresh for each step, so errors do not add up: every interval is within
/// 1.1 ns of the exact one, and never shorter than at full speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ramp {
    /// The square of the time of the first step from rest, in square nanoseconds.
    first_squared: u64,
    /// The steps from rest to full speed.
    top: u32,
    /// The interval at full speed in nanoseconds.
    cruise: u32,
    /// The present speed, as the number of steps that reach it from rest.
    level: u32,
    /// The time from rest to that step, in nanoseconds.
    due: u32,
}

impl Ramp {
    /// The greatest speed in steps/s.
    const MAX_SPEED: u64 = 1_000_000;
    /// The longest time from rest to full speed in seconds. Its square in square nanoseconds fits 64 bits.
    const MAX_SECONDS: u64 = 4;

    /// A motion at rest, for a speed in steps/s and an acceleration in steps/s². Both are at least 1, and the
    /// speed is limited to a million steps/s and to the speed reached in 4 s.
    pub const fn new(speed: u32, acceleration: u32) -> Ramp {
        let acceleration = if acceleration == 0 { 1 } else { acceleration as u64 };
        let mut speed = if speed == 0 { 1 } else { speed as u64 };
        if speed > Ramp::MAX_SPEED {
            speed = Ramp::MAX_SPEED;
        }
        if speed > Ramp::MAX_SECONDS * acceleration {
            speed = Ramp::MAX_SECONDS * acceleration;
        }
        let top = speed * speed / (2 * acceleration);
        let top = if top == 0 { 1 } else { top as u32 };
        let mut ramp = Ramp { first_squared: 2 * SECOND * SECOND / acceleration, top, cruise: 0, level: 0, due: 0 };
        // The last step of the ramp may be a little slower than the requested speed.
        let (requested, reached) = (SECOND.div_ceil(speed), (ramp.time(top) as u64).div_ceil(2 * top as u64));
        ramp.cruise = if requested > reached { requested as u32 } else { reached as u32 };
        ramp
    }

    /// The time from rest to a step at constant acceleration, in nanoseconds.
    const fn time(&self, step: u32) -> u32 {
        // It fits 32 bits: a ramp takes at most 4 s, or is a single step of at most 1.5 s.
        (self.first_squared.saturating_mul(step as u64)).isqrt() as u32
    }

    /// The steps that it takes to come to rest.
    pub const fn steps_to_rest(&self) -> u32 {
        self.level
    }

    /// The interval to the next step in nanoseconds, with `remaining` steps until rest.
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
            // Keeps the speed, which is twice the mean speed of the ramp; or makes a single step from rest.
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

    /// Speeds in steps/s and accelerations in steps/s²: ordinary ones, and the extremes.
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
    fn intervals_are_within_1_1_ns_of_the_exact_ones() {
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
            let requested = f64::from(speed).min(1e6).min(4.0 * f64::from(acceleration));
            let reached = 1.0 / (cruise * NS);
            assert!(reached <= requested, "{reached} of {requested} steps/s");
            // At most the speed of one step of the ramp is missing, and rounding.
            let slack = f64::from(acceleration) / requested + requested * requested * 2.0 * NS;
            assert!(reached >= requested.min(f64::from(acceleration).sqrt()) - slack, "{reached} of {requested} steps/s");
        }
    }

    #[test]
    fn speed_and_acceleration_stay_within_their_limits() {
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
                    // Mean speeds hold in the middle of their intervals, which are rounded to nanoseconds.
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
    fn a_motion_cut_short_comes_to_rest() {
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
