//! The motions of the stage, step by step: straight lines, the search for the switch at the low end of an axis, and the ramps of
//! their speeds.

use super::axis::{Axis, AxisId, StepperError};

/// A motion of both axes along a straight line, at rest at both ends.
///
/// Each step moves the axis with more steps. The other follows by Bresenham's algorithm, never more than half
/// a step off the line.
#[derive(Clone, Copy, Debug)]
pub(super) struct StraightLine {
    /// The directions of the axes: -1, 0 or 1.
    pub ways: [i32; 2],
    /// The steps of each axis.
    counts: [u32; 2],
    /// The steps of the longer axis, and how many of these remain.
    longest: u32,
    steps_left: u32,
    /// Bresenham's error of each axis, in units of `1 / longest` steps.
    excess: [u64; 2],
    ramp: Ramp,
}

impl StraightLine {
    /// The line between two positions in steps, or nothing if they are the same. It respects the limits of
    /// both axes.
    pub fn new(axes: &[Axis; 2], from: [i32; 2], to: [i32; 2]) -> Option<StraightLine> {
        let counts = [from[0].abs_diff(to[0]), from[1].abs_diff(to[1])];
        let ways = [(to[0] > from[0]) as i32 - (to[0] < from[0]) as i32, (to[1] > from[1]) as i32 - (to[1] < from[1]) as i32];
        let longest = counts[0].max(counts[1]);
        if longest == 0 {
            return None;
        }
        // The shorter axis moves at a fraction of the line's speed, so its limit allows a faster line.
        let limit = |of: fn(&Axis) -> u32| {
            let moving = axes.iter().zip(counts).filter(|&(_, count)| count > 0);
            let limits = moving.map(|(axis, count)| u64::from(axis.steps_of(of(axis))) * u64::from(longest) / u64::from(count));
            limits.fold(u64::from(u32::MAX), u64::min) as u32
        };
        let ramp = Ramp::new(limit(|axis| axis.speed_um_per_s), limit(|axis| axis.acceleration_um_per_s2));
        Some(StraightLine { ways, counts, longest, steps_left: longest, excess: [u64::from(longest / 2); 2], ramp })
    }

    /// The directions of the axes in the next step, and its interval in nanoseconds. Nothing at the end.
    pub fn next(&mut self) -> Option<([i32; 2], u32)> {
        let interval = (self.steps_left > 0).then(|| self.ramp.interval(self.steps_left))?;
        self.steps_left -= 1;
        let mut ways = [0; 2];
        for (axis, way) in ways.iter_mut().enumerate() {
            self.excess[axis] += u64::from(self.counts[axis]);
            if self.excess[axis] >= u64::from(self.longest) {
                self.excess[axis] -= u64::from(self.longest);
                *way = self.ways[axis];
            }
        }
        Some((ways, interval))
    }

    /// Shortens the line so that it ends as soon as it can come to rest.
    pub fn cut(&mut self) {
        self.steps_left = self.steps_left.min(self.ramp.steps_to_rest());
    }
}

/// The retreat is slower than the approach by this factor, because its speed limits the precision.
const RETREAT_SLOWDOWN: u32 = 8;

/// The homing of one axis: towards the switch until it is pressed, then slowly back until it is released.
#[derive(Clone, Copy, Debug)]
pub(super) struct Homing {
    pub axis: AxisId,
    /// True if the stage knew its position before.
    pub was_homed: bool,
    phase: HomingPhase,
    steps_left: u32,
    ramp: Ramp,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum HomingPhase {
    Approach,
    Retreat,
}

/// The next step.
pub(super) enum HomingAction {
    /// Make a step in the direction `way`, `interval` nanoseconds after the one before.
    Step { way: i32, interval: u32 },
    /// The switch is pressed: [retreat](Homing::retreat).
    Retreat,
    /// The switch is released: the axis is at its reference.
    Found,
}

impl Homing {
    /// Starts towards the switch.
    pub fn approach(axis: AxisId, limits: &Axis, was_homed: bool) -> Homing {
        let ramp = Ramp::new(limits.steps_of(limits.homing_um_per_s), limits.steps_of(limits.acceleration_um_per_s2));
        Homing { axis, was_homed, phase: HomingPhase::Approach, steps_left: limits.homing_steps(), ramp }
    }

