//! The frames of a capture and their positions.

use core::ops::Range;

use crate::{Frame, Views};

const MAX_FRAMES: usize = 1 + Views::MAX;

/// The frames of a capture in the order in which they are taken, and their positions.
///
/// ```
/// use multiscopic_core::{Frame, View, Views, capture::{Plan, Position}};
/// let plan = Plan::new(Views::HORIZONTAL, 20_000);
/// assert_eq!(plan.frames()[1], Frame::View(View::LEFT));
/// assert_eq!(plan.positions()[1], Position { x_um: -20_000, y_um: 0 });
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    frames: [Frame; MAX_FRAMES],
    positions: [Position; MAX_FRAMES],
    len: usize,
}

impl Plan {
    /// The centre, and then its neighbours in the order of their set. The baseline is in micrometres.
    pub fn new(views: Views, baseline_um: u32) -> Plan {
        Plan::of([Frame::Center].into_iter().chain(views.iter().map(Frame::View)), baseline_um)
    }

    /// Neighbours only, in the order of their set: what a capture adds to an earlier one.
    pub fn of_views(views: Views, baseline_um: u32) -> Plan {
        Plan::of(views.iter().map(Frame::View), baseline_um)
    }

    fn of(from: impl Iterator<Item = Frame>, baseline_um: u32) -> Plan {
        let (mut frames, mut len) = ([Frame::Center; MAX_FRAMES], 0);
        for (frame, from) in frames.iter_mut().zip(from) {
            *frame = from;
            len += 1;
        }
        Plan { frames, positions: frames.map(|frame| Position::of(frame, baseline_um)), len }
    }

    /// The same frames in an order that makes the [way](Plan::travel_um) short, the centre still first. `backlash_um` is
    /// that of the [`Policy`](super::Policy).
    ///
    /// The nearest position comes next, and then parts of the path are reversed or moved while that shortens it (2-opt
    /// and or-opt: Croes 1958, Or 1976). Up to the 24 neighbours of an array of five by five, that takes milliseconds on a host
    /// and less than a second on a microcontroller.
    pub fn shortened(self, backlash_um: u32) -> Plan {
        let mut plan = self;
        let fixed = usize::from(self.frames().first() == Some(&Frame::Center));
        for start in fixed..plan.len {
            let from = start.checked_sub(1).and_then(|last| plan.positions.get(last).copied()).unwrap_or_default();
            let rest = plan.positions().get(start..).unwrap_or_default();
            let way = |to: &Position| approach(from, *to, backlash_um).map(|(from, to)| from.length_um(to)).iter().sum::<u64>();
            if let Some((nearest, _)) = rest.iter().enumerate().min_by_key(|(_, position)| way(position)) {
                plan.move_part(start..start + nearest + 1, nearest);
            }
        }
        let mut least = plan.travel_um(backlash_um);
        loop {
            let before = least;
            for start in fixed..plan.len {
                for end in start + 2..=plan.len {
                    for change in 0..6 {
                        let mut changed = plan;
                        match change {
                            0 => changed.reverse_part(start..end),
                            // A stretch of up to three positions moves to the other end of the part.
                            1..=3 => changed.move_part(start..end, change),
                            _ => changed.move_part(start..end, (end - start).saturating_sub(change - 3)),
                        }
                        let travel = changed.travel_um(backlash_um);
                        if travel < least {
                            (plan, least) = (changed, travel);
                        }
                    }
                }
            }
            if least == before {
                return plan;
            }
        }
    }

    fn reverse_part(&mut self, part: Range<usize>) {
        if let (Some(frames), Some(positions)) = (self.frames.get_mut(part.clone()), self.positions.get_mut(part)) {
            frames.reverse();
            positions.reverse();
        }
    }

    /// Moves the first `count` frames of a part to its end.
    fn move_part(&mut self, part: Range<usize>, count: usize) {
        if let (Some(frames), Some(positions)) = (self.frames.get_mut(part.clone()), self.positions.get_mut(part))
            && count <= frames.len()
        {
            frames.rotate_left(count);
            positions.rotate_left(count);
        }
    }

