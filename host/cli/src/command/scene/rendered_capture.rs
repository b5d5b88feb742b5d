//! Rendered captures in folders, as a rig would leave them.

use std::path::{Path, PathBuf};

use multiscopic::{
    Result, Rig,
    files::{FrameFiles, Provenance, image_codec::write_png},
    scene::{PinholeCamera, Shot},
};
use multiscopic_core::{Frame, Views};

/// The true disparities of a rendered capture, within its folder.
pub const TRUTH_FILE_NAME: &str = "truth.pfm";

/// The file of the true disparities in a captured folder, if it is there.
pub fn truth_file(folder: &Path) -> Option<PathBuf> {
    Some(folder.join(TRUTH_FILE_NAME)).filter(|path| path.is_file())
}

/// Writes the frames, the truth and `rig.toml` into a folder that is there. `what` says what was rendered.
pub fn write(folder: &Path, shot: &Shot, camera: &PinholeCamera, what: String) -> Result<()> {
    let frames = std::iter::once(Frame::Center).chain(shot.neighbors.keys().copied().map(Frame::View));
    for frame in frames {
        write_png(&folder.join(FrameFiles::name_of(frame)), shot.frame(frame))?;
    }
    multiscopic::files::write_pfm(&shot.truth, &folder.join(TRUTH_FILE_NAME))?;
    rig(camera, shot.neighbors.keys().copied().collect(), what).save(folder)
}

/// The rig of a rendered capture.
pub fn rig(camera: &PinholeCamera, views: Views, what: String) -> Rig {
    let middle = |side: u32| (f64::from(side) - 1.0) / 2.0;
    Rig {
        baseline_mm: Some(camera.baseline_mm),
        focal_px: Some(camera.focal_px),
        principal_point: Some([middle(camera.width), middle(camera.height)]),
        doffs: 0.0,
        lens: None,
        mount_rotation_deg: None,
        images: FrameFiles::of_capture(views),
        alignment: None,
        capture: Provenance {
            camera: Some("ray tracer".into()),
            stage: Some("simulated".into()),
            repeatability_mm: Some(camera.repeatability_mm),
            notes: Some(what),
            ..Provenance::default()
        },
    }
}
