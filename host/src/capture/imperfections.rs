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
/// Its file has four tables, of which each may be missing:
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
/// silent = true                   # it does not tell where it is
///
/// [camera]                        # how it takes frames while it moves
/// frames_per_s = 15.0
/// delay_ms = 35.0                 # from the middle of an exposure to the arrival of the frame
/// jitter_ms = 1.0                 # the most by which a frame arrives later than that
/// exposure_ms = 5.0
/// line_us = 20.0                  # the time between the exposures of two rows, of a rolling shutter
/// drops_every = 10                # the last of so many frames is lost; without, none is
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Imperfections {
    /// The camera's lens. `None`: a pinhole.
    pub lens: Option<CameraModel>,
    /// The camera's turn against the stage: a rotation vector about the axes to the right, down and ahead, in degrees.
    pub mount_deg: [f64; 3],
    /// Those of the stage.
    pub stage: StageImperfections,
    /// The camera while it moves.
    pub camera: CameraTiming,
}

/// The frames of a simulated camera that runs free. By default they take no time, and none is lost.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraTiming {
    /// Frames in a second.
    pub frames_per_s: f64,
    /// The time from the middle of an exposure to the arrival of the frame, in milliseconds.
    pub delay_ms: f64,
    /// The most by which a frame arrives later than that, in milliseconds.
    pub jitter_ms: f64,
    /// The time for which a row is exposed, in milliseconds.
    pub exposure_ms: f64,
    /// The time between the exposures of two rows, in microseconds.
    pub line_us: f64,
    /// The last of so many frames is lost.
    pub drops_every: Option<u32>,
}

impl Default for CameraTiming {
    fn default() -> CameraTiming {
        CameraTiming { frames_per_s: 15.0, delay_ms: 0.0, jitter_ms: 0.0, exposure_ms: 0.0, line_us: 0.0, drops_every: None }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ImperfectionsToml {
    lens: Option<CameraToml>,
    #[serde(default)]
    mount: MountToml,
    #[serde(default)]
    stage: StageImperfections,
    #[serde(default)]
    camera: CameraTiming,
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
        let ImperfectionsToml { lens, mount: MountToml { rotation_deg: mount_deg }, stage, camera } =
            input::read_toml(path, "the tables lens, mount, stage and camera of a simulated rig")?;
        let angle = |degrees: &f64| degrees.abs() <= Self::MAX_ROTATION_DEG;
        let length = |mm: &f64| (0.0..=10.0).contains(mm);
        let angles = format!("-{0} to {0} degrees", Self::MAX_ROTATION_DEG);
        let lengths = "0 to 10 mm".to_owned();
        let (time, times) = (|time: f64| (0.0..=500.0).contains(&time), "0 to 500 ms".to_owned());
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
            (
                "camera.frames_per_s",
                camera.frames_per_s,
                (0.1..=1000.0).contains(&camera.frames_per_s),
                &"0.1 to 1000".to_owned(),
            ),
            ("camera.delay_ms", camera.delay_ms, time(camera.delay_ms), &times),
            ("camera.jitter_ms", camera.jitter_ms, time(camera.jitter_ms), &times),
            ("camera.exposure_ms", camera.exposure_ms, time(camera.exposure_ms), &times),
            ("camera.line_us", camera.line_us, time(camera.line_us), &"0 to 500 us".to_owned()),
            ("stage.rotation_deg", stage.rotation_deg, angle(&stage.rotation_deg) && stage.rotation_deg >= 0.0, &angles),
        ];
        if let Some((key, value, _, expected)) = numbers.into_iter().find(|(_, _, is_valid, _)| !is_valid) {
            return Err(Error::format(path, format!("{key} = {value}"), expected));
        }
        if camera.drops_every.is_some_and(|every| every < 2) {
            return Err(Error::format(path, "camera.drops_every below 2", "2 or more, or nothing"));
        }
        Ok(Imperfections { lens: lens.map(|lens| lens.model(path)).transpose()?, mount_deg, stage, camera })
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
            is_silent: true,
        };
        assert_eq!(found.stage, stage);
        assert_eq!((found.camera.delay_ms, found.camera.drops_every), (35.0, Some(10)));
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
            ("[camera]\nline_us = 501\n", "found camera.line_us = 501, expected 0 to 500 us"),
            ("[camera]\nframes_per_s = 0\n", "found camera.frames_per_s = 0, expected 0.1 to 1000"),
            ("[camera]\ndrops_every = 1\n", "found camera.drops_every below 2"),
            ("[sensor]\n", "unknown field `sensor`"),
            (lens, "1 coefficients, but plumb_bob has 5"),
        ] {
            let message = read(text).unwrap_err().to_string();
            assert!(message.contains("errors.toml: found ") && message.contains(expected), "{message}");
        }
    }
}
