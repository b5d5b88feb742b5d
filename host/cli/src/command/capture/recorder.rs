//! Captures written to folders, and their logs.

use std::{
    collections::BTreeMap,
    fmt::{self, Display, Write as _},
    mem,
    path::{Path, PathBuf},
    time::Duration,
};

use jiff::Zoned;
use multiscopic::{
    CameraModel, FloatImage, Frames, Inspection, Result, Rig,
    capture::{Acquisition, SimulatedCamera, acquire_images},
    files::{FrameFiles, FramePose, Provenance, output},
    images::Transform,
    lens::{HandEye, LensFile, MeasuredViews, Mount, Undistortion},
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
    /// The distance from the centre to the nearest neighbours, in micrometres.
    pub baseline_um: u32,
    /// The choice of more views, if they are taken as needed.
    pub extension: Option<Extension>,
    /// The focal length in pixels, if it is known.
    pub focal_px: Option<f64>,
    /// The calibration of the camera's lens, if it is known.
    pub lens: Option<LensFile>,
    /// The rotation of the camera against the axes of the stage, if it is known.
    pub mount: Option<Mount>,
    /// The place of the camera on the tool of an arm, if it is known.
    pub hand_eye: Option<HandEye>,
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
        let date = Zoned::now().strftime("%F %T %:z").to_string();
        let mut log = CaptureLog::new(&date, &self.hardware.camera_name, &self.hardware.stage_name);
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
        let poses = poses.into_iter().map(|(frame, pose)| (frame.to_string(), pose)).collect();
        let mut rig = Rig { poses, ..self.rig(&frames, date, (!all_notes.is_empty()).then(|| all_notes.join("\n"))) };
        // What was measured is nearer to the truth than what was asked for.
        let measured_mm = MeasuredViews::of_rig(&rig, self.hand_eye.as_ref()).baseline_mm(&rig);
        rig.baseline_mm = measured_mm.map(to_tenths_of_micrometres).or(rig.baseline_mm);
        let undistortion = undistortion(&rig, &self.lens, frames.size())?;
        let simulated = self.hardware.simulated.as_ref();
        let truth = simulated.and_then(|camera| true_disparities(camera, &rig, undistortion.as_ref()));
        output::write_folder(folder, |folder| {
            frames.save(&rig.images.within(folder))?;
            self.save(folder, &rig, truth.as_ref(), &log)
        })?;
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
            focal_px: self.focal_px,
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
        let rig = self.rig(frames, String::new(), None);
        let geometry = rig.geometry(frames.size()).expect("an accuracy comes with the focal length");
        let undistortion = undistortion(&rig, &self.lens, frames.size())?;
        let ideal = |frames: &Frames| undistortion.as_ref().map_or_else(|| frames.clone(), |lens| lens.frames(frames));
        let (hardware, baseline_um) = (&mut self.hardware, self.baseline_um);
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

    /// Writes all files of a capture but the images.
    pub(super) fn save(&self, folder: &Path, rig: &Rig, truth: Option<&FloatImage>, log: &CaptureLog) -> Result<()> {
        if let Some(truth) = truth {
            multiscopic::files::write_pfm(truth, &folder.join(TRUTH_FILE_NAME))?;
        }
        output::write(&folder.join(CaptureLog::FILE_NAME), |writer| writer.write_all(log.as_bytes()))?;
        if let Some(lens) = &self.lens {
            lens.camera.save(&folder.join(CameraModel::FILE_NAME))?;
        }
        if let Some(hand_eye) = &self.hand_eye {
            hand_eye.save(&folder.join(HandEye::FILE_NAME))?;
        } else if let Some(mount) = &self.mount {
            mount.save(&folder.join(Mount::FILE_NAME))?;
        }
        rig.save(folder)
    }

    pub(super) fn rig(&self, frames: &Frames, date: String, notes: Option<String>) -> Rig {
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
            sweep: Vec::new(),
            images: FrameFiles::of_capture(frames.views()),
            alignment: None,
            poses: BTreeMap::new(),
            capture: Provenance {
                camera: Some(self.hardware.camera_name.clone()),
                stage: Some(self.hardware.stage_name.clone()),
                date: Some(date),
                notes,
                ..Provenance::default()
            },
        }
    }
}

/// A length without digits that no stage measures.
pub(super) fn to_tenths_of_micrometres(mm: f64) -> f64 {
    (mm * 1e4).round() / 1e4
}

/// Returns what makes the frames of a rig ideal, unless they are.
pub(super) fn undistortion(rig: &Rig, lens: &Option<LensFile>, size: [usize; 2]) -> Result<Option<Undistortion>> {
    let calibration = LensFile::with_mount(lens.clone(), rig, Path::new(Rig::FILE_NAME));
    calibration.map(|calibration| calibration.undistortion(size)).transpose()
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
        let step = step_in_words(plan, progress);
        log.add(elapsed, &step);
        if let CaptureProgress::Captured(_) = progress {
            bar.inc(1);
            done += 1;
        }
        observe(&step, done, total);
        bar.set_message(step);
    });
    bar.finish_and_clear();
    images.iter().flat_map(|taken| &taken.poses).for_each(|(frame, pose)| log.note(&pose_in_words(*frame, pose)));
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

/// The text of `capture.log`: when and with what the capture was made, then its steps with their times.
#[derive(Clone, Debug)]
pub(super) struct CaptureLog(String);

impl CaptureLog {
    /// Its file, within the folder of the capture.
    const FILE_NAME: &str = "capture.log";

    /// A log that has its header.
    pub(super) fn new(date: &str, camera: &str, stage: &str) -> CaptureLog {
        CaptureLog(format!("{date}\ncamera: {camera}\nstage: {stage}\n"))
    }

    /// Adds a step that began `elapsed` after the capture did.
    pub(super) fn add(&mut self, elapsed: Duration, step: &str) {
        let _ = writeln!(self.0, "{:9.3} s  {step}", elapsed.as_secs_f64());
    }

    /// Adds a line about the capture as a whole.
    pub(super) fn note(&mut self, note: &str) {
        let _ = writeln!(self.0, "{note}");
    }

    /// The text.
    fn as_bytes(&self) -> &[u8] {
        self.0.as_bytes()
    }
}

/// The place where a frame was taken, in words.
fn pose_in_words(frame: Frame, pose: &FramePose) -> String {
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
