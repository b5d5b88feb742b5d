//! Where a view stands and how it is turned.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// What distinguishes a view from the centre. At its nominal values only the baseline does.
///
/// Rays are `[x, y, 1]` in the centre's camera: to the right, down and ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewModel {
    /// The rotation from rays of the centre to those of the view, as an axis times an angle in radians.
    pub rotation: Vector3<f64>,
    /// The natural logarithm of its scale, relative to the centre.
    pub log_scale: f64,
    /// Where it was taken, in baselines.
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

    /// How the view shows rays.
    pub fn projection(&self) -> Projection {
        let scale = self.log_scale.exp();
        let rotation = Rotation3::new(self.rotation);
        Projection { matrix: Matrix3::from_diagonal(&Vector3::new(scale, scale, 1.0)) * rotation, position: self.position }
    }
}

/// How a view shows rays of the centre.
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

    /// Where the view shows a ray of the centre, in focal lengths from the optical axis, if the point is so far away that a
    /// camera one baseline to the right shows it `disparity` focal lengths to the left.
    pub fn project(&self, ray: Vector3<f64>, disparity: f64) -> [f64; 2] {
        let seen = self.matrix * (ray - disparity * self.position);
        [seen.x / seen.z, seen.y / seen.z]
    }
}
