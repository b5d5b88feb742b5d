//! Captures written to folders, and their logs.

use std::{
    fmt::{self, Display},
    mem,
    path::{Path, PathBuf},
    time::Duration,
};

use multiscopic::{
    FloatImage, Frames, Inspection, Result, Rig,
    capture::{Acquisition, CaptureLog, RigParts, SimulatedCamera, acquire_images},
    files::FramePose,
    lens::Undistortion,
    stereo::next_view::Experience,
};
use multiscopic_core::{
    Frame, Views,
    capture::{CaptureProgress, Plan, Position},
};
use serde::Serialize;

use super::{
    long_baseline::LongBaseline,
    until::{Look, Until},
};
use crate::command::{advice, hardware::Hardware, scene::TRUTH_FILE_NAME, terminal};

/// Takes captures that differ only in their folder and date.
pub struct Recorder {
    /// The frames that are taken, and their places.
    pub plan: Plan,
    /// The choice of more views, if they are taken as needed.
    pub extension: Option<Extension>,
    /// The parts of the rig, and what is known of them.
    pub parts: RigParts,
    /// The stage and the camera.
    pub hardware: Hardware,
}

/// The choice of views that are taken as needed.
pub enum Extension {
    /// Longer baselines, until depths are accurate.
    Accuracy(LongBaseline),
    /// Any views, until a share of the depths is precise.
    Until(Until),
}

/// The outcome of a recording.
#[derive(Debug, Serialize)]
pub struct Recorded {
    folder: PathBuf,
    frames: usize,
    width: usize,
    height: usize,
    /// The neighbours, by name.
    views: Vec<String>,
    baseline_mm: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    focal_px: Option<f64>,
    /// The range of disparities that the images show, where corners tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    min_disparity: Option<i16>,
    #[serde(skip_serializing_if = "Option::is_none")]
    num_disparities: Option<u16>,
    /// The choice of views that were taken as needed.
    notes: Vec<String>,
    /// The fate of the accuracy or the goal that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub is_accurate: Option<bool>,
}

impl Display for Recorded {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Recorded { folder, frames, width, height, .. } = self;
        write!(f, "{}: {frames} frames of {width}x{height}", folder.display())
    }
}

impl Recorder {
    /// Takes one capture and writes it to `folder`, which appears once it is complete, even if the stage fails after the last
    /// frame. `observe` is told each step, how many frames are taken, and how many there are.
    pub fn record(&mut self, folder: &Path, observe: &mut dyn FnMut(&str, usize, usize)) -> Result<Recorded> {
        let mut log = CaptureLog::new(&self.parts.camera_name, &self.parts.stage_name);
        if let Some(note) = &self.hardware.simulation {
            log.note(note);
        }
        let mut taken = acquire(&mut self.hardware, &self.plan, &mut log, observe)?;
        let failure = taken.failure.take();
        let mut poses = mem::take(&mut taken.poses);
        let mut frames = taken.frames();
        let mut notes = Vec::new();
        let ended = match failure {
            Some(error) => Err(error),
            None => self.extend(&mut frames, &mut poses, &mut log, &mut notes, observe),
        };
        for note in &notes {
            terminal::complain(note);
            log.note(note);
        }
        if let Err(error) = &ended {
            log.note(&advice::error(error));
        }
        let all_notes: Vec<&str> = self.hardware.simulation.iter().chain(&notes).map(String::as_str).collect();
        let all_notes = (!all_notes.is_empty()).then(|| all_notes.join("\n"));
        let rig = self.parts.measured_rig(&frames, poses, &log, all_notes);
        let undistortion = self.parts.undistortion(&rig, frames.size())?;
        let simulated = self.hardware.simulated.as_ref();
        let truth = simulated.and_then(|camera| true_disparities(camera, &rig, undistortion.as_ref()));
        self.parts.write(folder, &frames, &rig, &log, |folder| save_truth(truth.as_ref(), folder))?;
        let frames = frames.without_color();
        let [width, height] = frames.size();
        let ideal = undistortion.map_or_else(|| frames.clone(), |undistortion| undistortion.frames(&frames));
        let inspection = Inspection::of(&ideal);
        let (min_disparity, num_disparities) = inspection.found_range().ok().unzip();
        let recorded = Recorded {
            folder: folder.into(),
            frames: 1 + frames.views().len(),
            width,
            height,
            views: frames.views().iter().map(|view| view.to_string()).collect(),
            baseline_mm: rig.baseline_mm.unwrap_or_default(),
            focal_px: self.parts.focal_px,
            min_disparity,
            num_disparities,
            notes,
            is_accurate: ended.as_ref().ok().copied().flatten(),
        };
        terminal::say(&recorded.to_string());
        advice::range_line(&inspection).into_iter().for_each(|line| terminal::say(&line));
        ended
            .map(|_| recorded)
            .inspect_err(|_| terminal::complain(&format!("{} is kept, but the capture ended with an error:", folder.display())))
    }

