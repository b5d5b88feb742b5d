//! A camera with a lens, and its mounting on its stage.

use std::path::Path;

use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::distortion::Lens;
use crate::{
    error::{Error, Result},
    files::{input, output},
    images::shrunk_point,
};

/// The camera that a calibration finds. Pixel `(u, v)` has its centre at whole coordinates, as in OpenCV, ROS and Kalibr.
///
/// ```
/// use multiscopic::{CameraModel, Lens};
/// let camera = CameraModel { size: None, focal_px: [800.0; 2], principal_point: [319.5, 239.5], lens: Lens::IDEAL };
/// assert_eq!(camera.pixel([0.1, 0.0]), Some([399.5, 239.5]));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraModel {
    /// Width and height of the images in pixels, if known. A calibration holds for images of this size only.
    pub size: Option<[usize; 2]>,
    /// The focal lengths `[fx, fy]` in pixels, above 0. They differ if pixels are not square.
    pub focal_px: [f64; 2],
    /// The pixel at which the optical axis meets the image, `[cx, cy]` in pixels.
    pub principal_point: [f64; 2],
    /// The distortion.
    pub lens: Lens,
}

impl CameraModel {
    /// The camera of images that are [shrunk](crate::Picture::shrunk) by a factor.
    pub fn shrunk(self, factor: u32) -> CameraModel {
        let size = self.size.map(|size| size.map(|side| (side / factor as usize).max(1)));
        let factor = f64::from(factor);
        let principal_point = shrunk_point(self.principal_point, factor);
        CameraModel { size, focal_px: self.focal_px.map(|focal_px| focal_px / factor), principal_point, lens: self.lens }
    }

    /// The pixel that sees the direction `(x, y, 1)`: x to the right, y down, z along the optical axis. It may lie outside
    /// the image. `None` beyond the range of the lens model.
    pub fn pixel(&self, direction: [f64; 2]) -> Option<[f64; 2]> {
        let [x, y] = self.lens.distort(direction)?;
        let ([fx, fy], [cx, cy]) = (self.focal_px, self.principal_point);
        Some([fx * x + cx, fy * y + cy])
    }

    /// The direction `(x, y, 1)` that a pixel sees. `None` if the lens model has none for it.
    pub fn direction(&self, [u, v]: [f64; 2]) -> Option<[f64; 2]> {
        let ([fx, fy], [cx, cy]) = (self.focal_px, self.principal_point);
        self.lens.undistort([(u - cx) / fx, (v - cy) / fy])
    }
}

/// The rotation of a camera against the axes of its stage, as `multiscopic calibrate mount` finds it.
///
/// ```toml
/// rotation_deg = [0.52, -1.01, 2.03]              # about the axes to the right, down and ahead
/// rotation_deviation_deg = [0.02, 0.02, 0.01]     # optional: standard deviations
/// focal_px = 957.2                                # optional: the focal length that was found or given, in pixels
/// ```
///
/// A camera with a positive third angle is turned clockwise about its optical axis, as seen from behind it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mount {
    /// The rotation from the stage's axes to the camera's: an axis, to the right, down and ahead, times an angle in degrees.
    pub rotation_deg: [f64; 3],
    /// Standard deviations of the angles, if they are known.
    pub rotation_deviation_deg: Option<[f64; 3]>,
    /// The focal length in pixels, if it is known.
    pub focal_px: Option<f64>,
}

impl Mount {
    /// A camera that is square to its stage.
    pub const SQUARE: Mount = Mount { rotation_deg: [0.0; 3], rotation_deviation_deg: None, focal_px: None };

    /// The name of its file in a captured folder.
    pub const FILE_NAME: &str = "mount.toml";

    /// The largest angle about an axis, in degrees.
    pub const MAX_ROTATION_DEG: f64 = 45.0;

    /// Reads a `mount.toml`.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if a key is missing or unknown or a value is out of range.
    pub fn read(path: &Path) -> Result<Mount> {
        let mount: Mount = input::read_toml(path, "a mount.toml")?;
        mount.check(path)?;
        Ok(mount)
    }

    /// Writes a `mount.toml`.
    ///
    /// # Errors
    /// [`Error::Format`] if a value is out of range, and [`Error::Write`]. Any previous version of the file is unchanged.
    pub fn save(&self, path: &Path) -> Result<()> {
        self.check(path)?;
        output::write_toml(path, self)
    }

    /// Splits the mount into a turn about the optical axis, in radians, which a stage takes out by moving along turned axes,
    /// and what remains after that.
    pub fn split_roll(&self) -> (f64, Mount) {
        let rotation = UnitQuaternion::from_rotation_matrix(&self.rotation());
        let roll = 2.0 * rotation.k.atan2(rotation.w);
        let rest = Rotation3::from_axis_angle(&Vector3::z_axis(), -roll) * self.rotation();
        (roll, Mount { rotation_deg: rest.scaled_axis().map(f64::to_degrees).into(), ..*self })
    }

