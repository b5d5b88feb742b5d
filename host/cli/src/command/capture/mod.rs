//! `multiscopic capture`: a stage moves a camera, and the frames are written to a folder with a `rig.toml`.

#[cfg(feature = "live")]
mod live_recording;
mod long_baseline;
mod recorder;
mod sweep;
mod until;

use std::{
    fs,
    num::NonZeroU32,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::{Arc, atomic::Ordering},
};

use clap::Args;
use multiscopic::{
    Engine, Error, Result,
    capture::{
        Accuracy, Clock, RigParts, SimulatedCamera, SystemClock,
        stage::{AnyStage, TurnedStage},
    },
    files::output,
    lens::{HandEye, LensFile, Mount},
    stereo::next_view::Goal,
};
use multiscopic_core::{View, Views, capture::Plan};

#[cfg(feature = "live")]
use self::live_recording::LiveRecording;
pub use self::recorder::{Recorded, Recorder};
use self::{
    long_baseline::{LongBaseline, at_multiple},
    recorder::Extension,
    until::Until,
};
#[cfg(feature = "live")]
use super::foxglove::FoxgloveOptions;
use super::{
    hardware::Hardware,
    options::{
        HardwareOptions, NeighborOptions, SearchOptions, output_file, read_lens,
        value::{micrometres, positive},
    },
    terminal, view,
};

/// Captures the frames of a rig: a stage moves a camera to the centre and to its neighbours
///
/// The folder appears once all frames are taken. When the command ends, for whatever reason, the stage stands still.
/// Ctrl-C returns it to the centre; a second Ctrl-C stops it where it is.
#[derive(Clone, Debug, Args)]
pub struct Capture {
    #[command(flatten)]
    recorder: RecorderOptions,

    /// Folder for the frames, rig.toml and capture.log; with --live it holds folders 0001, 0002, and so on
    #[arg(short, long, value_name = "RIG_DIR")]
    output: PathBuf,

    /// Capture repeatedly until Ctrl-C
    #[arg(long, conflicts_with_all = ["accuracy", "until", "sweep"])]
    live: bool,

    /// Page to look at the capture, matched by blocks, see `multiscopic view`
    #[arg(long, value_name = "FILE.html", conflicts_with_all = ["live", "sweep"], value_parser = output_file::html())]
    report: Option<PathBuf>,

    /// Number of captures with --live [default: no limit]
    #[arg(long, value_name = "N", requires = "live")]
    count: Option<NonZeroU32>,

    /// With --live, a recording for ROS 2 and Foxglove, or a pipe: depth, disparities and the other topics of `match --mcap` of
    /// each capture, matched by blocks as soon as it is taken; needs the focal length
    #[cfg(feature = "live")]
    #[arg(long, value_name = "OUT.mcap", requires = "live", value_parser = output_file::mcap())]
    mcap: Option<PathBuf>,

    #[cfg(feature = "live")]
    #[command(flatten)]
    foxglove: FoxgloveOptions,

    /// Print what was captured as a JSON object on standard output, one a line with --live
    #[arg(long)]
    json: bool,
}

