//! Straight lines of steps.

use super::{axis::Axis, ramp::Ramp};

/// A motion of both axes along a straight line, at rest at both ends.
///
/// The axis with more steps makes one each time; the other follows as Bresenham's lines do, never more than half a step off.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    /// The ways of the axes: -1, 0 or 1.
    pub ways: [i32; 2],
    counts: [u32; 2],
    /// The steps of the axis with more of them, and how many of these remain.
    most: u32,
    left: u32,
    /// How far the axes are ahead of their last step, in parts of `most`.
    ahead: [u64; 2],
    ramp: Ramp,
}

impl Line {
    /// The way from a step to another: none if there is nothing to go. Both axes keep to their own speeds and accelerations.
    pub fn new(axes: &[Axis; 2], from: [i32; 2], to: [i32; 2]) -> Option<Line> {
        let counts = [from[0].abs_diff(to[0]), from[1].abs_diff(to[1])];
        let ways = [(to[0] > from[0]) as i32 - (to[0] < from[0]) as i32, (to[1] > from[1]) as i32 - (to[1] < from[1]) as i32];
        let most = counts[0].max(counts[1]);
        if most == 0 {
            return None;
        }
        let least = |of: fn(&Axis) -> u32| {
            let limits = axes.iter().zip(counts).filter(|&(_, count)| count > 0);
            let limits = limits.map(|(axis, count)| u64::from(axis.steps_of(of(axis))) * u64::from(most) / u64::from(count));
            limits.fold(u64::from(u32::MAX), u64::min) as u32
        };
        let ramp = Ramp::new(least(|axis| axis.speed_um_per_s), least(|axis| axis.acceleration_um_per_s2));
        Some(Line { ways, counts, most, left: most, ahead: [u64::from(most / 2); 2], ramp })
    }

    /// The axes that step next, and when, in nanoseconds after the step before; none at the end.
    pub fn next(&mut self) -> Option<([i32; 2], u32)> {
        let interval = (self.left > 0).then(|| self.ramp.interval(self.left))?;
        self.left -= 1;
        let mut ways = [0; 2];
        for (axis, way) in ways.iter_mut().enumerate() {
            self.ahead[axis] += u64::from(self.counts[axis]);
            if self.ahead[axis] >= u64::from(self.most) {
                self.ahead[axis] -= u64::from(self.most);
                *way = self.ways[axis];
            }
        }
        Some((ways, interval))
    }

    /// Ends the line as soon as it can come to rest.
    pub fn cut(&mut self) {
        self.left = self.left.min(self.ramp.steps_to_rest());
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
            let mut line = Line::new(&[AXIS; 2], [0, 0], to).unwrap();
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
        assert!(Line::new(&[AXIS; 2], [5, 5], [5, 5]).is_none());
    }

    #[test]
    fn the_slower_axis_sets_the_pace() {
        let slow = Axis { speed_um_per_s: 1000, acceleration_um_per_s2: 10_000, ..AXIS };
        for (to, fastest) in [([9000, 0], 31_250), ([0, 9000], 625_000), ([9000, 9000], 625_000), ([9000, 900], 62_500)] {
            let mut line = Line::new(&[AXIS, slow], [0, 0], to).unwrap();
            let least = core::iter::from_fn(|| line.next()).map(|(_, interval)| interval).min().unwrap();
            assert!((fastest..fastest + fastest / 50).contains(&least), "{to:?}: {least} ns");
        }
    }
}
