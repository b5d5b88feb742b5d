//! Calibrations of lenses, as TOML and as the YAML of other programs.

use multiscopic::{
    CameraModel,
    lens::{Mount, Undistortion},
};

use crate::support::file;

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    for name in ["calibration.toml", "calibration.yaml"] {
        if let Ok(camera) = CameraModel::read(&file(name, bytes)) {
            // What was read can be used.
            let undistortion = Undistortion::new(
                &camera,
                &Mount { rotation_deg: [0.5, -1.0, 2.0], focal_px: None, rotation_deviation_deg: None },
                [8, 6],
            );
            let _ = (undistortion.place(3, 2), camera.direction([3.0, 2.0]), camera.pixel([0.1, -0.2]));
        }
    }
    true
}
