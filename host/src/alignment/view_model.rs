//! The place and the rotation of a view, the directions of its baseline, and the epipolar errors of its matches.

use multiscopic_core::View;
use nalgebra::{Matrix3, Rotation3, Vector3};

/// The differences of a view from the centre. At the nominal values, the baseline is the only one.
///
/// Rays are `[x, y, 1]` in the centre's camera: to the right, down and ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewModel {
    /// The rotation from rays of the centre to those of the view, as an axis times an angle in radians.
    pub rotation: Vector3<f64>,
    /// The natural logarithm of its scale, relative to the centre.
    pub log_scale: f64,
    /// The place where it was taken, in baselines.
    pub position: Vector3<f64>,
}

impl ViewModel {
    /// The centre itself.
    pub const NEUTRAL: ViewModel =
        ViewModel { rotation: Vector3::new(0.0, 0.0, 0.0), log_scale: 0.0, position: Vector3::new(0.0, 0.0, 0.0) };

    /// The number of parameters.
    pub const LEN: usize = 7;

    /// The parameters in a row: rotation, scale and position.
    pub fn to_array(self) -> [f64; ViewModel::LEN] {
        let ViewModel { rotation: r, log_scale, position: p } = self;
        [r.x, r.y, r.z, log_scale, p.x, p.y, p.z]
    }

    /// From parameters in a row.
    pub fn from_array([rx, ry, rz, log_scale, px, py, pz]: [f64; ViewModel::LEN]) -> ViewModel {
        ViewModel { rotation: Vector3::new(rx, ry, rz), log_scale, position: Vector3::new(px, py, pz) }
    }

    /// Returns the projection of rays into the view.
    pub fn projection(&self) -> Projection {
        let scale = self.log_scale.exp();
        let rotation = Rotation3::new(self.rotation);
        Projection { matrix: Matrix3::from_diagonal(&Vector3::new(scale, scale, 1.0)) * rotation, position: self.position }
    }
}

/// The projection of the centre's rays into a view.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    matrix: Matrix3<f64>,
    position: Vector3<f64>,
}

impl Projection {
    /// From rays of the centre to those of the view, scaled, for points at infinity.
    pub fn matrix(&self) -> Matrix3<f64> {
        self.matrix
    }

    /// Returns the place at which the view shows a ray of the centre, in focal lengths from the optical axis, if the point is
    /// so far away that a camera one baseline to the right shows it `disparity` focal lengths to the left.
    pub fn project(&self, ray: Vector3<f64>, disparity: f64) -> [f64; 2] {
        let seen = self.matrix * (ray - disparity * self.position);
        [seen.x / seen.z, seen.y / seen.z]
    }
}

/// Unit vectors along and across the baseline of a view, to the right and down. Opposite views share them: along points to
/// the right, or down for views in the centre's column, and across points down, or to the right for those.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    pub along: [f64; 2],
    pub across: [f64; 2],
    /// The motion of a match along the baseline with each pixel of disparity.
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

/// Returns the direction across the baseline of a view, in which a match is off its epipolar line: a unit vector to the right
/// and down.
pub fn across(view: View) -> [f64; 2] {
    Direction::of(view).across
}

/// A corner of the centre, and the epipolar error of its match in a view, as Sampson (1982) measures it: see
/// [`Residual::sampson_px`](crate::files::Residual::sampson_px).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EpipolarError {
    /// The corner in the centre image, in pixels.
    pub pixel: [f64; 2],
    /// The error in the images, in pixels: above 0 if the match is too far to the right, for views in the centre's column, or
    /// too far down, for others.
    pub before_px: f64,
    /// The same after rectification.
    pub after_px: f64,
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
