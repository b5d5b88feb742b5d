//! The log of a capture, and its steps in words.

use std::{fmt::Write as _, time::Duration};

use multiscopic_core::capture::{CaptureProgress, Plan};

/// The text of `capture.log`: when and with what the capture was made, then its steps with their times.
#[derive(Clone, Debug)]
pub struct CaptureLog(String);

impl CaptureLog {
    /// Its file, within the folder of the capture.
    pub const FILE_NAME: &str = "capture.log";

    /// A log that has its header.
    pub fn new(date: &str, camera: &str, stage: &str) -> CaptureLog {
        CaptureLog(format!("{date}\ncamera: {camera}\nstage: {stage}\n"))
    }

    /// Adds a step that began `elapsed` after the capture did.
    pub fn add(&mut self, elapsed: Duration, step: &str) {
        let _ = writeln!(self.0, "{:9.3} s  {step}", elapsed.as_secs_f64());
    }

    /// Adds a line about the capture as a whole.
    pub fn note(&mut self, note: &str) {
        let _ = writeln!(self.0, "{note}");
    }

    /// The text.
    pub fn as_bytes(&self) -> &[u8] {
        self.0.as_bytes()
    }
}

/// A step of a capture of `plan`, in words.
pub fn step(plan: &Plan, progress: CaptureProgress) -> String {
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