impl Capture {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        if !self.live {
            #[cfg(feature = "live")]
            if self.foxglove.is_given() {
                return Err(Error::Usage("--foxglove publishes captures as they come: give --live as well".into()));
            }
            output::check_folder(&self.output)?;
        }
        // A page in the folder can be written once the folder is there.
        if let Some(page) = self.report.as_deref().filter(|page| !page.starts_with(&self.output)) {
            output::check(&[page], &[])?;
        }
        if let Some(length_mm) = self.recorder.layout.sweep {
            return self.sweep(length_mm);
        }
        let mut recorder = self.recorder.recorder()?;
        if self.live {
            self.run_live(&mut recorder)?;
            return Ok(ExitCode::SUCCESS);
        }
        let recorded = self.record(&mut recorder, &self.output)?;
        if let Some(page) = &self.report {
            view::View::of_capture(&self.output, page, &self.recorder.search).run()?;
        }
        Ok(ExitCode::from(if recorded.is_accurate == Some(false) { 1 } else { 0 }))
    }

    /// Takes a capture and reports it.
    fn record(&self, recorder: &mut Recorder, folder: &Path) -> Result<Recorded> {
        let recorded = recorder.record(folder, &mut |_, _, _| ())?;
        if self.json {
            terminal::print_report(&recorded, true)?;
        }
        Ok(recorded)
    }

    /// Records captures in numbered folders, and what is found of them, if that is asked for.
    fn run_live(&self, recorder: &mut Recorder) -> Result<()> {
        #[cfg(feature = "live")]
        if self.mcap.is_some() || self.foxglove.is_given() {
            output::check(&self.mcap.iter().map(PathBuf::as_path).collect::<Vec<_>>(), &[])?;
            let live = LiveRecording::new(recorder, &self.recorder.search, &self.foxglove)?;
            return live.run(self.mcap.as_deref(), |found| self.run_captures(recorder, found));
        }
        self.run_captures(recorder, &mut |_| Ok(()))
    }

    /// Records captures in numbered folders until there are enough or the user interrupts. `done` is told each folder.
    fn run_captures(&self, recorder: &mut Recorder, done: &mut dyn FnMut(&Path) -> Result<()>) -> Result<()> {
        fs::create_dir_all(&self.output).map_err(|source| Error::Write { path: self.output.clone(), source })?;
        let mut folders = free_folders(&self.output);
        for _ in 0..self.count.map_or(u32::MAX, NonZeroU32::get) {
            if recorder.hardware.interrupts.load(Ordering::Relaxed) > 0 {
                break;
            }
            let Some(folder) = folders.next() else {
                return Err(Error::Usage(format!("{} is full, give another folder", self.output.display())));
            };
            self.record(recorder, &folder)?;
            done(&folder)?;
        }
        Ok(())
    }
}

/// Folders 0001 to 9999 within `parent`, without those that exist.
pub fn free_folders(parent: &Path) -> impl Iterator<Item = PathBuf> {
    (1..=9999).map(move |number| parent.join(format!("{number:04}"))).filter(|folder| !folder.exists())
}

/// The hardware, and which frames it takes.
#[derive(Clone, Debug, Args)]
pub struct RecorderOptions {
    #[command(flatten)]
    hardware: HardwareOptions,

    /// The camera's focal length in pixels, recorded in rig.toml; depth needs it [default: that of --lens, --mount, or what a
    /// simulated camera is sold as]
    #[arg(long, value_name = "PX", value_parser = positive, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    /// Calibration of the camera's lens, which distorts the images: a camera.toml, or a file of ROS, OpenCV or Kalibr. A copy
    /// is kept beside rig.toml, and `match` undistorts the images by it
    #[arg(long, value_name = "FILE")]
    lens: Option<PathBuf>,

    /// Rotation of the camera against the stage, as `multiscopic calibrate mount` finds it. A turn about the optical axis is
    /// taken out by moving along the camera's own rows and columns. What remains is recorded in rig.toml, and `match` rectifies
    /// the images by it
    #[arg(long, value_name = "MOUNT.toml")]
    mount: Option<PathBuf>,

    /// Place of the camera on the tool of an arm, as `multiscopic calibrate hand-eye` finds it, instead of --mount. A copy is kept
    /// beside rig.toml, and `match --frame` gives points in the frame of the tool or of the arm's base
    #[arg(long, value_name = "FILE.toml", conflicts_with = "mount")]
    hand_eye: Option<PathBuf>,

    #[command(flatten)]
    layout: LayoutOptions,

    #[command(flatten)]
    search: SearchOptions,
}

