//! The camera and the stage that a command line names, opened, and `multiscopic devices`: the cameras of this machine.

use std::{
    mem,
    process::ExitCode,
    sync::{Arc, atomic::AtomicUsize},
    time::Duration,
};

use clap::Args;
use multiscopic::{
    Error, Result,
    capture::{
        Clock, Imperfections, SimulatedCamera, SystemClock, ThreadedCamera,
        camera::{self, CameraInfo, FrameSizes},
        stage::{self, AnyStage, FollowedStage, Limits, SimulatedPlace, SimulatedStage, StageImperfections, StageSpec},
    },
    scene::PinholeCamera,
};
use multiscopic_core::capture::Policy;

use super::{
    cameras::{AnyCamera, UnlockedNote},
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
    /// The note on what is simulated, if only one of them is.
    pub simulation: Option<String>,
    /// The limits of the stage's reach and speed.
    pub limits: Limits,
    /// Time limits, retries and tolerances.
    pub policy: Policy,
    /// Counts the interrupts of the user, who presses Ctrl-C.
    pub interrupts: Arc<AtomicUsize>,
    /// The note on what the camera does not lock.
    unlocked: UnlockedNote,
    /// True once the user has read the note.
    is_warned: bool,
}

impl Hardware {
    /// Opens what the options name: the camera first, so that a faulty one is found before anything moves.
    ///
    /// From then on, Ctrl-C no longer ends the program.
    pub fn open(options: &HardwareOptions) -> Result<Hardware> {
        Hardware::open_with_clock(options, Arc::new(SystemClock))
    }

    /// Opens hardware like [`open`](Hardware::open), with a simulated stage that moves in the time of `clock` if the camera is
    /// simulated, too.
    pub fn open_with_clock(options: &HardwareOptions, clock: Arc<dyn Clock>) -> Result<Hardware> {
        let interrupts = signals::count(usize::MAX);
        let (limits, settings) = (options.limits.limits()?, options.settings.settings());
        let frame_timeout = options.settings.frame_timeout()?;
        let policy = options.sequence.policy(&options.stage, frame_timeout + CAMERA_FIRST)?;
        let unlocked = UnlockedNote::default();
        let hardware = |camera, camera_name, size, simulated, stage, simulation: Option<String>| {
            simulation.iter().for_each(|note| terminal::warn(note));
            Hardware {
                camera,
                camera_name,
                size,
                simulated,
                stage,
                stage_name: options.stage.to_string(),
                simulation,
                limits,
                policy,
                interrupts,
                unlocked: unlocked.clone(),
                is_warned: false,
            }
        };
        match &options.camera {
            CameraSpec::Simulated(file) => {
                let imperfections = file.as_deref().map(Imperfections::read).transpose()?.unwrap_or_default();
                let of_lens = imperfections.lens.and_then(|lens| lens.size).map(|size| size.map(|side| side as u32));
                let size = settings.size.or(of_lens).unwrap_or(SIMULATED_SIZE);
                if let (Some(lens), Some(path)) = (&imperfections.lens, file) {
                    lens.check_size(path, size.map(|side| side as usize))?;
                }
                let (stage, place, note) = followed_stage(&options.stage, &limits, imperfections.stage, clock)?;
                let camera = SimulatedCamera::new(PinholeCamera::new(size[0], size[1]), &imperfections, place);
                let simulated = Some(camera.clone());
                let name = camera.to_string();
                let open = move || Ok(AnyCamera::Simulated(Box::new(camera.clone())));
                Ok(hardware(ThreadedCamera::new(open, frame_timeout), name, size, simulated, stage, note))
            }
            CameraSpec::Real(camera) => {
                let open = {
                    let (camera, settings, note) = (camera.clone(), options.settings.clone(), unlocked.clone());
                    move || AnyCamera::open(&camera, &settings, &note)
                };
                let (name, size) = open()?.describe(frame_timeout)?;
                let stage = stage::open(&options.stage, &limits)?;
                let note = (options.stage == StageSpec::Simulated)
                    .then(|| "the stage is simulated: the camera does not move, so all frames are taken from one place".into());
                Ok(hardware(ThreadedCamera::new(open, frame_timeout), name, size, None, stage, note))
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

/// Opens a stage that a simulated camera follows. Also returns the camera's place, and a note if the stage is real.
fn followed_stage(
    spec: &StageSpec,
    limits: &Limits,
    imperfections: StageImperfections,
    clock: Arc<dyn Clock>,
) -> Result<(AnyStage, SimulatedPlace, Option<String>)> {
    if *spec == StageSpec::Simulated {
        let stage = SimulatedStage::with_clock(limits, imperfections, clock)?;
        let place = stage.place();
        return Ok((AnyStage::new(stage), place, None));
    }
    if imperfections != StageImperfections::default() {
        let message = format!("the table [stage] behind --camera sim: is for --stage sim, but {spec} has errors of its own");
        return Err(Error::Usage(message));
    }
    let stage = FollowedStage::new(stage::open(spec, limits)?);
    let place = stage.place();
    let note = format!("the pictures are simulated: they show the scene of the demo from where {spec} says that the camera is");
    Ok((AnyStage::new(stage), place, Some(note)))
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
