//! `multiscopic capture`: a stage moves a camera, and the frames become a folder.

use std::{
    fmt::Write as _,
    fs,
    num::{NonZeroU16, NonZeroU32},
    path::{Path, PathBuf},
    process::ExitCode,
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use clap::Args;
use jiff::Zoned;
use multiscopic::{
    Error, Frames, Result, Rig,
    capture::{
        ThreadedCamera, acquire_frames,
        camera::{CameraSettings, PixelFormat, V4l2Camera},
        stage::{self, AnyStage, Limits, StageSpec},
    },
    files::{FrameFiles, Provenance, output},
};
use multiscopic_core::{
    Frame,
    capture::{Plan, Policy, Progress},
};

use crate::command::{
    options::{value::positive, views_of_count},
    terminal,
};

/// How far before each position the approach to it begins on a machine with screws or belts, in micrometres.
const PLAY_UM: u32 = 500;

/// Takes the frames of a rig: a stage moves a camera to the centre and to its neighbours
///
/// The folder is there once all frames are; whatever happens, the stage does not move any more when the command ends. Ctrl-C brings it back
/// to the centre, a second one stops it where it is.
#[derive(Clone, Debug, Args)]
pub struct Capture {
    /// Camera, as `multiscopic devices` lists it
    #[arg(long, value_name = "/dev/videoN")]
    camera: PathBuf,

    /// What moves it, in its image plane: an arm of Universal Robots, a machine with Grbl or Marlin, or you
    #[arg(long, value_name = "ur10:HOST[:PORT[,RTDE_PORT]]|gcode:TTY[@BAUD]|manual")]
    stage: StageSpec,

    /// From the centre to each neighbour, in millimetres
    #[arg(long, value_name = "MM", value_parser = positive, allow_negative_numbers = true)]
    baseline: f64,

    /// Neighbours: right (1), left and right (2), top too (3), or all (4)
    #[arg(long, value_name = "1|2|3|4", default_value_t = 4)]
    views: usize,

    /// Folder for the frames, rig.toml and capture.log; with --live for folders 0001, 0002, and so on
    #[arg(short, long, value_name = "RIG_DIR")]
    output: PathBuf,

    /// Capture again and again, until Ctrl-C
    #[arg(long)]
    live: bool,

    /// Captures of --live [default: no end]
    #[arg(long, value_name = "N", requires = "live")]
    count: Option<NonZeroU32>,

    /// The camera's focal length in pixels, for rig.toml: without, there is no depth
    #[arg(long, value_name = "PX", value_parser = positive, allow_negative_numbers = true)]
    focal_px: Option<f64>,

    #[command(flatten)]
    settings: SettingsOptions,

    #[command(flatten)]
    policy: PolicyOptions,

    #[command(flatten)]
    limits: LimitsOptions,
}

/// How the camera is set.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Camera")]
struct SettingsOptions {
    /// Pixel format, as `multiscopic devices` lists it [default: the best that the camera has]
    #[arg(long, value_parser = pixel_format)]
    format: Option<PixelFormat>,

    /// Width and height in pixels [default: as the camera is set]
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,

    /// Frames whose mean is taken
    #[arg(long, value_name = "N", default_value_t = NonZeroU16::MIN)]
    average: NonZeroU16,

    /// Frames that are dropped when the camera starts, and again when it is locked
    #[arg(long, value_name = "N", default_value_t = CameraSettings::default().warm_up)]
    warm_up: u16,

    /// Leave exposure, gain, focus and white balance to the camera, for every frame anew
    #[arg(long)]
    no_lock: bool,

    /// Exposure time in units of 100 us [default: what the camera finds]
    #[arg(long, value_name = "N")]
    exposure: Option<i32>,

    /// Gain in the camera's units [default: what the camera finds]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    gain: Option<i32>,

    /// Distance of focus in the camera's units [default: what the camera finds]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    focus: Option<i32>,

    /// Colour temperature in kelvins [default: what the camera finds]
    #[arg(long, value_name = "K")]
    white_balance: Option<i32>,

    /// How long a frame may take, warm-up included, in seconds
    #[arg(long, value_name = "S", default_value_t = Policy::default().frame_timeout.as_secs_f64(), value_parser = positive)]
    frame_timeout: f64,
}

/// How patient the capture is.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Sequence")]
struct PolicyOptions {
    /// How long vibrations take to fade, in seconds
    #[arg(long, value_name = "S", default_value_t = Policy::default().settle.as_secs_f64(), value_parser = duration)]
    settle: f64,

    /// How long a move may take, in seconds
    #[arg(long, value_name = "S", default_value_t = Policy::default().move_timeout.as_secs_f64(), value_parser = positive)]
    move_timeout: f64,

    /// How often a frame is taken again that did not come out, and a position approached again that was missed
    #[arg(long, value_name = "N", default_value_t = Policy::default().retries)]
    retries: u8,

    /// How far off the stage may measure to be, in micrometres
    #[arg(long, value_name = "UM", default_value_t = Policy::default().tolerance_um)]
    tolerance: u32,

    /// How far to the left of each position and above it the approach begins, in micrometres, so that play is taken up from the same side [default: 500 for
    /// gcode, 0 for others]
    #[arg(long, value_name = "UM")]
    backlash: Option<u32>,
}

/// How far and how fast the stage may go.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Stage")]
struct LimitsOptions {
    /// Speed in millimetres per second
    #[arg(long, value_name = "MM/S", default_value_t = Limits::default().speed_mm_s, value_parser = positive)]
    speed: f64,

    /// Acceleration in millimetres per second squared
    #[arg(long, value_name = "MM/S2", default_value_t = Limits::default().acceleration_mm_s2, value_parser = positive)]
    acceleration: f64,

    /// How far from where it is now it may go, in millimetres
    #[arg(long, value_name = "MM", default_value_t = f64::from(Limits::default().reach_um) / 1000.0, value_parser = positive)]
    reach: f64,
}

impl Capture {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let views = views_of_count(self.views)?;
        let plan = Plan::cross(views, micrometres("--baseline", self.baseline)?);
        let policy = self.policy()?;
        let camera_timeout = policy.frame_timeout;
        // The camera knows best what is wrong when it is late.
        let policy = Policy { frame_timeout: policy.frame_timeout + Duration::from_secs(3), ..policy };
        let limits = self.limits.limits()?;
        if !self.live {
            output::check_folder(&self.output)?;
        }
        let interrupts = Arc::new(AtomicUsize::new(0));
        let counted = interrupts.clone();
        ctrlc::set_handler(move || {
            counted.fetch_add(1, Ordering::Relaxed);
        })
        .map_err(|error| Error::Usage(format!("Ctrl-C cannot be watched, and the stage would not be stopped: {error}")))?;

        // Once by itself, so that what is wrong with the camera is known before anything moves.
        let description = V4l2Camera::open(&self.camera, &self.settings.settings())?.to_string();
        let mut stage = stage::open(&self.stage, &limits)?;
        let (path, settings) = (self.camera.clone(), self.settings.settings());
        let mut camera = ThreadedCamera::new(move || V4l2Camera::open(&path, &settings), camera_timeout);
        let mut session = Session { capture: self, plan, policy, description, interrupts: &interrupts };
        if !self.live {
            session.run(&mut stage, &mut camera, &self.output)?;
            return Ok(ExitCode::SUCCESS);
        }
        fs::create_dir_all(&self.output).map_err(|source| Error::Write { path: self.output.clone(), source })?;
        let mut left = self.count.map_or(u32::MAX, NonZeroU32::get);
        let mut folders = (1..=9999).map(|number| self.output.join(format!("{number:04}"))).filter(|folder| !folder.exists());
        while left > 0 && interrupts.load(Ordering::Relaxed) == 0 {
            let Some(folder) = folders.next() else {
                return Err(Error::Usage(format!("{} is full, give another folder", self.output.display())));
            };
            session.run(&mut stage, &mut camera, &folder)?;
            left -= 1;
        }
        Ok(ExitCode::SUCCESS)
    }

    fn policy(&self) -> Result<Policy> {
        let options = &self.policy;
        let backlash_um = match self.stage {
            StageSpec::Gcode { .. } => PLAY_UM,
            StageSpec::Ur10(_) | StageSpec::Manual => 0,
        };
        Ok(Policy {
            settle: Duration::from_secs_f64(options.settle),
            // A person may take as long as it takes.
            move_timeout: match self.stage {
                StageSpec::Manual => Duration::from_secs(24 * 3600),
                _ => seconds("--move-timeout", options.move_timeout)?,
            },
            frame_timeout: seconds("--frame-timeout", self.settings.frame_timeout)?,
            retries: options.retries,
            tolerance_um: options.tolerance,
            backlash_um: options.backlash.unwrap_or(backlash_um),
            return_to_center: true,
        })
    }
}

