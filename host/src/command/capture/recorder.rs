//! Captures written to folders.

use std::{path::Path, sync::atomic::AtomicUsize};

use jiff::Zoned;
use multiscopic::{
    Frames, Result, Rig,
    capture::{ThreadedCamera, acquire_frames, camera::V4l2Camera, stage::AnyStage},
    files::{FrameFiles, Provenance, output},
};
use multiscopic_core::capture::{CaptureProgress, Plan, Policy};

use super::capture_log::{self, CaptureLog};
use crate::command::terminal;

/// Takes captures that differ only in their folder and date.
pub struct Recorder<'a> {
    /// Which frames are taken, and where.
    pub plan: Plan,
    /// Time limits, retries and tolerances.
    pub policy: Policy,
    /// The distance from the centre to each neighbour, in millimetres.
    pub baseline_mm: f64,
    /// The focal length in pixels, if it is known.
    pub focal_px: Option<f64>,
    /// The camera and its settings, in words.
    pub camera_name: String,
    /// The stage, as the command line names it.
    pub stage_name: String,
    /// Counts the interrupts of the user.
    pub interrupts: &'a AtomicUsize,
}

impl Recorder<'_> {
    /// Takes one capture and writes it to `folder`, which appears once it is complete.
    pub fn record(&self, stage: &mut AnyStage, camera: &mut ThreadedCamera<V4l2Camera>, folder: &Path) -> Result<()> {
        let date = Zoned::now().strftime("%F %T %:z").to_string();
        let mut log = CaptureLog::new(&date, &self.camera_name, &self.stage_name);
        let bar = terminal::progress(self.plan.frames().len() as u64, "frames");
        let frames = acquire_frames(stage, camera, &self.plan, self.policy, self.interrupts, |elapsed, progress| {
            let step = capture_log::step(&self.plan, progress);
            log.add(elapsed, &step);
            bar.set_message(step);
            if let CaptureProgress::Captured(_) = progress {
                bar.inc(1);
            }
        });
        bar.finish_and_clear();
        let frames = frames?;
        let rig = self.rig(&frames, date);
        output::write_folder(folder, |folder| {
            frames.save(&rig.images.within(folder))?;
            output::write(&folder.join(CaptureLog::FILE_NAME), |writer| writer.write_all(log.as_bytes()))?;
            rig.save(folder)
        })?;
        let [width, height] = frames.size();
        terminal::say(&format!("{}: {} frames of {width}x{height}", folder.display(), self.plan.frames().len()));
        Ok(())
    }

    fn rig(&self, frames: &Frames, date: String) -> Rig {
        Rig {
            baseline_mm: self.baseline_mm,
            focal_px: self.focal_px,
            principal_point: frames.size().map(|side| (side as f64 - 1.0) / 2.0),
            doffs: 0.0,
            images: FrameFiles::of_capture(frames.views()),
            capture: Provenance {
                camera: Some(self.camera_name.clone()),
                stage: Some(self.stage_name.clone()),
                date: Some(date),
                ..Provenance::default()
            },
        }
    }
}
