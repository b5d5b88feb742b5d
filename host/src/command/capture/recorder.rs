//! Captures written to folders.

use std::{error, path::Path, sync::atomic::AtomicUsize, time::Duration};

use image::GrayImage;
use jiff::Zoned;
use multiscopic::{
    Frames, Result, Rig,
    capture::{
        BlockingCamera, ThreadedCamera, acquire_images,
        stage::{AnyStage, Limits},
    },
    files::{FrameFiles, Provenance, output},
};
use multiscopic_core::{
    Frame, Views,
    capture::{CaptureProgress, Plan, Policy, Position},
};

use super::{
    capture_log::{self, CaptureLog},
    long_baseline::LongBaseline,
};
use crate::command::terminal;

/// Takes captures that differ only in their folder and date.
pub struct Recorder<'a> {
    /// Which frames are taken, and where.
    pub plan: Plan,
    /// Time limits, retries and tolerances.
    pub policy: Policy,
    /// How far and how fast the stage may go.
    pub limits: Limits,
    /// The distance from the centre to the nearest neighbours, in micrometres.
    pub baseline_um: u32,
    /// How views at a longer baseline are chosen, if they are taken as needed.
    pub long_baseline: Option<LongBaseline>,
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
    pub fn record<C>(&self, stage: &mut AnyStage, camera: &mut ThreadedCamera<C>, folder: &Path) -> Result<()>
    where
        C: BlockingCamera<Error: error::Error + Send + Sync + 'static> + 'static,
    {
        let date = Zoned::now().strftime("%F %T %:z").to_string();
        let mut log = CaptureLog::new(&date, &self.camera_name, &self.stage_name);
        let images = self.acquire(&self.plan, stage, camera, &mut log)?;
        let mut frames = images.into_iter().fold(None, with_image).expect("a plan begins with the centre");
        let mut notes = Vec::new();
        let extended = match &self.long_baseline {
            Some(long_baseline) => self.extend(&mut frames, long_baseline, stage, camera, &mut log, &mut notes),
            None => Ok(()),
        };
        for note in &notes {
            terminal::say(note);
            log.note(note);
        }
        let rig = self.rig(&frames, date, (!notes.is_empty()).then(|| notes.join("\n")));
        output::write_folder(folder, |folder| {
            frames.save(&rig.images.within(folder))?;
            output::write(&folder.join(CaptureLog::FILE_NAME), |writer| writer.write_all(log.as_bytes()))?;
            rig.save(folder)
        })?;
        let [width, height] = frames.size();
        terminal::say(&format!("{}: {} frames of {width}x{height}", folder.display(), 1 + frames.views().len()));
        extended
    }

    /// Takes views at a longer baseline as well, if they are needed. Whatever fails, the frames that are there stay.
    fn extend<C>(
        &self,
        frames: &mut Frames,
        long_baseline: &LongBaseline,
        stage: &mut AnyStage,
        camera: &mut ThreadedCamera<C>,
        log: &mut CaptureLog,
        notes: &mut Vec<String>,
    ) -> Result<()>
    where
        C: BlockingCamera<Error: error::Error + Send + Sync + 'static> + 'static,
    {
        let geometry = self.rig(frames, String::new(), None).geometry().expect("an accuracy comes with the focal length");
        let mut refinement = long_baseline.begin(frames, geometry)?;
        notes.push(refinement.found());
        loop {
            notes.push(refinement.chosen());
            let views = refinement.next_views();
            if views.is_empty() || frames.views().len() + views.len() > Views::MAX {
                return Ok(());
            }
            let plan = Plan::of_views(views, self.baseline_um).shortened(self.policy.backlash_um);
            let images = self.acquire(&plan, stage, camera, log)?;
            *frames = images.into_iter().fold(Some(frames.clone()), with_image).expect("there were frames before");
            notes.push(refinement.refine(frames)?);
        }
    }

    /// Takes the frames of a plan.
    fn acquire<C>(
        &self,
        plan: &Plan,
        stage: &mut AnyStage,
        camera: &mut ThreadedCamera<C>,
        log: &mut CaptureLog,
    ) -> Result<Vec<(Frame, GrayImage)>>
    where
        C: BlockingCamera<Error: error::Error + Send + Sync + 'static> + 'static,
    {
        log.note(&self.path(plan));
        let bar = terminal::progress(plan.frames().len() as u64, "frames");
        let images = acquire_images(stage, camera, plan, self.policy, self.interrupts, |elapsed, progress| {
            let step = capture_log::step(plan, progress);
            log.add(elapsed, &step);
            bar.set_message(step);
            if let CaptureProgress::Captured(_) = progress {
                bar.inc(1);
            }
        });
        bar.finish_and_clear();
        images
    }

    /// The path of a plan and how long it takes, without the time for the frames.
    fn path(&self, plan: &Plan) -> String {
        let (mut moves, mut at) = (Duration::ZERO, Position::CENTER);
        for position in plan.positions() {
            let before = position.before(self.policy.backlash_um);
            for (from, to) in [(at, before), (before, *position)] {
                moves += self.limits.travel_time(from.length_um(to) as f64 / 1000.0);
            }
            at = *position;
        }
        moves += self.limits.travel_time(at.length_um(Position::CENTER) as f64 / 1000.0);
        let count = plan.positions().len();
        format!(
            "path: {:.1} mm over {count} positions, {:.1} s of moves and {:.1} s of settling",
            plan.travel_um(self.policy.backlash_um) as f64 / 1000.0,
            moves.as_secs_f64(),
            (self.policy.settle * count as u32).as_secs_f64()
        )
    }

    fn rig(&self, frames: &Frames, date: String, notes: Option<String>) -> Rig {
        Rig {
            baseline_mm: f64::from(self.baseline_um) / 1000.0,
            focal_px: self.focal_px,
            principal_point: frames.size().map(|side| (side as f64 - 1.0) / 2.0),
            doffs: 0.0,
            images: FrameFiles::of_capture(frames.views()),
            capture: Provenance {
                camera: Some(self.camera_name.clone()),
                stage: Some(self.stage_name.clone()),
                date: Some(date),
                notes,
                ..Provenance::default()
            },
        }
    }
}

/// Frames with another image, of which the centre comes first.
fn with_image(frames: Option<Frames>, (frame, image): (Frame, GrayImage)) -> Option<Frames> {
    match frame {
        Frame::Center => Some(Frames::new(image)),
        Frame::View(view) => frames.map(|frames| frames.with(view, image)),
    }
}
