//! The command itself, for builds with V4L2.

use std::{
    error, fs,
    num::NonZeroU32,
    path::{Path, PathBuf},
    process::ExitCode,
    result,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use clap::Args;
use multiscopic::{
    Engine, Error, Result,
    capture::{
        BlockingCamera, SimulatedCamera, ThreadedCamera,
        camera::V4l2Camera,
        stage::{self, AnyStage, Limits, SimulatedStage, StageSpec},
    },
    files::output,
    scene::PinholeCamera,
};
use multiscopic_core::capture::Plan;

use super::{
    capture_options::{LimitsOptions, SequenceOptions, SettingsOptions},
    layout_options::LayoutOptions,
    long_baseline::LongBaseline,
    recorder::Recorder,
};
use crate::command::options::{SearchOptions, value::positive};

/// How much longer than the camera the sequence waits for a frame: the camera's own error says more about the cause.
const CAMERA_FIRST: Duration = Duration::from_secs(3);

/// What `--camera` calls a camera without hardware.
const SIMULATED: &str = "sim";
/// Width and height of its frames.
const SIMULATED_SIZE: [u32; 2] = [640, 480];

/// Captures the frames of a rig: a stage moves a camera to the centre and to its neighbours
///
/// The folder appears once all frames are taken. When the command ends, for whatever reason, the stage stands still.
/// Ctrl-C returns it to the centre; a second Ctrl-C stops it where it is.
#[derive(Clone, Debug, Args)]
pub struct Capture {
    /// V4L2 camera, as listed by `multiscopic devices`, or a simulated one that sees the scene of the demo and needs --stage sim
    #[arg(long, value_name = "/dev/videoN|sim")]
    camera: PathBuf,

    /// What moves the camera in its image plane: a Universal Robots arm, a machine that runs Grbl or Marlin, you, or nothing real
    #[arg(long, value_name = "ur10:HOST[:PORT[,RTDE_PORT]]|gcode:TTY[@BAUD]|manual|sim")]
    stage: StageSpec,

    /// Folder for the frames, rig.toml and capture.log; with --live it holds folders 0001, 0002, and so on
    #[arg(short, long, value_name = "RIG_DIR")]
    output: PathBuf,

    /// Capture repeatedly until Ctrl-C
    #[arg(long)]
    live: bool,

    /// Number of captures with --live [default: no limit]
    #[arg(long, value_name = "N", requires = "live")]
    count: Option<NonZeroU32>,

    /// The camera's focal length in pixels, recorded in rig.toml; depth needs it [default: that of the simulated camera]
    #[arg(long, value_name = "PX", value_parser = positive, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    #[command(flatten)]
    layout: LayoutOptions,

    #[command(flatten)]
    search: SearchOptions,

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
        let limits = self.limits.limits()?;
        if !self.live {
            output::check_folder(&self.output)?;
        }
        let interrupts = Arc::new(AtomicUsize::new(0));
        count_interrupts(&interrupts)?;
        let settings = self.settings.settings();
        if self.camera.as_os_str() == SIMULATED {
            if self.stage != StageSpec::Simulated {
                let message = format!("--camera sim sees where --stage sim is, not where {} is: give both", self.stage);
                return Err(Error::Usage(message));
            }
            let stage = SimulatedStage::new(&limits)?;
            let [width, height] = settings.size.unwrap_or(SIMULATED_SIZE);
            let lens = PinholeCamera::new(width, height);
            let camera = SimulatedCamera::new(lens, stage.place());
            let recorder = self.recorder(&limits, camera.to_string(), self.focal_px.or(Some(lens.focal_px)), &interrupts)?;
            self.record(&recorder, AnyStage::new(stage), move || Ok(camera.clone()))
        } else {
            // Opened once up front, so that a faulty camera is found before anything moves.
            let camera_name = V4l2Camera::open(&self.camera, &settings)?.to_string();
            let recorder = self.recorder(&limits, camera_name, self.focal_px, &interrupts)?;
            let path = self.camera.clone();
            self.record(&recorder, stage::open(&self.stage, &limits)?, move || V4l2Camera::open(&path, &settings))
        }
    }

    fn recorder<'a>(
        &self,
        limits: &Limits,
        camera_name: String,
        focal_px: Option<f64>,
        interrupts: &'a AtomicUsize,
    ) -> Result<Recorder<'a>> {
        let policy = self.sequence.policy(&self.stage, self.settings.frame_timeout()? + CAMERA_FIRST)?;
        let long_baseline = match (self.layout.accuracy, focal_px) {
            (None, _) => None,
            (Some(accuracy), None) => {
                let message = format!("--accuracy {accuracy} needs the focal length in pixels: give --focal-px");
                return Err(Error::Usage(message));
            }
            (Some(accuracy), Some(_)) => {
                let (search, engine) = (self.search.clone(), Engine::new(None, 0)?);
                Some(LongBaseline { accuracy, search, engine, reach_um: limits.reach_um })
            }
        };
        let baseline_um = self.layout.baseline_um()?;
        Ok(Recorder {
            plan: Plan::new(self.layout.views()?, baseline_um).shortened(policy.backlash_um),
            policy,
            limits: *limits,
            baseline_um,
            long_baseline,
            focal_px,
            camera_name,
            stage_name: self.stage.to_string(),
            interrupts,
        })
    }

    /// Takes one capture, or with `--live` one after the other.
    fn record<C>(
        &self,
        recorder: &Recorder,
        mut stage: AnyStage,
        open: impl Fn() -> result::Result<C, C::Error> + Send + Sync + 'static,
    ) -> Result<ExitCode>
    where
        C: BlockingCamera<Error: error::Error + Send + Sync + 'static> + 'static,
    {
        let mut camera = ThreadedCamera::new(open, self.settings.frame_timeout()?);
        if self.live {
            self.run_live(recorder, &mut stage, &mut camera)?;
        } else {
            recorder.record(&mut stage, &mut camera, &self.output)?;
        }
        Ok(ExitCode::SUCCESS)
    }

    /// Records captures in numbered folders until there are enough or the user interrupts.
    fn run_live<C>(&self, recorder: &Recorder, stage: &mut AnyStage, camera: &mut ThreadedCamera<C>) -> Result<()>
    where
        C: BlockingCamera<Error: error::Error + Send + Sync + 'static> + 'static,
    {
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
