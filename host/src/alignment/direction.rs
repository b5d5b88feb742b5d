//! The directions along and across a baseline.

use multiscopic_core::View;

/// Unit vectors along and across the baseline of a view, to the right and down. Opposite views share them: along points to
/// the right, or down for views in the centre's column, and across points down, or to the right for those.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    pub along: [f64; 2],
    pub across: [f64; 2],
    /// How far a match moves along the baseline with each pixel of disparity.
    pub step: f64,
}

impl Direction {
    pub fn of(view: View) -> Direction {
        let [x, y] = [view.right(), view.down()].map(f64::from);
        let length = x.hypot(y);
        let sign = if x < 0.0 || (x == 0.0 && y < 0.0) { -length } else { length };
        let along @ [x, y] = [x / sign, y / sign];
        let across = if x == 0.0 { [y, x] } else { [-y, x] };
        Direction { along, across, step: -sign }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_views_share_directions() {
        let direction = |i, j| Direction::of(View::new(i, j).unwrap());
        let (right, down) = ([1.0, 0.0], [0.0, 1.0]);
        assert_eq!(direction(1, 0), Direction { along: right, across: down, step: -1.0 });
        assert_eq!(direction(-4, 0), Direction { along: right, across: down, step: 4.0 });
        assert_eq!(direction(0, -1), Direction { along: down, across: right, step: 1.0 });
        assert_eq!(direction(0, 2), Direction { along: down, across: right, step: -2.0 });
        assert_eq!(direction(3, 4), Direction { along: [0.6, 0.8], across: [-0.8, 0.6], step: -5.0 });
        assert_eq!(direction(-3, -4), Direction { step: 5.0, ..direction(3, 4) });
        assert_eq!(direction(-3, 4), Direction { along: [0.6, -0.8], across: [0.8, 0.6], step: 5.0 });
    }
}