impl RecorderOptions {
    /// Reads the files, and opens the camera and the stage.
    ///
    /// From then on, Ctrl-C no longer ends the program.
    pub fn recorder(&self) -> Result<Recorder> {
        if self.layout.sweep.is_some() {
            return Err(Error::Usage("--sweep is for `multiscopic capture`".into()));
        }
        let baseline_um = self.layout.baseline_um()?;
        let recorder = self.bare_recorder(baseline_um, Arc::new(SystemClock))?;
        self.with_layout(recorder)
    }

    /// A recorder that takes the centre alone.
    fn bare_recorder(&self, baseline_um: u32, clock: Arc<dyn Clock>) -> Result<Recorder> {
        let lens = self.lens.as_deref().map(read_lens).transpose()?;
        let hand_eye = self.hand_eye.as_deref().map(HandEye::read).transpose()?;
        let mount = self.mount.as_deref().map(Mount::read).transpose()?.or(hand_eye.map(|hand_eye| hand_eye.mount()));
        let mut hardware = Hardware::open_with_clock(&self.hardware, clock)?;
        if let Some(lens) = &lens {
            lens.camera.check_size(&lens.path, hardware.size.map(|side| side as usize))?;
            lens.check_focal(self.focal_px, "--focal-px")?;
        }
        let simulated = hardware.simulated.as_ref().map(SimulatedCamera::nominal_focal_px);
        let focal_px =
            self.focal_px.or(lens.as_ref().map(LensFile::focal_px)).or(mount.and_then(|mount| mount.focal_px)).or(simulated);
        if let (Some(mount), Some(path)) = (mount, self.mount.as_ref().or(self.hand_eye.as_ref())) {
            if focal_px.is_none() {
                let path = path.display();
                return Err(Error::Usage(format!(
                    "{path} has no focal length, without which images are not rectified: give --focal-px or --lens"
                )));
            }
            hardware.stage = AnyStage::new(TurnedStage::new(hardware.stage, mount.split_roll().0));
        }
        let plan = Plan::new(Views::NONE, baseline_um);
        let (camera_name, stage_name) = (hardware.camera_name.clone(), hardware.stage_name.clone());
        let parts = RigParts { camera_name, stage_name, baseline_um, focal_px, lens, mount, hand_eye };
        Ok(Recorder { plan, extension: None, parts, hardware })
    }

    /// The recorder with the frames that are asked for.
    fn with_layout(&self, recorder: Recorder) -> Result<Recorder> {
        let Recorder { parts: RigParts { baseline_um, focal_px, .. }, ref hardware, .. } = recorder;
        let asked = self.layout.accuracy.map(|accuracy| format!("--accuracy {accuracy}"));
        let asked = asked.or(self.layout.until.map(|goal| format!("--until \"{goal}\"")));
        if let (Some(option), None) = (&asked, focal_px) {
            return Err(Error::Usage(format!("{option} needs the focal length in pixels: give --focal-px or --lens")));
        }
        let mut views = self.layout.views()?;
        let (search, reach_um) = (self.search.clone(), hardware.limits.reach_um);
        let extension = match (self.layout.accuracy, self.layout.until) {
            (Some(accuracy), _) => {
                Some(Extension::Accuracy(LongBaseline { accuracy, search, engine: Engine::new(None, 0)?, reach_um }))
            }
            (None, Some(goal)) => {
                let (nearest, most_views) = (at_multiple(views, 1), self.layout.most_views.into());
                let until = Until { goal, most_views, nearest, search, engine: Engine::new(None, 0)?, baseline_um, reach_um };
                views = until.first();
                Some(Extension::Until(until))
            }
            (None, None) => None,
        };
        let plan = Plan::new(views, baseline_um).shortened(hardware.policy.backlash_um);
        Ok(Recorder { plan, extension, ..recorder })
    }
}

