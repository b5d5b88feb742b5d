//! Captures of sweeps: the frames of a camera that a stage slides without stopping, with their places.

use std::{
    fmt::{self, Display},
    path::{Path, PathBuf},
    process::ExitCode,
    sync::Arc,
    time::Duration,
};

use image::GrayImage;
use multiscopic::{
    Error, Frames, Inspection, Picture, Result, Rig,
    alignment::{Delay, Way},
    capture::{CaptureLog, Clock, FreeCamera, SimulatedStream, SteppedClock, SweptFrames, SystemClock, acquire_sweep},
    files::SweepFrame,
};
use multiscopic_core::{Frame, View};
use serde::Serialize;

use super::{
    Capture, Recorder,
    recorder::{save_truth, true_disparities},
};
use crate::command::{
    options::{CameraSpec, value::micrometres},
    terminal,
};

/// The blur and the skew of a frame from which on they are told, in pixels.
const MOST_PX: f64 = 1.0 / 3.0;
/// The share of the length in which the stage may speed up and slow down.
const MOST_RAMPS: f64 = 0.75;
/// The share of the way to an end from which on a frame is left out: it stood there.
const AT_END: f64 = 0.995;
/// The number of steps that are told.
const STEPS: u64 = 6;

/// The outcome of a sweep.
#[derive(Debug, Serialize)]
struct Swept {
    folder: PathBuf,
    /// All frames, the centre among them.
    frames: usize,
    /// The frames that the camera lost.
    dropped: usize,
    width: u32,
    height: u32,
    /// The distance to the farthest frame.
    baseline_mm: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    focal_px: Option<f64>,
    /// The time from the middle of an exposure to the arrival of the frame.
    delay_ms: f64,
    /// Twice the standard deviation of the delay.
    delay_within_ms: f64,
    /// The time between the exposures of two rows, as far as the images tell it.
    #[serde(skip_serializing_if = "Option::is_none")]
    line_us: Option<f64>,
    warnings: Vec<String>,
}

impl Display for Swept {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Swept { folder, frames, dropped, width, height, delay_ms, delay_within_ms, .. } = self;
        write!(f, "{}: {frames} frames of {width}x{height}", folder.display())?;
        match dropped {
            0 => {}
            1 => write!(f, ", 1 dropped")?,
            _ => write!(f, ", {dropped} dropped")?,
        }
        // Without the sign of a zero.
        let delay_ms = (10.0 * delay_ms).round() / 10.0 + 0.0;
        write!(f, ", {delay_ms:.1} ms after their exposure (within {delay_within_ms:.1} ms)")
    }
}

impl Capture {
    /// Takes a sweep of a length.
    pub(super) fn sweep(&self, length_mm: f64) -> Result<ExitCode> {
        let hardware = &self.recorder.hardware;
        let length_um = micrometres("--sweep", length_mm)?;
        let limits = hardware.limits.limits()?;
        let ramps_mm = limits.speed_mm_s.powi(2) / limits.acceleration_mm_s2;
        if ramps_mm > MOST_RAMPS * length_mm {
            return Err(Error::Usage(format!(
                "the stage needs {ramps_mm:.1} mm to reach {} mm/s and to stop, which leaves too little of --sweep {length_mm}: give a \
                 lower --speed, a higher --acceleration or a longer --sweep",
                limits.speed_mm_s
            )));
        }
        let is_simulated = matches!(hardware.camera, CameraSpec::Simulated(_)) && hardware.stage.to_string() == "sim";
        let clock: Arc<dyn Clock> = if is_simulated { SteppedClock::new() } else { Arc::new(SystemClock) };
        let mut recorder = self.recorder.bare_recorder(length_um.div_ceil(2), clock.clone())?;
        let exposure_ms = hardware.settings.settings().exposure.map(|units| f64::from(units) / 10.0);
        let swept = match recorder.hardware.simulated.clone().filter(|_| is_simulated) {
            Some(camera) => {
                let exposure_ms = Some(camera.timing().exposure_ms);
                let mut stream = SimulatedStream::new(camera, clock.clone());
                recorder.sweep(&self.output, &*clock, Some(&mut stream), length_um, exposure_ms)?
            }
            None => recorder.sweep::<SimulatedStream>(&self.output, &*clock, None, length_um, exposure_ms)?,
        };
        swept.warnings.iter().for_each(|warning| terminal::warn(warning));
        match self.json {
            true => terminal::print_report(&swept, true)?,
            false => terminal::say(&swept.to_string()),
        }
        Ok(ExitCode::SUCCESS)
    }
}

