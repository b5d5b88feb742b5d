//! The camera, the stage that moves it, and the sequence that runs both.

use std::{num::NonZeroU16, path::PathBuf, str::FromStr, time::Duration};

use clap::Args;
use multiscopic::{
    Error, Result,
    capture::{
        camera::{CameraSettings, HttpUrl, PixelFormat},
        stage::{Limits, StageSpec},
    },
};
use multiscopic_core::capture::Policy;

use super::value::{micrometres, positive, size};

/// The default backlash of a machine with screws or belts, in micrometres.
const GCODE_BACKLASH_UM: u32 = 500;

/// A person may take as long as they like.
const MANUAL_MOVE_TIMEOUT: Duration = Duration::from_secs(24 * 3600);

/// The camera and the stage.
#[derive(Clone, Debug, Args)]
pub struct HardwareOptions {
    /// V4L2 camera, as listed by `multiscopic devices`; a camera of a network; a command that takes pictures; or a simulated camera
    /// that sees the scene of the demo from where the stage says it is. FILE.toml tells what is wrong with the simulated rig: its
    /// lens, its mount, its stage
    #[arg(long, value_name = "/dev/videoN|http://HOST/PATH|exec:COMMAND|sim[:FILE.toml]")]
    pub camera: CameraSpec,

    /// Stage that moves the camera in its image plane: a Universal Robots arm, a machine with G-code, a command that moves
    /// anything, you, or nothing real
    #[arg(long, value_name = "ur10:HOST[:PORT[,RTDE_PORT]]|gcode:TTY[@BAUD]|exec:COMMAND|manual|sim")]
    pub stage: StageSpec,

    #[command(flatten)]
    pub settings: SettingsOptions,

    #[command(flatten)]
    pub sequence: SequenceOptions,

    #[command(flatten)]
    pub limits: LimitsOptions,
}

/// A camera, as `--camera` names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CameraSpec {
    /// A real camera.
    Real(RealCamera),
    /// `sim[:FILE.toml]`: no hardware, and the file of the rig's imperfections.
    Simulated(Option<PathBuf>),
}

/// A camera that is not simulated, as `--camera` names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RealCamera {
    /// A device file.
    Device(PathBuf),
    /// `exec:COMMAND`: a command that takes pictures.
    Exec(String),
    /// `http://HOST[:PORT][/PATH]`: a camera of a network.
    Http(HttpUrl),
}

impl FromStr for CameraSpec {
    type Err = Error;

    fn from_str(text: &str) -> Result<CameraSpec> {
        Ok(match text.split_once(':') {
            Some(("http", _)) => CameraSpec::Real(RealCamera::Http(text.parse()?)),
            Some((scheme @ ("https" | "rtsp" | "rtsps"), _)) => {
                return Err(Error::Usage(format!(
                    "{scheme} is read by GStreamer: --camera \"exec:sh camera_gstreamer.sh uridecodebin uri={text}\", with the script in \
                     host/examples/exec"
                )));
            }
            Some(("sim", file)) => CameraSpec::Simulated(Some(file.into())),
            None if text == "sim" => CameraSpec::Simulated(None),
            Some(("exec", command)) => CameraSpec::Real(RealCamera::Exec(command.into())),
            _ => CameraSpec::Real(RealCamera::Device(text.into())),
        })
    }
}

/// The settings of the camera.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Camera")]
pub struct SettingsOptions {
    /// Pixel format, as listed by `multiscopic devices` [default: the best the camera offers]
    #[arg(long, value_parser = pixel_format)]
    format: Option<PixelFormat>,

    /// Width and height in pixels [default: the camera's current size]
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,

    /// Number of frames averaged into each one
    #[arg(long, value_name = "N", default_value_t = NonZeroU16::MIN)]
    average: NonZeroU16,

    /// Number of frames discarded when the camera starts, and again when its settings are locked
    #[arg(long, value_name = "N", default_value_t = CameraSettings::default().warm_up)]
    warm_up: u16,

    /// Let the camera adjust exposure, gain, focus and white balance for every frame
    #[arg(long)]
    no_lock: bool,

    /// Exposure time in units of 100 us [default: chosen by the camera]
    #[arg(long, value_name = "N")]
    exposure: Option<i32>,

    /// Gain in the camera's units [default: chosen by the camera]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    gain: Option<i32>,

    /// Focus distance in the camera's units [default: chosen by the camera]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    focus: Option<i32>,

    /// Colour temperature in kelvins [default: chosen by the camera]
    #[arg(long, value_name = "K")]
    white_balance: Option<i32>,

    /// Time limit for a frame, including warm-up, in seconds
    #[arg(long, value_name = "S", default_value_t = Policy::default().frame_timeout.as_secs_f64(), value_parser = positive)]
    frame_timeout: f64,
}

