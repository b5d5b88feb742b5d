//! The imperfections of a simulated rig.

use std::path::Path;

use serde::Deserialize;

use super::stage::StageImperfections;
use crate::{
    error::{Error, Result},
    files::input,
    lens::{CameraModel, CameraToml},
};

/// The differences of a simulated rig from a perfect one. By default there are none.
///
/// Its file has three tables, of which each may be missing:
///
/// ```toml
/// [lens]                          # the lens, as in a camera.toml
/// focal_px = [955.0, 955.0]
/// principal_point = [322.0, 236.5]
/// model = "plumb_bob"
/// coefficients = [-0.25, 0.08, 0.0, 0.0, 0.0]
///
/// [mount]
/// rotation_deg = [0.5, -1.0, 2.0] # how the camera is turned against the stage
///
/// [stage]
/// scale = [1.01, 1.0]             # how far it moves, as a multiple of how far it should; negative: the other way
/// skew_deg = 0.2                  # how much its downward axis leans to the left
/// backlash_mm = 0.05              # its play
/// repeatability_mm = 0.02         # the most by which a move misses its target
/// rotation_deg = 0.05             # the most by which a move turns the camera about each axis
/// stalls_at_move = 6              # the move on which it gets stuck; without, it never does
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Imperfections {
    /// The camera's lens. `None`: a pinhole.
    pub lens: Option<CameraModel>,
    /// The camera's turn against the stage: a rotation vector about the axes to the right, down and ahead, in degrees.
    pub mount_deg: [f64; 3],
    /// Those of the stage.
    pub stage: StageImperfections,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ImperfectionsToml {
    lens: Option<CameraToml>,
    #[serde(default)]
    mount: MountToml,
    #[serde(default)]
    stage: StageImperfections,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct MountToml {
    rotation_deg: [f64; 3],
}

impl Imperfections {
    /// The largest rotation about an axis, in degrees.
    const MAX_ROTATION_DEG: f64 = 45.0;

    /// Reads a file.
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Format`] if a key is unknown or a value is out of range. The message names the key.
    pub fn read(path: &Path) -> Result<Imperfections> {
        let ImperfectionsToml { lens, mount: MountToml { rotation_deg: mount_deg }, stage } =
            input::read_toml(path, "the tables lens, mount and stage of a simulated rig")?;
        let angle = |degrees: &f64| degrees.abs() <= Self::MAX_ROTATION_DEG;
        let length = |mm: &f64| (0.0..=10.0).contains(mm);
        let angles = format!("-{0} to {0} degrees", Self::MAX_ROTATION_DEG);
        let lengths = "0 to 10 mm".to_owned();
        let [pitch, yaw, roll] = mount_deg;
        let [right, down] = stage.scale;
        let scale = |factor: f64| (0.5..=2.0).contains(&factor.abs());
        let numbers = [
            ("mount.rotation_deg", pitch, angle(&pitch), &angles),
            ("mount.rotation_deg", yaw, angle(&yaw), &angles),
            ("mount.rotation_deg", roll, angle(&roll), &angles),
            ("stage.scale", right, scale(right), &"0.5 to 2, or -2 to -0.5 for a reversed axis".to_owned()),
            ("stage.scale", down, scale(down), &"0.5 to 2, or -2 to -0.5 for a reversed axis".to_owned()),
            ("stage.skew_deg", stage.skew_deg, angle(&stage.skew_deg), &angles),
            ("stage.backlash_mm", stage.backlash_mm, length(&stage.backlash_mm), &lengths),
            ("stage.repeatability_mm", stage.repeatability_mm, length(&stage.repeatability_mm), &lengths),
            ("stage.rotation_deg", stage.rotation_deg, angle(&stage.rotation_deg) && stage.rotation_deg >= 0.0, &angles),
        ];
        if let Some((key, value, _, expected)) = numbers.into_iter().find(|(_, _, is_valid, _)| !is_valid) {
            return Err(Error::format(path, format!("{key} = {value}"), expected));
        }
        Ok(Imperfections { lens: lens.map(|lens| lens.model(path)).transpose()?, mount_deg, stage })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Imperfections> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("errors.toml");
        std::fs::write(&path, text).unwrap();
        Imperfections::read(&path)
    }

    #[test]
    fn the_example_in_the_documentation_loads() {
        let source = include_str!("imperfections.rs");
        let (_, rest) = source.split_once("/// ```toml\n").unwrap();
        let (example, _) = rest.split_once("/// ```\n").unwrap();
        let found = read(&example.replace("/// ", "").replace("///", "")).unwrap();
        assert_eq!(found.mount_deg, [0.5, -1.0, 2.0]);
        assert_eq!(found.lens.unwrap().focal_px, [955.0; 2]);
        let stage = StageImperfections {
            scale: [1.01, 1.0],
            skew_deg: 0.2,
            backlash_mm: 0.05,
            repeatability_mm: 0.02,
            rotation_deg: 0.05,
            stalls_at_move: Some(6),
        };
        assert_eq!(found.stage, stage);
        assert_eq!(read("[stage]\n").unwrap(), Imperfections::default());
    }

    #[test]
    fn errors_name_the_file_and_the_key() {
        let lens =
            "[lens]\nfocal_px = [100.0, 100.0]\nprincipal_point = [0.0, 0.0]\nmodel = \"plumb_bob\"\ncoefficients = [0.1]\n";
        for (text, expected) in [
            ("[mount]\nroll = 1.0\n", "unknown field `roll`"),
            ("[mount]\nrotation_deg = [1.0, 2.0]\n", "line 2 (rotation_deg"),
            ("[mount]\nrotation_deg = [1.0, nan, 2.0]\n", "found mount.rotation_deg = NaN, expected -45 to 45 degrees"),
            ("[stage]\nscale = [1.0, 3.0]\n", "found stage.scale = 3, expected 0.5 to 2, or"),
            ("[stage]\nbacklash_mm = -0.1\n", "found stage.backlash_mm = -0.1, expected 0 to 10 mm"),
            ("[stage]\nrotation_deg = -1\n", "found stage.rotation_deg = -1"),
            ("[camera]\n", "unknown field `camera`"),
            (lens, "1 coefficients, but plumb_bob has 5"),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(message.contains("errors.toml: found ") && message.contains(expected), "{message}");
        }
    }
}
