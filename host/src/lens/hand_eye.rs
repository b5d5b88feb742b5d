//! The place of a camera on the tool of an arm.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::Mount;
use crate::{
    error::{Error, Result},
    files::{Rig, input, output},
    images::Transform,
};

/// The pose of the camera in the frame of the tool that carries it, as `multiscopic calibrate hand-eye` finds it: from the
/// camera's axes, to the right, down and ahead, to those of the tool.
///
/// ```toml
/// translation_mm = [35.2, -60.4, 81.7]            # the camera's centre of projection in the frame of the tool
/// rotation_deg = [1.52, -0.43, 90.8]              # from the camera's axes to the tool's: an axis times an angle
/// translation_deviation_mm = [0.1, 0.1, 0.2]      # optional: standard deviations
/// rotation_deviation_deg = [0.01, 0.01, 0.02]     # optional: of small turns about the axes of the tool
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandEye {
    /// The camera's centre of projection in the frame of the tool, in millimetres.
    pub translation_mm: [f64; 3],
    /// The rotation from the camera's axes to the tool's: an axis times an angle in degrees.
    pub rotation_deg: [f64; 3],
    /// Standard deviations of the translation, if they are known.
    pub translation_deviation_mm: Option<[f64; 3]>,
    /// Standard deviations of small turns about the axes of the tool, if they are known.
    pub rotation_deviation_deg: Option<[f64; 3]>,
    /// The covariance of the translation, in millimetres, and of the turns, in degrees, in rows of these six. `None` if it is
    /// not known.
    pub covariance: Option<[[f64; 6]; 6]>,
}

impl HandEye {
    /// The name of its file in a captured folder.
    pub const FILE_NAME: &str = "hand_eye.toml";

    /// Reads a `hand_eye.toml`.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if a key is missing or unknown or a value is out of range.
    pub fn read(path: &Path) -> Result<HandEye> {
        let hand_eye: HandEye = input::read_toml(path, "a hand_eye.toml")?;
        hand_eye.check(path)?;
        Ok(hand_eye)
    }

    /// Reads the `hand_eye.toml` of a captured folder, if its rig names one.
    ///
    /// # Errors
    /// Those of [`read`](HandEye::read).
    pub fn of_rig(rig: &Rig, folder: &Path) -> Result<Option<HandEye>> {
        rig.hand_eye.as_ref().map(|path| HandEye::read(&folder.join(path))).transpose()
    }

    /// Writes a `hand_eye.toml`.
    ///
    /// # Errors
    /// [`Error::Format`] if a value is out of range, and [`Error::Write`]. Any previous version of the file is unchanged.
    pub fn save(&self, path: &Path) -> Result<()> {
        self.check(path)?;
        output::write_toml(path, self)
    }

    /// From the camera to the tool.
    pub fn camera_in_tool(&self) -> Transform {
        Transform { translation_mm: self.translation_mm, rotation_deg: self.rotation_deg }
    }

    /// The rotation of the camera against the axes along which an arm moves it, which are those of its tool.
    pub fn mount(&self) -> Mount {
        Mount { rotation_deg: self.rotation_deg, rotation_deviation_deg: self.rotation_deviation_deg, focal_px: None }
    }

    fn check(&self, path: &Path) -> Result<()> {
        if !self.camera_in_tool().is_plausible() {
            let expected = "millimetres up to 100 m, and an axis times an angle of at most 720 degrees";
            return Err(Error::format(path, "another translation_mm or rotation_deg", expected));
        }
        let deviations = [self.translation_deviation_mm, self.rotation_deviation_deg].into_iter().flatten().flatten();
        match deviations.into_iter().find(|deviation| !(0.0..f64::INFINITY).contains(deviation)) {
            Some(deviation) => Err(Error::format(path, format!("a standard deviation of {deviation}"), "0 or more")),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_checked() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("hand_eye.toml");
        let source = include_str!("hand_eye.rs");
        let (_, rest) = source.split_once("/// ```toml\n").unwrap();
        let (example, _) = rest.split_once("/// ```\n").unwrap();
        std::fs::write(&path, example.replace("/// ", "")).unwrap();
        let hand_eye = HandEye::read(&path).unwrap();
        assert_eq!((hand_eye.translation_mm, hand_eye.rotation_deg[2]), ([35.2, -60.4, 81.7], 90.8));
        hand_eye.save(&path).unwrap();
        assert_eq!(HandEye::read(&path).unwrap(), hand_eye);
        for (text, expected) in [
            ("translation_mm = [1.0, 2.0, inf]\nrotation_deg = [0, 0, 0]", "another translation_mm"),
            ("translation_mm = [1, 2, 3]", "missing field `rotation_deg`"),
            ("translation_mm = [1, 2, 3]\nrotation_deg = [0, 0, 0]\nrotation_deviation_deg = [-1, 0, 0]", "deviation of -1"),
        ] {
            std::fs::write(&path, text).unwrap();
            let message = HandEye::read(&path).unwrap_err().to_string();
            assert!(message.contains("hand_eye.toml: found ") && message.contains(expected), "{message}");
        }
    }
}
