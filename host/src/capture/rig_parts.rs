//! The parts of a rig, and the folders of what they captured.

use std::{collections::BTreeMap, path::Path};

use multiscopic_core::Frame;

use super::capture_log::CaptureLog;
use crate::{
    error::Result,
    files::{FrameFiles, FramePose, Provenance, Rig, output},
    images::Frames,
    lens::{CameraModel, HandEye, LensFile, MeasuredViews, Mount, Undistortion},
};

/// The parts of a rig, and what is known of them: what all its captures have in common.
#[derive(Clone, Debug)]
pub struct RigParts {
    /// The camera and its settings, in words.
    pub camera_name: String,
    /// The stage, in words.
    pub stage_name: String,
    /// The distance from the centre to the nearest neighbours, in micrometres.
    pub baseline_um: u32,
    /// The focal length in pixels, if it is known.
    pub focal_px: Option<f64>,
    /// The calibration of the camera's lens, if it is known.
    pub lens: Option<LensFile>,
    /// The rotation of the camera against the axes of the stage, if it is known. The stage takes out its roll.
    pub mount: Option<Mount>,
    /// The place of the camera on the tool of an arm, if it is known.
    pub hand_eye: Option<HandEye>,
}

impl RigParts {
    /// The rig of frames that stand where they should.
    pub fn rig(&self, frames: &Frames) -> Rig {
        let lens = self.lens.as_ref().map(|lens| lens.camera);
        let middle = frames.size().map(|side| (side as f64 - 1.0) / 2.0);
        Rig {
            baseline_mm: Some(f64::from(self.baseline_um) / 1000.0),
            focal_px: self.focal_px,
            principal_point: Some(lens.map_or(middle, |camera| camera.principal_point)),
            doffs: 0.0,
            lens: lens.map(|_| CameraModel::FILE_NAME.into()),
            mount_rotation_deg: self.mount.map(|mount| mount.split_roll().1.rotation_deg),
            hand_eye: self.hand_eye.map(|_| HandEye::FILE_NAME.into()),
            mount_roll_deg: self.mount.map(|mount| mount.split_roll().0.to_degrees()),
            images: FrameFiles::of_capture(frames.views()),
            sweep: Vec::new(),
            alignment: None,
            poses: BTreeMap::new(),
            capture: Provenance {
                camera: Some(self.camera_name.clone()),
                stage: Some(self.stage_name.clone()),
                ..Provenance::default()
            },
        }
    }

    /// The rig of frames that were taken at `poses`, from which its baseline follows as far as they were measured.
    pub fn measured_rig(&self, frames: &Frames, poses: Vec<(Frame, FramePose)>, log: &CaptureLog, notes: Option<String>) -> Rig {
        let mut rig = self.rig(frames);
        rig.poses = poses.into_iter().map(|(frame, pose)| (frame.to_string(), pose)).collect();
        (rig.capture.date, rig.capture.notes) = (Some(log.date().into()), notes);
        // What was measured is nearer to the truth than what was asked for.
        let measured_mm = MeasuredViews::of_rig(&rig, self.hand_eye.as_ref()).baseline_mm(&rig);
        rig.baseline_mm = measured_mm.map(to_tenths_of_micrometres).or(rig.baseline_mm);
        rig
    }

    /// Returns what makes the frames of a rig of these parts ideal, unless they are.
    ///
    /// # Errors
    /// The calibration of the lens is for another size.
    pub fn undistortion(&self, rig: &Rig, size: [usize; 2]) -> Result<Option<Undistortion>> {
        let calibration = LensFile::with_mount(self.lens.clone(), rig, Path::new(Rig::FILE_NAME));
        calibration.map(|calibration| calibration.undistortion(size)).transpose()
    }

    /// Writes the frames of a capture, its rig, copies of the calibrations and the log to `folder`, which appears once it is
    /// complete. `also` may write more into the folder that it is given.
    ///
    /// # Errors
    /// Those of [`output::write_folder`] and of `also`.
    pub fn write(
        &self,
        folder: &Path,
        frames: &Frames,
        rig: &Rig,
        log: &CaptureLog,
        also: impl FnOnce(&Path) -> Result<()>,
    ) -> Result<()> {
        output::write_folder(folder, |folder| {
            also(folder)?;
            frames.save(&rig.images.within(folder))?;
            output::write(&folder.join(CaptureLog::FILE_NAME), |writer| writer.write_all(log.text().as_bytes()))?;
            if let Some(lens) = &self.lens {
                lens.camera.save(&folder.join(CameraModel::FILE_NAME))?;
            }
            if let Some(hand_eye) = &self.hand_eye {
                hand_eye.save(&folder.join(HandEye::FILE_NAME))?;
            } else if let Some(mount) = &self.mount {
                mount.save(&folder.join(Mount::FILE_NAME))?;
            }
            rig.save(folder)
        })
    }
}

/// A length without digits that no stage measures.
fn to_tenths_of_micrometres(mm: f64) -> f64 {
    (mm * 1e4).round() / 1e4
}