    /// The length of the way in micrometres: from the centre to each position, past the point from which it is approached,
    /// and back to the centre.
    pub fn travel_um(&self, backlash_um: u32) -> u64 {
        self.moves(backlash_um).map(|(from, to)| from.length_um(to)).sum()
    }

    /// The straight moves of that way: two for each position, to the point from which it is approached and on, and the one
    /// back.
    pub fn moves(&self, backlash_um: u32) -> impl Iterator<Item = (Position, Position)> {
        let positions = self.positions().iter().copied();
        let last = positions.clone().next_back().unwrap_or_default();
        let ways = [Position::CENTER].into_iter().chain(positions.clone()).zip(positions);
        ways.flat_map(move |(from, to)| approach(from, to, backlash_um)).chain([(last, Position::CENTER)])
    }

    /// The frames.
    pub fn frames(&self) -> &[Frame] {
        self.frames.get(..self.len).unwrap_or_default()
    }

    /// The position of each frame.
    pub fn positions(&self) -> &[Position] {
        self.positions.get(..self.len).unwrap_or_default()
    }
}

/// The moves from one position to the next.
fn approach(from: Position, to: Position, backlash_um: u32) -> [(Position, Position); 2] {
    let before = to.before(backlash_um);
    [(from, before), (before, to)]
}

/// A position of the camera in its image plane, relative to the centre, as seen from behind the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Position {
    /// To the right, in micrometres.
    pub x_um: i32,
    /// Down, in micrometres.
    pub y_um: i32,
}

impl Position {
    /// The position of the reference frame.
    pub const CENTER: Position = Position { x_um: 0, y_um: 0 };

    /// The position of a frame, with the baseline in micrometres.
    pub const fn of(frame: Frame, baseline_um: u32) -> Position {
        let baseline_um = if baseline_um > i32::MAX as u32 { i32::MAX } else { baseline_um as i32 };
        match frame {
            Frame::Center => Position::CENTER,
            Frame::View(view) => {
                // A match moves against the camera.
                let (du, dv) = view.shift(1);
                Position { x_um: baseline_um.saturating_mul(-du), y_um: baseline_um.saturating_mul(-dv) }
            }
        }
    }

    /// The greater of the distances along both axes, in micrometres.
    pub const fn distance_um(self, other: Position) -> u32 {
        let (x, y) = (self.x_um.abs_diff(other.x_um), self.y_um.abs_diff(other.y_um));
        if x > y { x } else { y }
    }

    /// The distance in a straight line, in micrometres, rounded down.
    pub const fn length_um(self, other: Position) -> u64 {
        let (x, y) = (self.x_um.abs_diff(other.x_um) as u64, self.y_um.abs_diff(other.y_um) as u64);
        // The square of a distance in 32 bits fits 64. The sum saturates beyond 4 km.
        x.pow(2).saturating_add(y.pow(2)).isqrt()
    }

    /// The position `distance_um` micrometres to the left and `distance_um` up.
    pub const fn before(self, distance_um: u32) -> Position {
        Position { x_um: self.x_um.saturating_sub_unsigned(distance_um), y_um: self.y_um.saturating_sub_unsigned(distance_um) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::View;

    #[test]
    fn positions_of_absurd_baselines_saturate() {
        let right = |baseline_um| Position::of(Frame::View(View::RIGHT), baseline_um);
        assert_eq!([20_000, i32::MAX as u32, u32::MAX].map(|baseline_um| right(baseline_um).x_um), [20_000, i32::MAX, i32::MAX]);
    }

    #[test]
    fn the_greater_distance_counts() {
        let at = |x_um, y_um| Position { x_um, y_um };
        assert_eq!([at(3, -7), at(-7, 3), at(5, 5)].map(|to| at(1, 1).distance_um(to)), [8, 8, 4]);
        assert_eq!(at(i32::MIN, 0).distance_um(at(i32::MAX, 0)), u32::MAX);
    }
}
