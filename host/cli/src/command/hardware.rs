//! The camera and the stage that a command line names, opened, and `multiscopic devices`: the cameras of this machine.

use std::{
    mem,
    process::ExitCode,
    sync::{
        Arc, OnceLock,
        atomic::{AtomicBool, AtomicUsize},
    },
    time::Duration,
};

use clap::Args;
use image::GrayImage;
use multiscopic::{
    Error, Result,
    capture::{
        BlockingCamera, Imperfections, SimulatedCamera, ThreadedCamera,
        camera::{self, CameraInfo, FrameSizes, V4l2Camera},
        stage::{self, AnyStage, Limits, SimulatedStage, StageSpec},
    },
    scene::PinholeCamera,
};
use multiscopic_core::capture::Policy;

use super::{
    options::{CameraSpec, HardwareOptions},
    terminal::{self, signals},
};

/// The time that the sequence waits for a frame beyond the camera's own limit: the camera's error says more about the cause.
const CAMERA_FIRST: Duration = Duration::from_secs(3);
/// Width and height of a simulated camera's frames, unless its lens is for another size.
const SIMULATED_SIZE: [u32; 2] = [640, 480];

/// A camera and a stage, ready to move.
pub struct Hardware {
    /// The camera.
    pub camera: ThreadedCamera<AnyCamera>,
    /// The camera and its settings, in words.
    pub camera_name: String,
    /// Width and height of its frames in pixels.
    pub size: [u32; 2],
    /// The camera, if it is simulated.
    pub simulated: Option<SimulatedCamera>,
    /// The stage.
    pub stage: AnyStage,
    /// The stage, as the command line names it.
    pub stage_name: String,
    /// The limits of the stage's reach and speed.
    pub limits: Limits,
    /// Time limits, retries and tolerances.
    pub policy: Policy,
    /// Counts the interrupts of the user, who presses Ctrl-C.
    pub interrupts: Arc<AtomicUsize>,
    /// The note on what the camera does not lock, once it has taken a picture.
    unlocked: Arc<OnceLock<String>>,
    /// True once the user has read the note.
    is_warned: bool,
}

/// A camera of any kind.
pub enum AnyCamera {
    /// A real one, and where its note goes.
    V4l2(Box<V4l2Camera>, Arc<OnceLock<String>>),
    /// One without hardware.
    Simulated(Box<SimulatedCamera>),
}

impl Hardware {
    /// Opens what the options name: the camera first, so that a faulty one is found before anything moves.
    ///
    /// From then on, Ctrl-C no longer ends the program.
    pub fn open(options: &HardwareOptions) -> Result<Hardware> {
        let interrupts = signals::count(usize::MAX);
        let (limits, settings) = (options.limits.limits()?, options.settings.settings());
        let frame_timeout = options.settings.frame_timeout()?;
        let policy = options.sequence.policy(&options.stage, frame_timeout + CAMERA_FIRST)?;
        let unlocked = Arc::new(OnceLock::new());
        let note = unlocked.clone();
        let hardware = |camera, camera_name, size, simulated, stage| Hardware {
            camera,
            camera_name,
            size,
            simulated,
            stage,
            stage_name: options.stage.to_string(),
            limits,
            policy,
            interrupts,
            unlocked,
            is_warned: false,
        };
        match &options.camera {
            CameraSpec::Simulated(file) => {
                if options.stage != StageSpec::Simulated {
                    let message = format!("--camera sim sees where --stage sim is, not where {} is: give both", options.stage);
                    return Err(Error::Usage(message));
                }
                let imperfections = file.as_deref().map(Imperfections::read).transpose()?.unwrap_or_default();
                let of_lens = imperfections.lens.and_then(|lens| lens.size).map(|size| size.map(|side| side as u32));
                let size = settings.size.or(of_lens).unwrap_or(SIMULATED_SIZE);
                if let (Some(lens), Some(path)) = (&imperfections.lens, file) {
                    lens.check_size(path, size.map(|side| side as usize))?;
                }
                let stage = SimulatedStage::new(&limits, imperfections.stage)?;
                let camera = SimulatedCamera::new(PinholeCamera::new(size[0], size[1]), &imperfections, stage.place());
                let simulated = Some(camera.clone());
                let name = camera.to_string();
                let open = move || Ok(AnyCamera::Simulated(Box::new(camera.clone())));
                Ok(hardware(ThreadedCamera::new(open, frame_timeout), name, size, simulated, AnyStage::new(stage)))
            }
            CameraSpec::Device(path) => {
                let open = {
                    let path = path.clone();
                    move || Ok(AnyCamera::V4l2(Box::new(V4l2Camera::open(&path, &settings)?), note.clone()))
                };
                let (name, size) = match open()? {
                    AnyCamera::V4l2(camera, _) => (camera.to_string(), camera.size()),
                    AnyCamera::Simulated(camera) => (camera.to_string(), camera.size()),
                };
                let stage = stage::open(&options.stage, &limits)?;
                Ok(hardware(ThreadedCamera::new(open, frame_timeout), name, size, None, stage))
            }
        }
    }

