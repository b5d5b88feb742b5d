//! `multiscopic calibrate`: what a rig's camera and its motion are.

#[cfg(feature = "calibration")]
mod board;
#[cfg(feature = "calibration")]
mod camera_session;
#[cfg(feature = "calibration")]
mod hand_eye;
#[cfg(feature = "calibration")]
mod lens;

use std::{path::PathBuf, process::ExitCode};

use clap::{Args, Subcommand};
use multiscopic::{
    Error, Frames, Geometry, Result,
    alignment::Mounting,
    capture::acquire_images,
    files::output,
    lens::{LensFile, Mount},
};
use multiscopic_core::{View, Views, capture::Plan};

use super::{
    hardware::Hardware,
    options::{
        HardwareOptions, read_lens,
        value::{micrometres, positive},
    },
    terminal,
};

/// Calibrates the camera's lens, how it is mounted on the stage, and where it sits on the tool of an arm
#[derive(Clone, Debug, Args)]
pub struct Calibrate {
    #[command(subcommand)]
    subject: Subject,
}

#[derive(Clone, Debug, Subcommand)]
enum Subject {
    #[cfg(feature = "calibration")]
    Board(board::Board),
    #[cfg(feature = "calibration")]
    Lens(lens::LensCommand),
    #[cfg(feature = "calibration")]
    HandEye(hand_eye::HandEyeCommand),
    Mount(Box<MountCommand>),
}

impl Calibrate {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        match &self.subject {
            #[cfg(feature = "calibration")]
            Subject::Board(command) => command.run(),
            #[cfg(feature = "calibration")]
            Subject::Lens(command) => command.run(),
            #[cfg(feature = "calibration")]
            Subject::HandEye(command) => command.run(),
            Subject::Mount(command) => command.run(),
        }
    }
}

/// The focal length of a usual camera, in units of the image's larger side.
const USUAL_FOCAL: f64 = 1.2;
/// The lengths of the moves, in steps.
const MULTIPLES: [u8; 2] = [1, 2];
/// The ratio of a focal length to that of the stage's moves from which on they contradict each other.
const CONTRADICTION: f64 = 1.02;

/// Finds how the camera is turned against the stage: it moves one and two steps to all sides and tracks what the camera sees
///
/// Let the camera see a scene with texture everywhere. The file that is written serves `capture --mount`. The angles about the
/// axes to the right and down need the focal length: give the lens, or the focal length, or put a flat target in the middle of
/// the image and give its distance.
#[derive(Clone, Debug, Args)]
struct MountCommand {
    #[command(flatten)]
    hardware: HardwareOptions,

    /// Length of a step in millimetres: two steps should shift the scene by 20 pixels and more, but not by a quarter of the image
    #[arg(long, value_name = "MM", default_value_t = 10.0, value_parser = positive, allow_negative_numbers = true)]
    step: f64,

    /// Calibration of the camera's lens: a camera.toml, or a file of ROS, OpenCV or Kalibr
    #[arg(long, value_name = "FILE", conflicts_with = "focal_px")]
    lens: Option<PathBuf>,

    /// The camera's focal length in pixels
    #[arg(long, value_name = "PX", value_parser = positive, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    /// Distance in millimetres from the camera to a flat target in the middle of the image. It gives the focal length, or tests
    /// it
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true)]
    distance: Option<f64>,

    /// File for the mount
    #[arg(short, long, value_name = "MOUNT.toml", default_value = "mount.toml")]
    output: PathBuf,
}

