//! The motions of the stage, step by step: straight lines, and the search for the switch at the low end of an axis.

use super::{axis::Axis, drive::AxisId, error::StepperError, ramp::Ramp};

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

#[cfg(test)]
mod tests {
    use super::*;
    use embedded_hal::digital::PinState;

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
}