/// The places where frames are taken.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Layout")]
struct LayoutOptions {
    /// Distance from the centre to each neighbour, in millimetres
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true, required_unless_present_any = ["baselines", "sweep"])]
    baseline: Option<f64>,

    /// Several baselines in millimetres, such as 5,20,80: whole multiples of the first, up to 16. At the first one the whole
    /// layout is taken, at the others the views in the centre's row and column; `match` goes from short to long
    #[arg(
        long,
        value_name = "MM,MM",
        value_parser = positive,
        allow_negative_numbers = true,
        value_delimiter = ',',
        conflicts_with = "baseline"
    )]
    baselines: Vec<f64>,

    #[command(flatten)]
    neighbors: NeighborOptions,

    /// Depth accuracy in millimetres out to a distance in millimetres, such as 0.5@600: the frames are matched, and if they are
    /// not accurate enough, views at a longer baseline that gives it are taken as well; needs the focal length. Exits with 1 if
    /// it is not reached
    #[arg(long, value_name = "MM@DISTANCE", conflicts_with = "baselines")]
    accuracy: Option<Accuracy>,

    /// Share of the pixels whose depth is to be within a length of the truth, with 95 % certainty, such as "80 % within 2 mm": one
    /// neighbour is taken and matched by `net`, and then each view that helps most, in the directions of --views at any whole
    /// multiple of the baseline, until it is so or nothing helps; needs the focal length. Exits with 1 if it is not reached
    #[arg(long, value_name = "SHARE % within MM mm", conflicts_with_all = ["baselines", "accuracy"])]
    until: Option<Goal>,

    /// Frames without stopping: the stage slides the camera at --speed from half this length in millimetres to the left of the centre
    /// to as far right, and back, while the camera runs free. The images tell the delay between them
    #[arg(
        long,
        value_name = "MM",
        value_parser = positive,
        allow_negative_numbers = true,
        conflicts_with_all = [
            "baseline", "baselines", "views", "layout", "accuracy", "until", "average", "retries", "tolerance", "backlash",
            "min_disparity", "num_disparities", "block_size"
        ]
    )]
    sweep: Option<f64>,

    /// Most neighbours that --until takes
    #[arg(long, value_name = "N", default_value_t = 12, requires = "until", value_parser = clap::value_parser!(u8).range(1..=Views::MAX as i64))]
    most_views: u8,
}

impl LayoutOptions {
    /// The shortest baseline in millimetres.
    fn baseline_mm(&self) -> f64 {
        self.baseline.or(self.baselines.first().copied()).unwrap_or_default()
    }

    /// The shortest baseline in micrometres.
    fn baseline_um(&self) -> Result<u32> {
        micrometres(if self.baselines.is_empty() { "--baseline" } else { "--baselines" }, self.baseline_mm())
    }

    /// The neighbours at the shortest baseline.
    fn nearest(&self) -> Result<Views> {
        self.neighbors.views()
    }

    /// All neighbours, at all baselines.
    fn views(&self) -> Result<Views> {
        let (nearest, baseline_um) = (self.nearest()?, self.baseline_um()?);
        let mut views: Vec<View> = nearest.iter().collect();
        for baseline in self.baselines.iter().skip(1) {
            let um = micrometres("--baselines", *baseline)?;
            let multiple = um / baseline_um;
            if !um.is_multiple_of(baseline_um) || !(2..=View::MAX_OFFSET as u32).contains(&multiple) {
                return Err(Error::Usage(format!(
                    "--baselines includes {baseline} mm, it must be a whole multiple of the first, {} mm, from 2 to {}",
                    self.baseline_mm(),
                    View::MAX_OFFSET
                )));
            }
            views.extend(at_multiple(nearest, multiple as u8).iter());
        }
        let (count, views) = (views.len(), views.into_iter().collect::<Views>());
        match views.len() == count {
            true => Ok(views),
            false => Err(Error::Usage(format!(
                "there are {count} views, some of them at the same place or more than {}: choose fewer, or longer baselines",
                Views::MAX
            ))),
        }
    }
}