impl SettingsOptions {
    fn settings(&self) -> CameraSettings {
        CameraSettings {
            format: self.format,
            size: self.size,
            warm_up: self.warm_up,
            average: self.average,
            lock: !self.no_lock,
            exposure: self.exposure,
            gain: self.gain,
            focus: self.focus,
            white_balance: self.white_balance,
        }
    }
}

impl LimitsOptions {
    fn limits(&self) -> Result<Limits> {
        Ok(Limits {
            reach_um: micrometres("--reach", self.reach)?,
            speed_mm_s: self.speed,
            acceleration_mm_s2: self.acceleration,
            ..Limits::default()
        })
    }
}

/// What is the same for all captures of a command.
struct Session<'a> {
    capture: &'a Capture,
    plan: Plan,
    policy: Policy,
    /// Of the camera, and how it is set.
    description: String,
    interrupts: &'a AtomicUsize,
}

impl Session<'_> {
    /// Captures into a folder.
    fn run(&mut self, stage: &mut AnyStage, camera: &mut ThreadedCamera<V4l2Camera>, folder: &Path) -> Result<()> {
        let date = Zoned::now().strftime("%F %T %:z").to_string();
        let mut log = format!("{date}\ncamera: {}\nstage: {}\n", self.description, self.capture.stage);
        let bar = terminal::progress(self.plan.frames().len() as u64, "frames");
        let frames = acquire_frames(stage, camera, &self.plan, self.policy, self.interrupts, |elapsed, progress| {
            let step = self.words(progress);
            let _ = writeln!(log, "{:9.3} s  {step}", elapsed.as_secs_f64());
            bar.set_message(step);
            if let Progress::Captured(_) = progress {
                bar.inc(1);
            }
        });
        bar.finish_and_clear();
        let frames = frames?;
        let rig = self.rig(&frames, date);
        output::write_folder(folder, |folder| {
            frames.save(&rig.images.within(folder))?;
            output::write(&folder.join("capture.log"), |writer| writer.write_all(log.as_bytes()))?;
            rig.save(folder)
        })?;
        terminal::say(&format!(
            "{}: {} frames of {}x{}",
            folder.display(),
            self.plan.frames().len(),
            frames.width(),
            frames.height()
        ));
        Ok(())
    }

    /// What happens, in words.
    fn words(&self, progress: Progress) -> String {
        let name = |index: usize| self.plan.frames().get(index).copied().map_or("", Frame::name);
        match progress {
            Progress::Moving(index) => {
                let position = self.plan.positions().get(index).copied().unwrap_or_default();
                let [x, y] = [position.x_um, position.y_um].map(|um| f64::from(um) / 1000.0);
                format!("moves to ({x}, {y}) mm for the {} frame", name(index))
            }
            Progress::Settling(index) => format!("settles for the {} frame", name(index)),
            Progress::Capturing(index) => format!("takes the {} frame", name(index)),
            Progress::Captured(index) => format!("has the {} frame", name(index)),
            Progress::Retrying(index) => format!("tries the {} frame again", name(index)),
            Progress::Returning => "goes back to the centre".into(),
            Progress::Done => "is done".into(),
        }
    }

    fn rig(&self, frames: &Frames, date: String) -> Rig {
        Rig {
            baseline_mm: self.capture.baseline,
            focal_px: self.capture.focal_px,
            principal_point: frames.size().map(|side| (side as f64 - 1.0) / 2.0),
            doffs: 0.0,
            images: FrameFiles::of_capture(frames.views()),
            capture: Provenance {
                camera: Some(self.description.clone()),
                stage: Some(self.capture.stage.to_string()),
                date: Some(date),
                ..Provenance::default()
            },
        }
    }
}