impl Recorder {
    /// Takes a sweep and writes it to `folder`, which appears once it is complete. `stream` takes the place of the camera.
    fn sweep<C: FreeCamera<Error: std::error::Error + Send + Sync + 'static>>(
        &mut self,
        folder: &Path,
        clock: &dyn Clock,
        stream: Option<&mut C>,
        length_um: u32,
        exposure_ms: Option<f64>,
    ) -> Result<Swept> {
        let mut log = CaptureLog::new(&self.parts.camera_name, &self.parts.stage_name);
        self.hardware.simulation.iter().for_each(|note| log.note(note));
        let bar = terminal::progress(STEPS, "steps");
        let observe = |elapsed: Duration, step: &str| {
            log.add(elapsed, step);
            bar.set_message(step.to_owned());
            bar.inc(1);
        };
        let hardware = &mut self.hardware;
        let (policy, interrupts) = (hardware.policy, hardware.interrupts.clone());
        let taken = match stream {
            Some(stream) => acquire_sweep(clock, &mut hardware.stage, stream, length_um, policy, &interrupts, observe),
            None => acquire_sweep(clock, &mut hardware.stage, &mut hardware.camera, length_um, policy, &interrupts, observe),
        };
        bar.finish_and_clear();
        if let Some(note) = hardware.warn_of_unlocked() {
            log.note(note);
        }
        let mut taken = taken?;
        let delay = delay(&taken).ok_or_else(|| {
            Error::Usage(
                "the frames of the way there and those of the way back do not tell the delay between camera and stage: show the camera \
                 something with texture that does not move, and give a lower --speed, a longer --sweep or more light"
                    .into(),
            )
        })?;
        let failure = taken.failure.take();
        let dropped = dropped(&taken);
        let frames = placed(&taken, delay, f64::from(length_um) / 2000.0);
        let baseline_mm = frames.iter().map(|(frame, _)| frame.offset_mm.abs()).fold(0.0, f64::max);
        if frames.len() < 2 {
            let count = frames.len();
            return Err(Error::Usage(format!(
                "{count} frames came while the stage moved, and a sweep needs 2: give a lower --speed"
            )));
        }
        let center = Frames::of_picture(taken.center.clone());
        let notes = self.hardware.simulation.clone();
        let rig = Rig {
            baseline_mm: Some(baseline_mm),
            sweep: frames.iter().map(|(frame, _)| frame.clone()).collect(),
            ..self.parts.measured_rig(&center, vec![(Frame::Center, taken.pose)], &log, notes)
        };
        let undistortion = self.parts.undistortion(&rig, center.size())?;
        let truth = self.hardware.simulated.as_ref().and_then(|camera| true_disparities(camera, &rig, undistortion.as_ref()));
        let mut shown = center.clone();
        for (view, place) in [(View::LEFT, -baseline_mm), (View::RIGHT, baseline_mm)] {
            let distance = |frame: &SweepFrame| (frame.offset_mm - place).abs();
            let nearest = frames.iter().min_by(|(a, _), (b, _)| distance(a).total_cmp(&distance(b)));
            if let Some((_, picture)) = nearest.filter(|(frame, _)| distance(frame) <= SweepFrame::TOLERANCE * baseline_mm) {
                shown = shown.with_picture(view, (*picture).clone());
            }
        }
        let shown = undistortion.as_ref().map_or_else(|| shown.clone(), |undistortion| undistortion.frames(&shown));
        let farthest = Inspection::of(&shown.without_color()).corners.last().copied();
        let speed = self.hardware.limits.speed_mm_s;
        let (width, height) = taken.center.dimensions();
        let line_s = Some(delay.row_seconds).filter(|seconds| seconds.abs() > 3.0 * delay.row_deviation);
        let warnings = farthest.map_or_else(Vec::new, |pixels| {
            let px_per_s = speed * pixels / baseline_mm;
            let (blur, skew) =
                (exposure_ms.unwrap_or_default() / 1e3, line_s.unwrap_or_default().abs() * f64::from(height) / 2.0);
            let told = [
                (blur, "the exposure blurs the nearest things by", "a shorter --exposure"),
                (skew, "the rolling shutter moves the nearest things at the top and the bottom by", "a faster sensor mode"),
                (2.0 * delay.deviation, "the uncertain delay may move the nearest things by", "a longer --sweep"),
            ];
            let told = told.into_iter().filter(|(seconds, ..)| seconds * px_per_s > MOST_PX);
            told.map(|(seconds, what, remedy)| {
                format!("{what} {:.1} pixels at {speed} mm/s: give a lower --speed, or {remedy}", seconds * px_per_s)
            })
            .collect()
        });
        let swept = Swept {
            folder: folder.into(),
            frames: 1 + frames.len(),
            dropped,
            width,
            height,
            baseline_mm,
            focal_px: self.parts.focal_px,
            delay_ms: 1e3 * delay.seconds,
            delay_within_ms: 2e3 * delay.deviation,
            line_us: line_s.map(|seconds| 1e6 * seconds),
            warnings,
        };
        log.note(&swept.to_string());
        swept.warnings.iter().for_each(|warning| log.note(warning));
        self.parts.write(folder, &center, &rig, &log, |folder| {
            frames.iter().try_for_each(|(frame, picture)| picture.write_png(&folder.join(&frame.image)))?;
            save_truth(truth.as_ref(), folder)
        })?;
        match failure {
            Some(error) => {
                terminal::complain(&format!("{} is kept, but the capture ended with an error:", folder.display()));
                Err(error)
            }
            None => Ok(swept),
        }
    }
}