    /// Takes more views, if they are needed, and returns if the depths are as accurate as was asked for. Whatever fails, the frames
    /// that are there stay.
    fn extend(
        &mut self,
        frames: &mut Frames,
        poses: &mut Vec<(Frame, FramePose)>,
        log: &mut CaptureLog,
        notes: &mut Vec<String>,
        observe: &mut dyn FnMut(&str, usize, usize),
    ) -> Result<Option<bool>> {
        let Some(extension) = &self.extension else { return Ok(None) };
        let rig = self.parts.rig(frames);
        let geometry = rig.geometry(frames.size()).expect("an accuracy comes with the focal length");
        let undistortion = self.parts.undistortion(&rig, frames.size())?;
        let ideal = |frames: &Frames| undistortion.as_ref().map_or_else(|| frames.clone(), |lens| lens.frames(frames));
        let (hardware, baseline_um) = (&mut self.hardware, self.parts.baseline_um);
        // Takes views, and adds them to some frames, or if that fails to those that are kept.
        let mut take = |views: Views, to: Frames, frames: &mut Frames, poses: &mut Vec<(Frame, FramePose)>| {
            let plan = Plan::of_views(views, baseline_um).shortened(hardware.policy.backlash_um);
            let mut taken = acquire(hardware, &plan, log, observe)?;
            let added = mem::take(&mut taken.poses);
            if let Some(error) = taken.failure.take() {
                poses.extend(added);
                *frames = taken.added_to(frames.clone());
                return Err(error);
            }
            Ok((taken.added_to(to), added))
        };
        match extension {
            Extension::Accuracy(long_baseline) => {
                let gray = |frames: &Frames| ideal(&frames.clone().without_color());
                let mut refinement = long_baseline.begin(&gray(frames), geometry)?;
                notes.push(refinement.found());
                let short = frames.clone();
                loop {
                    notes.push(refinement.chosen());
                    let views = refinement.next_views();
                    let is_full = frames.views().len() + views.len() > Views::MAX;
                    if views.is_empty() || is_full {
                        let miss = refinement.miss();
                        let full = is_full.then(|| format!("no more than {} views can be matched", Views::MAX));
                        notes.extend(full.into_iter().chain(miss.clone()));
                        return Ok(Some(miss.is_none()));
                    }
                    // Views at baselines in between would only add noise.
                    let (extended, added) = take(views, short.clone(), frames, poses)?;
                    let (reached, is_better) = refinement.refine(&gray(&extended))?;
                    notes.push(reached);
                    if is_better {
                        poses.truncate(1 + short.views().len());
                        poses.extend(added);
                        *frames = extended;
                    }
                }
            }
            Extension::Until(until) => {
                let look = |frames: &Frames, before: Option<&Look>| {
                    let of_baseline = rig.baseline_deviation_mm(frames.views());
                    until.look(ideal(frames), geometry, of_baseline, undistortion.as_ref(), before)
                };
                let (mut best, mut tried, mut experience) = (look(frames, None)?, frames.views(), Experience::default());
                notes.push(until.found(&best));
                while let Some(next) = until.next(&best, tried, experience) {
                    notes.push(until.chosen(&next, &best));
                    tried = tried.with(next.view);
                    let (extended, added) = take(Views::NONE.with(next.view), frames.clone(), frames, poses)?;
                    let found = look(&extended, Some(&best))?;
                    notes.push(until.found(&found));
                    experience = experience.with(next.share - best.reached, found.reached - best.reached);
                    if found.reached <= best.reached {
                        notes.push(format!("{} does not help, and is left out", next.view));
                        continue;
                    }
                    poses.extend(added);
                    (*frames, best) = (extended, found);
                }
                let miss = until.miss(&best, tried);
                notes.extend(miss.clone());
                Ok(Some(miss.is_none()))
            }
        }
    }
}