    /// Returns the note on what the camera does not lock, if there is something, and warns of it the first time.
    pub fn warn_of_unlocked(&mut self) -> Option<&str> {
        let note = self.unlocked.get()?;
        if !mem::replace(&mut self.is_warned, true) {
            terminal::warn(note);
        }
        Some(note)
    }
}

/// The note on what a camera does not lock though it should. `None` if there is nothing.
pub fn unlocked_note(camera: &V4l2Camera) -> Option<String> {
    let (last, others) = camera.unlocked().split_last()?;
    let names = if others.is_empty() { (*last).into() } else { format!("{} and {last}", others.join(", ")) };
    Some(format!(
        "the camera does not let its {names} be locked, so pictures may differ in brightness or sharpness: keep the light constant; \
         `match --align` evens out brightness"
    ))
}

impl BlockingCamera for AnyCamera {
    type Error = Error;

    fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<GrayImage> {
        match self {
            AnyCamera::V4l2(camera, note) => {
                let picture = camera.take(timeout, is_cancelled)?;
                if let Some(unlocked) = unlocked_note(camera) {
                    let _ = note.set(unlocked);
                }
                Ok(picture)
            }
            AnyCamera::Simulated(camera) => camera.take(timeout, is_cancelled).map_err(|never| match never {}),
        }
    }
}

/// Lists the cameras with their formats and sizes
///
/// Cameras are the V4L2 capture devices of Linux. Those that cannot be used are listed with the reason.
#[derive(Clone, Debug, Args)]
pub struct Devices {
    /// Print a JSON list of {"device","card","driver","bus","problem","formats"} instead of text
    #[arg(long)]
    json: bool,
}

impl Devices {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let cameras = camera::list()?;
        if self.json {
            let json = serde_json::to_string(&cameras).expect("names and numbers");
            terminal::print(&format!("{json}\n"))?;
        } else if cameras.is_empty() {
            terminal::complain("there are no cameras: no /dev/videoN captures images; plug in a camera or load its driver");
        } else {
            terminal::print(&cameras.iter().map(text).collect::<String>())?;
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// A camera as lines of text.
fn text(camera: &CameraInfo) -> String {
    let mut lines = match camera.card.as_str() {
        "" => format!("{}\n", camera.device.display()),
        card => format!("{}: {card} ({}, {})\n", camera.device.display(), camera.driver, camera.bus),
    };
    if let Some(problem) = &camera.problem {
        lines += &format!("    cannot be used: {problem}\n");
    }
    for offer in camera.formats.iter().filter(|offer| offer.is_supported) {
        let sizes = offer.sizes.iter().map(|sizes| match sizes {
            FrameSizes::One([width, height]) => format!("{width}x{height}"),
            FrameSizes::Range { min, max, step } => {
                format!("{}x{} to {}x{} in steps of {}x{}", min[0], min[1], max[0], max[1], step[0], step[1])
            }
        });
        let sizes = sizes.collect::<Vec<_>>().join(", ");
        lines += &format!("    {:<4} ({}): {sizes}\n", offer.format, offer.description);
    }
    let others: Vec<&str> = camera.formats.iter().filter(|offer| !offer.is_supported).map(|offer| &*offer.format).collect();
    if !others.is_empty() {
        lines += &format!("    not supported: {}\n", others.join(", "));
    }
    lines
}
