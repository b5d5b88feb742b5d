//! `multiscopic capture`: a stage moves a camera, and the frames are written to a folder with a `rig.toml`.

mod capture_log;
mod layout_options;
mod long_baseline;
mod recorder;

use std::{
    fs,
    num::NonZeroU32,
    path::{Path, PathBuf},
    process::ExitCode,
    sync::atomic::Ordering,
};

use clap::Args;
use multiscopic::{
    Engine, Error, Result,
    capture::{
        SimulatedCamera,
        stage::{AnyStage, TurnedStage},
    },
    files::output,
    lens::Mount,
};
use multiscopic_core::capture::Plan;

use self::{layout_options::LayoutOptions, long_baseline::LongBaseline, recorder::Recorder};
use super::{
    hardware::Hardware,
    options::{HardwareOptions, LensFile, SearchOptions, output_file, value::positive},
    view::View,
};

/// Captures the frames of a rig: a stage moves a camera to the centre and to its neighbours
///
/// The folder appears once all frames are taken. When the command ends, for whatever reason, the stage stands still.
/// Ctrl-C returns it to the centre; a second Ctrl-C stops it where it is.
#[derive(Clone, Debug, Args)]
pub struct Capture {
    #[command(flatten)]
    hardware: HardwareOptions,

    /// Folder for the frames, rig.toml and capture.log; with --live it holds folders 0001, 0002, and so on
    #[arg(short, long, value_name = "RIG_DIR")]
    output: PathBuf,

    /// Capture repeatedly until Ctrl-C
    #[arg(long)]
    live: bool,

    /// Page to look at the capture, matched by blocks, see `multiscopic view`
    #[arg(long, value_name = "FILE.html", conflicts_with = "live", value_parser = output_file::html)]
    report: Option<PathBuf>,

    /// Number of captures with --live [default: no limit]
    #[arg(long, value_name = "N", requires = "live")]
    count: Option<NonZeroU32>,

    /// The camera's focal length in pixels, recorded in rig.toml; depth needs it [default: that of --lens, --mount, or what a
    /// simulated camera is sold as]
    #[arg(long, value_name = "PX", value_parser = positive, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    /// Calibration of the camera's lens, which distorts the images: a camera.toml, or the YAML of ROS, OpenCV or Kalibr. A copy
    /// is kept beside rig.toml, and `match` undistorts the images by it
    #[arg(long, value_name = "FILE")]
    lens: Option<PathBuf>,

    /// How the camera is turned against the stage, as `multiscopic calibrate mount` finds it. A turn about the optical axis is
    /// taken out by moving along the camera's own rows and columns. What remains is recorded in rig.toml, and `match` rectifies
    /// the images by it
    #[arg(long, value_name = "MOUNT.toml")]
    mount: Option<PathBuf>,

    #[command(flatten)]
    layout: LayoutOptions,

    #[command(flatten)]
    search: SearchOptions,
}

impl Capture {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        if !self.live {
            output::check_folder(&self.output)?;
        }
        // A page in the folder can be written once the folder is there.
        if let Some(page) = self.report.as_deref().filter(|page| !page.starts_with(&self.output)) {
            output::check(&[page], &[])?;
        }
        let lens = self.lens.as_deref().map(LensFile::read).transpose()?;
        let mount = self.mount.as_deref().map(Mount::read).transpose()?;
        let mut recorder = self.recorder(Hardware::open(&self.hardware)?, lens, mount)?;
        if self.live {
            self.run_live(&mut recorder)?;
        } else {
            recorder.record(&self.output)?;
            if let Some(page) = &self.report {
                View::of_capture(&self.output, page, &self.search).run()?;
            }
        }
        Ok(ExitCode::SUCCESS)
    }

    fn recorder(&self, mut hardware: Hardware, lens: Option<LensFile>, mount: Option<Mount>) -> Result<Recorder> {
        if let Some(lens) = &lens {
            lens.camera.check_size(&lens.path, hardware.size.map(|side| side as usize))?;
            lens.check_focal(self.focal_px, "--focal-px")?;
        }
        let simulated = hardware.simulated.as_ref().map(SimulatedCamera::nominal_focal_px);
        let focal_px =
            self.focal_px.or(lens.as_ref().map(LensFile::focal_px)).or(mount.and_then(|mount| mount.focal_px)).or(simulated);
        let mount_rotation_deg = match (mount, &self.mount) {
            (Some(_), Some(path)) if focal_px.is_none() => {
                let path = path.display();
                return Err(Error::Usage(format!(
                    "{path} has no focal length, without which images are not rectified: give --focal-px or --lens"
                )));
            }
            (Some(mount), _) => {
                let (roll, rest) = mount.split_roll();
                hardware.stage = AnyStage::new(TurnedStage::new(hardware.stage, roll));
                Some(rest.rotation_deg)
            }
            (None, _) => None,
        };
        let long_baseline = match (self.layout.accuracy, focal_px) {
            (None, _) => None,
            (Some(accuracy), None) => {
                let message = format!("--accuracy {accuracy} needs the focal length in pixels: give --focal-px or --lens");
                return Err(Error::Usage(message));
            }
            (Some(accuracy), Some(_)) => {
                let (search, engine) = (self.search.clone(), Engine::new(None, 0)?);
                Some(LongBaseline { accuracy, search, engine, reach_um: hardware.limits.reach_um })
            }
        };
        let baseline_um = self.layout.baseline_um()?;
        let plan = Plan::new(self.layout.views()?, baseline_um).shortened(hardware.policy.backlash_um);
        Ok(Recorder { plan, baseline_um, long_baseline, focal_px, lens, mount_rotation_deg, hardware })
    }

    /// Records captures in numbered folders until there are enough or the user interrupts.
    fn run_live(&self, recorder: &mut Recorder) -> Result<()> {
        fs::create_dir_all(&self.output).map_err(|source| Error::Write { path: self.output.clone(), source })?;
        let mut folders = free_folders(&self.output);
        for _ in 0..self.count.map_or(u32::MAX, NonZeroU32::get) {
            if recorder.hardware.interrupts.load(Ordering::Relaxed) > 0 {
                break;
            }
            let Some(folder) = folders.next() else {
                return Err(Error::Usage(format!("{} is full, give another folder", self.output.display())));
            };
            recorder.record(&folder)?;
        }
        Ok(())
    }
}

/// Folders 0001 to 9999 within `parent`, without those that exist.
fn free_folders(parent: &Path) -> impl Iterator<Item = PathBuf> {
    (1..=9999).map(move |number| parent.join(format!("{number:04}"))).filter(|folder| !folder.exists())
}
