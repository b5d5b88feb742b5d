//! Rigid transforms between frames of coordinates.

use std::ops::Mul;

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// The pose of one frame of coordinates in another: it takes points of the first to the second. In files, a table of its two
/// fields.
///
/// ```
/// use multiscopic::images::Transform;
/// // A tool above a table, which looks down at a point 400 mm ahead of it.
/// let tool = Transform { translation_mm: [300.0, -200.0, 500.0], rotation_deg: [180.0, 0.0, 0.0] };
/// let [x, y, z] = tool.point([10.0, 20.0, 400.0]);
/// assert!((x - 310.0).abs() + (y + 220.0).abs() + (z - 100.0).abs() < 1e-9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Transform {
    /// The origin of the first frame in the second, in millimetres.
    pub translation_mm: [f64; 3],
    /// The rotation from the first frame to the second: an axis times an angle in degrees, as arms have it in radians.
    pub rotation_deg: [f64; 3],
}

impl Transform {
    /// The transform between frames that are the same.
    pub const IDENTITY: Transform = Transform { translation_mm: [0.0; 3], rotation_deg: [0.0; 3] };

    /// Returns a point of the first frame in the second, both in millimetres.
    pub fn point(&self, point_mm: [f64; 3]) -> [f64; 3] {
        (self.isometry() * Point3::from(point_mm)).into()
    }

    /// Returns the transform from the second frame to the first.
    #[must_use]
    pub fn inverse(&self) -> Transform {
        self.isometry().inverse().into()
    }

    /// Returns the rotation as a quaternion `[x, y, z, w]`, in the order of ROS.
    pub fn quaternion(&self) -> [f64; 4] {
        let rotation = self.isometry().rotation;
        [rotation.i, rotation.j, rotation.k, rotation.w]
    }

    /// Returns the rotation as the rows of a matrix.
    pub fn rotation_rows(&self) -> [[f64; 3]; 3] {
        let matrix = self.isometry().rotation.to_rotation_matrix();
        [0, 1, 2].map(|row| [0, 1, 2].map(|column| matrix[(row, column)]))
    }

    /// True if all numbers are finite and within what machines have: 100 m, and two turns.
    pub fn is_plausible(&self) -> bool {
        let within = |numbers: [f64; 3], most: f64| numbers.iter().all(|number| number.abs() <= most);
        within(self.translation_mm, 1e5) && within(self.rotation_deg, 720.0)
    }

    pub(crate) fn rotation(rotation: &Rotation3<f64>) -> Transform {
        Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_rotation_matrix(rotation)).into()
    }

    pub(crate) fn isometry(&self) -> Isometry3<f64> {
        let rotation = UnitQuaternion::new(Vector3::from(self.rotation_deg).map(f64::to_radians));
        Isometry3::from_parts(Translation3::from(self.translation_mm), rotation)
    }
}

impl From<Isometry3<f64>> for Transform {
    fn from(isometry: Isometry3<f64>) -> Transform {
        let rotation = isometry.rotation.scaled_axis().map(f64::to_degrees);
        Transform { translation_mm: isometry.translation.vector.into(), rotation_deg: rotation.into() }
    }
}

/// One transform after another: that on the right is the first.
impl Mul for Transform {
    type Output = Transform;

    fn mul(self, first: Transform) -> Transform {
        (self.isometry() * first.isometry()).into()
    }
}