    /// Turns back from the switch.
    pub fn retreat(self, limits: &Axis) -> Homing {
        let speed = limits.steps_of(limits.homing_um_per_s / RETREAT_SLOWDOWN);
        let ramp = Ramp::new(speed, limits.steps_of(limits.acceleration_um_per_s2));
        Homing { phase: HomingPhase::Retreat, steps_left: limits.steps_of(limits.release_um), ramp, ..self }
    }

    /// The next step, given the switch.
    ///
    /// # Errors
    /// The switch was not pressed or released within its distance.
    pub fn next(&mut self, is_pressed: bool) -> Result<HomingAction, StepperError> {
        let axis = self.axis;
        match self.phase {
            HomingPhase::Approach if is_pressed => return Ok(HomingAction::Retreat),
            HomingPhase::Retreat if !is_pressed => return Ok(HomingAction::Found),
            HomingPhase::Approach if self.steps_left == 0 => return Err(StepperError::SwitchNotFound { axis }),
            HomingPhase::Retreat if self.steps_left == 0 => return Err(StepperError::SwitchStuck { axis }),
            HomingPhase::Approach | HomingPhase::Retreat => {}
        }
        let interval = self.ramp.interval(self.steps_left);
        self.steps_left -= 1;
        let way = if self.phase == HomingPhase::Approach { -1 } else { 1 };
        Ok(HomingAction::Step { way, interval })
    }
}

/// Nanoseconds in a second.
const SECOND: u64 = 1_000_000_000;

/// The intervals between steps, from rest to rest: constant acceleration, constant speed, deceleration.
///
/// Accelerated from rest, step `n` is due after `sqrt(2 n / acceleration)`. This time is an integer square
/// root in nanoseconds, computed afresh for each step, so errors do not add up: every interval is within
/// 1.1 ns of the exact one, and never shorter than at full speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Ramp {
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
    const fn new(speed: u32, acceleration: u32) -> Ramp {
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
    const fn steps_to_rest(&self) -> u32 {
        self.level
    }

    /// The interval to the next step in nanoseconds, with `remaining` steps until rest.
    fn interval(&mut self, remaining: u32) -> u32 {
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
    use embedded_hal::digital::PinState;
    use std::vec::Vec;

    const AXIS: Axis = Axis {
        steps: 16,
        um: 10,
        home_um: -31_000,
        min_um: -30_000,
        max_um: 30_000,
        release_um: 2000,
        speed_um_per_s: 20_000,
        acceleration_um_per_s2: 100_000,
        homing_um_per_s: 2000,
        forward: PinState::High,
        pressed: PinState::High,
    };

    #[test]
    fn lines_are_straight_and_end_where_they_should() {
        for to in [[7, 3], [-7, 3], [0, -5], [4, 0], [1000, 999], [-300, -1000], [1, 1], [i32::MAX, i32::MIN]] {
            let mut line = StraightLine::new(&[AXIS; 2], [0, 0], to).unwrap();
            let most = to[0].unsigned_abs().max(to[1].unsigned_abs());
            let mut at = [0_i64; 2];
            for step in 1..=most.min(5000) {
                let (ways, _) = line.next().unwrap();
                for axis in 0..2 {
                    at[axis] += i64::from(ways[axis]);
                    let exact = f64::from(to[axis]) * f64::from(step) / f64::from(most);
                    assert!((at[axis] as f64 - exact).abs() <= 0.5 + 1e-9, "step {step} to {to:?}: {at:?}");
                }
            }
            if most <= 5000 {
                assert_eq!((at, line.next()), (to.map(i64::from), None));
            }
        }
        assert!(StraightLine::new(&[AXIS; 2], [5, 5], [5, 5]).is_none());
    }

    #[test]
    fn the_slower_axis_sets_the_pace() {
        let slow = Axis { speed_um_per_s: 1000, acceleration_um_per_s2: 10_000, ..AXIS };
        for (to, fastest) in [([9000, 0], 31_250), ([0, 9000], 625_000), ([9000, 9000], 625_000), ([9000, 900], 62_500)] {
            let mut line = StraightLine::new(&[AXIS, slow], [0, 0], to).unwrap();
            let least = core::iter::from_fn(|| line.next()).map(|(_, interval)| interval).min().unwrap();
            assert!((fastest..fastest + fastest / 50).contains(&least), "{to:?}: {least} ns");
        }
    }

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