fn pixel_format(name: &str) -> Result<PixelFormat> {
    let known = || PixelFormat::ALL.map(PixelFormat::name).join(", ");
    PixelFormat::named(name).ok_or_else(|| Error::Usage(format!("it must be one of {}", known())))
}

fn size(text: &str) -> Result<[u32; 2]> {
    let side = |text: &str| text.parse().ok().filter(|side| *side > 0);
    let sides = text.split_once('x').and_then(|(width, height)| Some([side(width)?, side(height)?]));
    sides.ok_or_else(|| Error::Usage("it must be a width and a height, as 640x480".into()))
}

/// A number of seconds, 0 or more.
fn duration(text: &str) -> Result<f64> {
    let number = text.trim().parse().ok().filter(|number: &f64| Duration::try_from_secs_f64(*number).is_ok());
    number.ok_or_else(|| Error::Usage("it must be a number of seconds, 0 or more".into()))
}

fn seconds(option: &str, number: f64) -> Result<Duration> {
    Duration::try_from_secs_f64(number).map_err(|error| Error::Usage(format!("{option} is {number} s: {error}")))
}

/// Whole micrometres, at least one and at most a metre.
fn micrometres(option: &str, millimetres: f64) -> Result<u32> {
    let micrometres = (1000.0 * millimetres).round();
    if !(1.0..=1e6).contains(&micrometres) {
        return Err(Error::Usage(format!("{option} is {millimetres} mm, it must be from 0.001 to 1000")));
    }
    Ok(micrometres as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers() {
        assert_eq!(size("640x480").unwrap(), [640, 480]);
        assert!(["640", "x", "0x1", "1x-1", "axb"].iter().all(|text| size(text).is_err()));
        assert_eq!(micrometres("--baseline", 20.0005).unwrap(), 20_001);
        assert!([0.0004, 1001.0, f64::INFINITY].iter().all(|&mm| micrometres("--baseline", mm).is_err()));
        assert!(duration("0").is_ok() && duration("-1").is_err() && duration("nan").is_err());
    }
}
