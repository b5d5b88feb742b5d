//! The position of the camera.

use crate::Frame;

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
