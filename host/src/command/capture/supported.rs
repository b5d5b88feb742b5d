//! The command itself, for builds with V4L2.

use std::{
    fs,
    num::NonZeroU32,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use clap::Args;
use multiscopic::{
    Error, Result,
    capture::{
        ThreadedCamera,
        camera::V4l2Camera,
        stage::{self, AnyStage, StageSpec},
    },
    files::output,
};
use multiscopic_core::capture::{Plan, Policy};

use super::{
    capture_options::{LimitsOptions, SequenceOptions, SettingsOptions, micrometres},
    recorder::Recorder,
};
use crate::command::options::{value::positive, views_of_count};

/// How much longer than the camera the sequence waits for a frame: the camera's own error says more about the cause.
const CAMERA_FIRST: Duration = Duration::from_secs(3);

/// Captures the frames of a rig: a stage moves a camera to the centre and to its neighbours
///
/// The folder appears once all frames are taken. When the command ends, for whatever reason, the stage stands still.
/// Ctrl-C returns it to the centre; a second Ctrl-C stops it where it is.
#[derive(Clone, Debug, Args)]
pub struct Capture {
    /// V4l2Camera, as listed by `multiscopic devices`
    #[arg(long, value_name = "/dev/videoN")]
    camera: PathBuf,

    /// What moves the camera in its image plane: a Universal Robots arm, a machine that runs Grbl or Marlin, or you
    #[arg(long, value_name = "ur10:HOST[:PORT[,RTDE_PORT]]|gcode:TTY[@BAUD]|manual")]
    stage: StageSpec,

    /// Distance from the centre to each neighbour, in millimetres
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true)]
    baseline: f64,

    /// Neighbours: right (1), left and right (2), top as well (3), or all (4)
    #[arg(long, value_name = "1|2|3|4", default_value_t = 4)]
    views: usize,

    /// Folder for the frames, rig.toml and capture.log; with --live it holds folders 0001, 0002, and so on
    #[arg(short, long, value_name = "RIG_DIR")]
    output: PathBuf,

    /// Capture repeatedly until Ctrl-C
    #[arg(long)]
    live: bool,

    /// Number of captures with --live [default: no limit]
    #[arg(long, value_name = "N", requires = "live")]
    count: Option<NonZeroU32>,

    /// The camera's focal length in pixels, recorded in rig.toml; depth needs it
    #[arg(long, value_name = "PX", value_parser = positive, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    #[command(flatten)]
    settings: SettingsOptions,

    #[command(flatten)]
    sequence: SequenceOptions,

    #[command(flatten)]
    limits: LimitsOptions,
}

impl Capture {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let views = views_of_count(self.views)?;
        let plan = Plan::new(views, micrometres("--baseline", self.baseline)?);
        let camera_timeout = self.settings.frame_timeout()?;
        let policy = self.sequence.policy(&self.stage, camera_timeout + CAMERA_FIRST)?;
        let limits = self.limits.limits()?;
        if !self.live {
            output::check_folder(&self.output)?;
        }
        let interrupts = Arc::new(AtomicUsize::new(0));
        count_interrupts(&interrupts)?;

        // Opened once up front, so that a faulty camera is found before anything moves.
        let camera_name = V4l2Camera::open(&self.camera, &self.settings.settings())?.to_string();
        let mut stage = stage::open(&self.stage, &limits)?;
        let (path, settings) = (self.camera.clone(), self.settings.settings());
        let mut camera = ThreadedCamera::new(move || V4l2Camera::open(&path, &settings), camera_timeout);
        let recorder = self.recorder(plan, policy, camera_name, &interrupts);
        if self.live {
            self.run_live(&recorder, &mut stage, &mut camera)?;
        } else {
            recorder.record(&mut stage, &mut camera, &self.output)?;
        }
        Ok(ExitCode::SUCCESS)
    }

    fn recorder<'a>(&self, plan: Plan, policy: Policy, camera_name: String, interrupts: &'a AtomicUsize) -> Recorder<'a> {
        let (baseline_mm, focal_px, stage_name) = (self.baseline, self.focal_px, self.stage.to_string());
        Recorder { plan, policy, baseline_mm, focal_px, camera_name, stage_name, interrupts }
    }

    /// Records captures in numbered folders until there are enough or the user interrupts.
    fn run_live(&self, recorder: &Recorder, stage: &mut AnyStage, camera: &mut ThreadedCamera<V4l2Camera>) -> Result<()> {
        fs::create_dir_all(&self.output).map_err(|source| Error::Write { path: self.output.clone(), source })?;
        let mut folders = free_folders(&self.output);
        for _ in 0..self.count.map_or(u32::MAX, NonZeroU32::get) {
            if recorder.interrupts.load(Ordering::Relaxed) > 0 {
                break;
            }
            let Some(folder) = folders.next() else {
                return Err(Error::Usage(format!("{} is full, give another folder", self.output.display())));
            };
            recorder.record(stage, camera, &folder)?;
        }
        Ok(())
    }
}

/// Folders 0001 to 9999 within `parent`, without those that exist.
fn free_folders(parent: &Path) -> impl Iterator<Item = PathBuf> {
    (1..=9999).map(move |number| parent.join(format!("{number:04}"))).filter(|folder| !folder.exists())
}

/// Makes Ctrl-C count up instead of ending the program.
fn count_interrupts(interrupts: &Arc<AtomicUsize>) -> Result<()> {
    let interrupts = interrupts.clone();
    let handler = move || {
        interrupts.fetch_add(1, Ordering::Relaxed);
    };
    ctrlc::set_handler(handler)
        .map_err(|error| Error::Usage(format!("cannot handle Ctrl-C, so the stage could not be stopped: {error}")))
}