    /// The principal point of the pictures, of a size in pixels, that a camera would take if it were square to its stage. They
    /// show in their middle what its own show there.
    pub fn principal_point(&self, camera: &CameraModel, size: [usize; 2]) -> [f64; 2] {
        if self.rotation_deg == [0.0; 3] {
            return camera.principal_point;
        }
        let (focal_px, [cx, cy]) = (camera.focal_px[0], camera.principal_point);
        let [u, v] = size.map(|side| (side as f64 - 1.0) / 2.0);
        let turned = self.rotation() * Vector3::new((u - cx) / focal_px, (v - cy) / focal_px, 1.0);
        [u - focal_px * turned.x / turned.z, v - focal_px * turned.y / turned.z]
    }

    /// From rays of the camera to the axes of the stage.
    pub(crate) fn rotation(&self) -> Rotation3<f64> {
        Rotation3::new(Vector3::from(self.rotation_deg).map(f64::to_radians))
    }

    fn check(&self, path: &Path) -> Result<()> {
        let expected = format!("-{0} to {0} degrees", Self::MAX_ROTATION_DEG);
        if let Some(angle) = self.rotation_deg.iter().find(|angle| angle.is_nan() || angle.abs() > Self::MAX_ROTATION_DEG) {
            return Err(Error::format(path, format!("rotation_deg = {angle}"), expected));
        }
        let deviations = self.rotation_deviation_deg.unwrap_or_default();
        if let Some(deviation) = deviations.iter().find(|deviation| !(0.0..f64::INFINITY).contains(*deviation)) {
            return Err(Error::format(path, format!("rotation_deviation_deg = {deviation}"), "0 or more"));
        }
        match self.focal_px.filter(|focal_px| !(*focal_px > 0.0 && focal_px.is_finite())) {
            Some(focal_px) => Err(Error::format(path, format!("focal_px = {focal_px}"), "a length above 0")),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::LensModel;

    #[test]
    fn pixels_see_directions() {
        let lens = Lens::new(LensModel::PlumbBob, &[-0.25, 0.08, 0.0012, -0.0007, -0.01]).unwrap();
        let camera = CameraModel { size: None, focal_px: [300.0, 303.0], principal_point: [161.5, 118.25], lens };
        assert_eq!(camera.pixel([0.0, 0.0]), Some([161.5, 118.25]));
        // cv2.projectPoints maps [0.3, -0.2] to [0.290288009, -0.193430006] without a camera matrix.
        let [u, v] = camera.pixel([0.3, -0.2]).unwrap();
        assert!((u - (161.5 + 300.0 * 0.290_288_009)).abs() < 1e-9 && (v - (118.25 - 303.0 * 0.193_430_006)).abs() < 1e-9);
        let [x, y] = camera.direction([u, v]).unwrap();
        assert!((x - 0.3).abs() < 1e-11 && (y + 0.2).abs() < 1e-11);
        assert_eq!(camera.direction([5000.0, 0.0]), None);
    }

    #[test]
    fn a_roll_is_taken_out_by_turned_moves() {
        let close = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        let (roll, rest) = Mount { rotation_deg: [0.0, 0.0, 3.0], ..Mount::SQUARE }.split_roll();
        assert!((roll.to_degrees() - 3.0).abs() < 1e-9 && close(rest.rotation_deg, [0.0; 3]), "{roll}, {rest:?}");
        let (roll, rest) = Mount { rotation_deg: [1.5, -2.0, 0.0], ..Mount::SQUARE }.split_roll();
        assert!(roll.abs() < 1e-9 && close(rest.rotation_deg, [1.5, -2.0, 0.0]), "{roll}, {rest:?}");
        // With all three: a move to the camera's right is in the image's row, apart from its perspective.
        let mount = Mount { rotation_deg: [2.0, 3.0, -4.0], ..Mount::SQUARE };
        let (roll, rest) = mount.split_roll();
        let moved = Vector3::new(roll.cos(), roll.sin(), 0.0);
        let [seen, expected] = [mount.rotation().inverse() * moved, rest.rotation().inverse() * Vector3::x()];
        assert!((seen - expected).norm() < 1e-12 && rest.rotation_deg[2].abs() < 1e-9, "{seen}, {expected}, {rest:?}");
    }

    #[test]
    fn files_are_checked() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("mount.toml");
        let source = include_str!("camera_model.rs");
        let (_, rest) = source.split_once("/// ```toml\n").unwrap();
        let (example, _) = rest.split_once("/// ```\n").unwrap();
        std::fs::write(&path, example.replace("/// ", "")).unwrap();
        let mount = Mount::read(&path).unwrap();
        assert_eq!((mount.rotation_deg, mount.focal_px), ([0.52, -1.01, 2.03], Some(957.2)));
        mount.save(&path).unwrap();
        assert_eq!(Mount::read(&path).unwrap(), mount);
        for (text, expected) in [
            ("rotation_deg = [1.0, 2.0, 46.0]", "mount.toml: found rotation_deg = 46, expected -45 to 45 degrees"),
            ("rotation_deg = [1.0, nan, 6.0]", "found rotation_deg = NaN"),
            ("rotation_deg = [1.0, 2.0, 3.0]\nfocal_px = 0", "found focal_px = 0, expected a length above 0"),
            ("rotation_deg = [1.0, 2.0, 3.0]\nrotation_deviation_deg = [-1, 0, 0]", "found rotation_deviation_deg = -1"),
            ("roll = 2", "unknown field `roll`"),
        ] {
            std::fs::write(&path, text).unwrap();
            let message = Mount::read(&path).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