/// The delay that the frames tell.
fn delay(taken: &SweptFrames) -> Option<Delay> {
    let [there, back] = taken.passes.each_ref().map(|pass| {
        let gray = |(time, picture): &(f64, Picture)| (*time, picture.to_gray());
        pass.frames.iter().map(gray).collect::<Vec<(f64, GrayImage)>>()
    });
    let [of_there, of_back] = taken.passes.each_ref().map(|pass| &pass.track);
    Delay::estimate(Way { track: of_there, frames: &there }, Way { track: of_back, frames: &back })
}

/// The number of frames that did not come, by the gaps between those that did.
fn dropped(taken: &SweptFrames) -> usize {
    let gaps = taken.passes.iter().flat_map(|pass| pass.frames.windows(2).map(|pair| pair[1].0 - pair[0].0));
    let mut gaps: Vec<f64> = gaps.collect();
    gaps.sort_by(f64::total_cmp);
    let Some(usual) = gaps.get(gaps.len() / 2).copied().filter(|usual| *usual > 0.0) else { return 0 };
    gaps.iter().map(|gap| ((gap / usual).round() as usize).saturating_sub(1)).sum()
}

/// The frames that were taken between the ends, with their places.
fn placed(taken: &SweptFrames, delay: Delay, half_mm: f64) -> Vec<(SweepFrame, &Picture)> {
    let frames = taken.passes.iter().flat_map(|pass| pass.frames.iter().map(move |(time, picture)| (pass, time, picture)));
    let frames = frames.map(|(pass, time, picture)| (pass, time - delay.seconds, picture));
    let moving = frames.filter(|(_, time, _)| *time > 0.0).filter_map(|(pass, time, picture)| {
        let mm = pass.track.at(time);
        (pass.track.knows(time) && mm.abs() <= AT_END * half_mm).then_some((time, mm, picture))
    });
    let named = moving.zip(1..).map(|((time, mm, picture), number)| {
        let exposed = Some(taken.began + Duration::from_secs_f64(time));
        let image = format!("{number:03}.png").into();
        // Without digits that no stage measures.
        (SweepFrame { image, offset_mm: (mm * 1e4).round() / 1e4, exposed }, picture)
    });
    named.collect()
}

#[cfg(test)]
mod tests {
    use multiscopic::{capture::SweepPass, files::FramePose};

    use super::*;

    #[test]
    fn gaps_tell_what_was_dropped() {
        let pass = |times: &[f64]| SweepPass {
            frames: times.iter().map(|time| (*time, Picture::Gray(GrayImage::new(1, 1)))).collect(),
            ..SweepPass::default()
        };
        let passes = [pass(&[0.0, 0.1, 0.21, 0.4, 0.5]), pass(&[9.0, 9.1, 9.4, 9.5])];
        let began = std::time::SystemTime::UNIX_EPOCH;
        let pose = FramePose { asked_mm: [0.0; 2], counted_mm: None, exposed: None, measured: None };
        let taken = SweptFrames { center: Picture::Gray(GrayImage::new(1, 1)), pose, passes, began, failure: None };
        assert_eq!(dropped(&taken), 3);
    }
}