/// The timing and tolerances of the sequence.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Sequence")]
pub struct SequenceOptions {
    /// Wait for vibrations to fade, in seconds
    #[arg(long, value_name = "S", default_value_t = Policy::default().settle.as_secs_f64(), value_parser = duration)]
    settle: f64,

    /// Time limit for a move, in seconds
    #[arg(long, value_name = "S", default_value_t = Policy::default().move_timeout.as_secs_f64(), value_parser = positive)]
    move_timeout: f64,

    /// Retries for a frame that fails and for a position that is missed
    #[arg(long, value_name = "N", default_value_t = Policy::default().retries)]
    retries: u8,

    /// Largest accepted error of the measured position, in micrometres
    #[arg(long, value_name = "UM", default_value_t = Policy::default().tolerance_um)]
    tolerance: u32,

    /// Start each approach this far to the left of the position and above it, in micrometres, to take up play from the same side
    /// [default: 500 for gcode, else 0]
    #[arg(long, value_name = "UM")]
    backlash: Option<u32>,
}

/// The limits on the motion of the stage.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Stage")]
pub struct LimitsOptions {
    /// Speed in millimetres per second
    #[arg(long, value_name = "MM/S", default_value_t = Limits::default().speed_mm_s, value_parser = positive)]
    speed: f64,

    /// Acceleration in millimetres per second squared
    #[arg(long, value_name = "MM/S2", default_value_t = Limits::default().acceleration_mm_s2, value_parser = positive)]
    acceleration: f64,

    /// Largest distance from the current position, in millimetres
    #[arg(long, value_name = "MM", default_value_t = f64::from(Limits::default().reach_um) / 1000.0, value_parser = positive)]
    reach: f64,

    /// Time limit for an answer or a report of the stage, in seconds
    #[arg(long, value_name = "S", default_value_t = Limits::default().silence_timeout.as_secs_f64(), value_parser = positive)]
    silence_timeout: f64,
}

impl SettingsOptions {
    /// The settings of the camera.
    pub fn settings(&self) -> CameraSettings {
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

    /// The first option that only a V4L2 camera obeys, if one is given.
    pub fn of_device(&self) -> Option<&'static str> {
        let is_given = [
            ("--format", self.format.is_some()),
            ("--size", self.size.is_some()),
            ("--no-lock", self.no_lock),
            ("--exposure", self.exposure.is_some()),
            ("--gain", self.gain.is_some()),
            ("--focus", self.focus.is_some()),
            ("--white-balance", self.white_balance.is_some()),
        ];
        is_given.into_iter().find_map(|(option, is_given)| is_given.then_some(option))
    }

    /// The time limit for a frame.
    pub fn frame_timeout(&self) -> Result<Duration> {
        seconds("--frame-timeout", self.frame_timeout)
    }
}

impl SequenceOptions {
    /// The policy for `stage`, with a time limit for a frame.
    pub fn policy(&self, stage: &StageSpec, frame_timeout: Duration) -> Result<Policy> {
        let backlash_um = match stage {
            StageSpec::Gcode { .. } => GCODE_BACKLASH_UM,
            StageSpec::Ur10(_) | StageSpec::Exec(_) | StageSpec::Manual | StageSpec::Simulated => 0,
        };
        Ok(Policy {
            settle: Duration::from_secs_f64(self.settle),
            move_timeout: match stage {
                StageSpec::Manual => MANUAL_MOVE_TIMEOUT,
                _ => seconds("--move-timeout", self.move_timeout)?,
            },
            frame_timeout,
            retries: self.retries,
            tolerance_um: self.tolerance,
            backlash_um: self.backlash.unwrap_or(backlash_um),
            return_to_center: true,
        })
    }
}

impl LimitsOptions {
    /// The limits.
    pub fn limits(&self) -> Result<Limits> {
        Ok(Limits {
            reach_um: micrometres("--reach", self.reach)?,
            speed_mm_s: self.speed,
            acceleration_mm_s2: self.acceleration,
            silence_timeout: seconds("--silence-timeout", self.silence_timeout)?,
            ..Limits::default()
        })
    }
}

fn pixel_format(name: &str) -> Result<PixelFormat> {
    let known = || PixelFormat::ALL.map(PixelFormat::name).join(", ");
    PixelFormat::named(name).ok_or_else(|| Error::Usage(format!("it must be one of {}", known())))
}

/// A number of seconds, 0 or more.
fn duration(text: &str) -> Result<f64> {
    let number = text.trim().parse().ok().filter(|number: &f64| Duration::try_from_secs_f64(*number).is_ok());
    number.ok_or_else(|| Error::Usage("it must be a number of seconds, 0 or more".into()))
}

fn seconds(option: &str, number: f64) -> Result<Duration> {
    Duration::try_from_secs_f64(number).map_err(|error| Error::Usage(format!("{option} is {number} s: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers() {
        assert!(duration("0").is_ok() && duration("-1").is_err() && duration("nan").is_err());
    }
}