impl MountCommand {
    /// Runs the command.
    fn run(&self) -> Result<ExitCode> {
        if self.lens.is_none() && self.focal_px.is_none() && self.distance.is_none() {
            let message = "the angles need the focal length: give --lens, or --focal-px, or the --distance of a flat target";
            return Err(Error::Usage(message.into()));
        }
        output::check(&[&self.output], &self.lens.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
        let lens = self.lens.as_deref().map(read_lens).transpose()?;
        let (frames, failure) = self.frames(&lens)?;
        let known_px = lens.as_ref().map(LensFile::focal_px).or(self.focal_px);
        let middle = frames.size().map(|side| (side as f64 - 1.0) / 2.0);
        let geometry = Geometry {
            focal_px: known_px.unwrap_or(USUAL_FOCAL * frames.size().into_iter().max().unwrap_or_default() as f64),
            baseline_mm: self.step,
            principal_point: lens.as_ref().map_or(middle, |lens| lens.camera.principal_point),
            doffs: 0.0,
        };
        let mut mounting = Mounting::estimate(&frames, &geometry)?;
        let measured = self.distance.map(|distance| mounting.focal_px(distance)).transpose()?;
        let focal_px = match (known_px, measured) {
            (None, Some([focal_px, _])) => {
                mounting = Mounting::estimate(&frames, &Geometry { focal_px, ..geometry })?;
                focal_px
            }
            _ => geometry.focal_px,
        };
        let mount = mounting.mount(focal_px);
        mount.save(&self.output)?;
        self.report(&mounting, &mount, known_px, measured);
        failure.map_or(Ok(ExitCode::SUCCESS), Err)
    }

    /// Takes the frames, without distortion, and what failed after the last of them.
    fn frames(&self, lens: &Option<LensFile>) -> Result<(Frames, Option<Error>)> {
        let mut hardware = Hardware::open(&self.hardware)?;
        let undistortion = lens.as_ref().map(|lens| lens.undistortion(hardware.size.map(|side| side as usize))).transpose()?;
        let views: Views =
            MULTIPLES.iter().flat_map(|&n| View::CROSS.into_iter().filter_map(move |view| view.times(n))).collect();
        let plan = Plan::new(views, micrometres("--step", self.step)?).shortened(hardware.policy.backlash_um);
        let bar = terminal::progress(plan.frames().len() as u64, "frames");
        let Hardware { stage, camera, policy, interrupts, .. } = &mut hardware;
        let taken = acquire_images(stage, camera, &plan, *policy, interrupts, |_, _| ());
        bar.finish_and_clear();
        hardware.warn_of_unlocked();
        let mut taken = taken?;
        let failure = taken.failure.take();
        let frames = taken.frames().without_color();
        Ok((undistortion.map_or_else(|| frames.clone(), |undistortion| undistortion.frames(&frames)), failure))
    }

    fn report(&self, mounting: &Mounting, mount: &Mount, known_px: Option<f64>, measured: Option<[f64; 2]>) {
        let Mounting { rotation_deg: [right, down, ahead], deviation_deg: [d_right, d_down, d_ahead], .. } = mounting;
        let Mounting { points, parallax_px, noise_px, .. } = mounting;
        terminal::say(&format!(
            "tracked {points} points, which the longest moves shift by {parallax_px:.1} pixels, with an error of {noise_px:.2}"
        ));
        terminal::say(&format!(
            "camera against stage: {right:+.2} +- {d_right:.2} deg about the axis to the right, {down:+.2} +- {d_down:.2} down, \
             {ahead:+.2} +- {d_ahead:.2} ahead"
        ));
        if let Some([focal_px, deviation]) = measured {
            terminal::say(&format!("focal length by the moves and the distance: {focal_px:.1} +- {deviation:.1} pixels"));
        }
        if let (Some(known), Some([found, _])) = (known_px, measured)
            && known.max(found) / known.min(found) > CONTRADICTION
        {
            terminal::say(&format!(
                "warning: that contradicts the {known:.1} pixels that were given: check the distance, and that the stage moves by \
                 millimetres; depth will be off by {:.1} %",
                100.0 * (found / known - 1.0).abs()
            ));
        }
        let distance = mounting.distance_mm(mount.focal_px.unwrap_or_default());
        if measured.is_none() && distance.is_finite() {
            terminal::say(&format!(
                "what the middle of the image shows seems to be {distance:.0} mm away; if it is not, check the focal length and the stage"
            ));
        }
        terminal::say(&format!("wrote {}", self.output.display()));
    }
}