/// Writes the true disparities of a simulated capture.
pub(super) fn save_truth(truth: Option<&FloatImage>, folder: &Path) -> Result<()> {
    truth.map_or(Ok(()), |truth| multiscopic::files::write_pfm(truth, &folder.join(TRUTH_FILE_NAME)))
}

/// The true disparities of a simulated capture, as `match` should find them: those of the points that each pixel of the centre
/// shows after the rig's lens and mount have been taken out, at its focal length and baseline.
pub(super) fn true_disparities(camera: &SimulatedCamera, rig: &Rig, undistortion: Option<&Undistortion>) -> Option<FloatImage> {
    let ([width, height], focal_px, baseline_mm) = (camera.size().map(|side| side as usize), rig.focal_px?, rig.baseline_mm?);
    let place = |k: usize| {
        let (u, v) = (k % width, k / width);
        let [x, y] = undistortion.map_or(Some([u as f64, v as f64]), |undistortion| undistortion.place(u, v))?;
        // What the picture does not show, nothing can find.
        let is_inside = (-0.5..width as f64 - 0.5).contains(&x) && (-0.5..height as f64 - 0.5).contains(&y);
        is_inside.then_some([x, y])
    };
    let depths = camera.true_depths(&(0..width * height).map(place).collect::<Vec<_>>());
    let disparity = |depth: Option<f64>| depth.map_or(f32::INFINITY, |depth| (focal_px * baseline_mm / depth) as f32);
    Some(FloatImage::new(width, height, depths.into_iter().map(disparity).collect()))
}

/// Takes the frames of a plan.
fn acquire(
    hardware: &mut Hardware,
    plan: &Plan,
    log: &mut CaptureLog,
    observe: &mut dyn FnMut(&str, usize, usize),
) -> Result<Acquisition> {
    log.note(&path(hardware, plan));
    let total = plan.frames().len();
    let bar = terminal::progress(total as u64, "frames");
    let mut done = 0;
    let Hardware { stage, camera, policy, interrupts, .. } = hardware;
    let images = acquire_images(stage, camera, plan, *policy, interrupts, |elapsed, progress| {
        let step = log.step(plan, elapsed, progress);
        if let CaptureProgress::Captured(_) = progress {
            bar.inc(1);
            done += 1;
        }
        observe(&step, done, total);
        bar.set_message(step);
    });
    bar.finish_and_clear();
    if let Ok(taken) = &images {
        log.places(&taken.poses);
    }
    if let Some(note) = hardware.warn_of_unlocked() {
        log.note(note);
    }
    images
}

/// The path of a plan and how long it takes, without the time for the frames.
fn path(hardware: &Hardware, plan: &Plan) -> String {
    let Hardware { limits, policy, .. } = hardware;
    let time = |(from, to): (Position, Position)| limits.travel_time(from.length_um(to) as f64 / 1000.0);
    let moves: Duration = plan.moves(policy.backlash_um).map(time).sum();
    let count = plan.positions().len();
    format!(
        "path: {:.1} mm over {count} positions, {:.1} s of moves and {:.1} s of settling",
        plan.travel_um(policy.backlash_um) as f64 / 1000.0,
        moves.as_secs_f64(),
        (policy.settle * count as u32).as_secs_f64()
    )
}
