//! `capture.log`: when and with what a capture was made, and its steps with their times.

use std::{fmt::Write as _, time::Duration};

use jiff::Zoned;
use multiscopic_core::{
    Frame,
    capture::{CaptureProgress, Plan},
};

use crate::{files::FramePose, images::Transform};

/// The log of a capture that began now.
#[derive(Clone, Debug)]
pub struct CaptureLog {
    date: String,
    text: String,
}

impl CaptureLog {
    /// The name of its file in a captured folder.
    pub const FILE_NAME: &str = "capture.log";

    /// A log that names the camera and the stage.
    pub fn new(camera: &str, stage: &str) -> CaptureLog {
        let date = Zoned::now().strftime("%F %T %:z").to_string();
        CaptureLog { text: format!("{date}\ncamera: {camera}\nstage: {stage}\n"), date }
    }

    /// Adds a line about the capture as a whole.
    pub fn note(&mut self, note: &str) {
        let _ = writeln!(self.text, "{note}");
    }

    /// Adds a step of `plan` that began `elapsed` after the capture did, and returns it in words.
    pub fn step(&mut self, plan: &Plan, elapsed: Duration, progress: CaptureProgress) -> String {
        let step = step_in_words(plan, progress);
        self.add(elapsed, &step);
        step
    }

    /// Adds a step, in words, that began `elapsed` after the capture did.
    pub fn add(&mut self, elapsed: Duration, step: &str) {
        let _ = writeln!(self.text, "{:9.3} s  {step}", elapsed.as_secs_f64());
    }

    /// Adds the places where frames were taken.
    pub fn places(&mut self, poses: &[(Frame, FramePose)]) {
        poses.iter().for_each(|(frame, pose)| self.note(&place_in_words(*frame, pose)));
    }

    /// The time at which the capture began, in local time.
    pub fn date(&self) -> &str {
        &self.date
    }

    /// The text of the file.
    pub fn text(&self) -> &str {
        &self.text
    }
}

/// The place where a frame was taken, in words.
fn place_in_words(frame: Frame, pose: &FramePose) -> String {
    let FramePose { asked_mm: [x, y], counted_mm, measured, .. } = pose;
    let counted = counted_mm.map(|[x, y]| format!(", counted ({x:.3}, {y:.3})"));
    let measured = measured.map(|Transform { translation_mm: [x, y, z], rotation_deg: [a, b, c] }| {
        format!(", measured ({x:.3}, {y:.3}, {z:.3}) mm and ({a:.4}, {b:.4}, {c:.4}) deg in the frame of the base")
    });
    format!("{frame}: asked for ({x}, {y}) mm{}{}", counted.unwrap_or_default(), measured.unwrap_or_default())
}

/// A step of a capture of `plan`, in words.
fn step_in_words(plan: &Plan, progress: CaptureProgress) -> String {
    let name = |index: usize| plan.frames().get(index).copied().map_or(String::new(), |frame| frame.to_string());
    match progress {
        CaptureProgress::Moving(index) => {
            let position = plan.positions().get(index).copied().unwrap_or_default();
            let [x, y] = [position.x_um, position.y_um].map(|um| f64::from(um) / 1000.0);
            format!("moving to ({x}, {y}) mm for the {} frame", name(index))
        }
        CaptureProgress::Settling(index) => format!("settling for the {} frame", name(index)),
        CaptureProgress::Capturing(index) => format!("capturing the {} frame", name(index)),
        CaptureProgress::Captured(index) => format!("captured the {} frame", name(index)),
        CaptureProgress::Retrying(index) => format!("retrying the {} frame", name(index)),
        CaptureProgress::Returning => "returning to the centre".into(),
        CaptureProgress::Done => "done".into(),
    }
}
