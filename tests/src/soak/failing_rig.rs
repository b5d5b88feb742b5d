//! A camera that sees a wall with a random texture, and the simulated hardware that moves it.

use std::{
    error, fmt,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    thread,
    time::Duration,
};

use image::{GrayImage, Luma};
use multiscopic::{
    DisparityMap, Engine, Picture,
    capture::{
        Acquisition, BlockingCamera, Clock, SystemClock, ThreadedCamera, acquire_images_with_clock,
        stage::{AnyStage, Limits},
    },
};
use multiscopic_core::{
    Fusion, SearchConfig, Views,
    capture::{CaptureProgress, Plan, Policy},
};
use multiscopic_reference::split_mix::Random;

use crate::simulated::{
    SimulatedClock,
    arm::{self, SimulatedArm},
    machine::{self, Firmware, SimulatedMachine},
    pose::Pose,
};

/// Width and height of pictures in pixels.
const SIZE: [u32; 2] = [64, 40];
/// The way of the stage for each pixel by which the wall moves, in micrometres.
const PIXEL_UM: f64 = 500.0;
/// The disparity of the wall.
const DISPARITY: i32 = 4;
/// A tool that looks down.
const DOWN: Pose = [0.4, -0.2, 0.5, std::f64::consts::PI, 0.0, 0.0];
/// The position at which machines start, in millimetres.
const START: [f64; 2] = [120.5, 80.25];
/// The time limit for whatever hardware in the time of the system does. Only a hung capture reaches it.
const PATIENCE: Duration = Duration::from_secs(120);
/// The most simulated time that a capture takes with every retry and time-out.
const LONGEST: Duration = Duration::from_secs(300);
/// The time-out of a picture. Simulated time passes no faster than the system's while one is taken.
const FRAME_TIMEOUT: Duration = Duration::from_secs(60);
/// The time between two looks at whether the hardware moves.
const LOOK: Duration = Duration::from_millis(3);

/// Limits in simulated time.
const LIMITS: Limits = Limits {
    reach_um: 100_000,
    speed_mm_s: 250.0,
    acceleration_mm_s2: 1200.0,
    connect_timeout: Duration::from_secs(10),
    silence_timeout: Duration::from_secs(2),
    stall_timeout: Duration::from_secs(1),
};

/// Limits in the time of the system.
const PATIENT: Limits = Limits { connect_timeout: PATIENCE, silence_timeout: PATIENCE, stall_timeout: PATIENCE, ..LIMITS };

/// A trouble of a capture.
#[derive(Clone, Copy, Debug)]
pub enum Trouble {
    /// The arm fails.
    Arm(arm::Fault),
    /// The arm's connections break.
    Disconnection,
    /// The machine fails.
    Machine(machine::Fault),
    /// The machine restarts.
    Restart,
    /// The camera fails.
    Eye(Blindness),
    /// The user interrupts.
    Interrupt,
}

impl Trouble {
    /// Its name, and the words of which an error that it causes must have one.
    fn description(self) -> (&'static str, &'static [&'static str]) {
        match self {
            Trouble::Arm(arm::Fault::ProtectiveStop { .. }) => ("arm: protective stop", &["protective stop"]),
            Trouble::Arm(arm::Fault::Stuck) => ("arm: stuck", &["came no nearer"]),
            Trouble::Arm(arm::Fault::Ignoring) => ("arm: ignores orders", &["has ignored a command"]),
            Trouble::Arm(arm::Fault::Silent) => ("arm: silent", &["nothing came from the arm"]),
            Trouble::Arm(arm::Fault::Nonsense) => ("arm: nonsense", &["NaN"]),
            Trouble::Arm(_) => unreachable!("no such trouble is made"),
            Trouble::Disconnection => ("arm: connections break", &["lost the connection"]),
            Trouble::Machine(machine::Fault::LimitSwitch { .. }) => ("machine: limit switch", &["alarm"]),
            Trouble::Machine(machine::Fault::Stuck) => ("machine: stuck", &["came no nearer", "is still busy", "still moves"]),
            Trouble::Machine(machine::Fault::Silent) => ("machine: silent", &["nothing came from"]),
            Trouble::Machine(machine::Fault::Refusing) => ("machine: refuses moves", &["refused `"]),
            Trouble::Machine(_) => unreachable!("no such trouble is made"),
            Trouble::Restart => ("machine: restarts", &["restarted and lost its position"]),
            Trouble::Eye(Blindness::Once) => ("camera: one damaged picture", &[]),
            Trouble::Eye(Blindness::Gone) => ("camera: gone", &["the sensor is gone"]),
            Trouble::Eye(Blindness::Silent) => ("camera: silent", &["no picture came", "gave no frame within"]),
            Trouble::Interrupt => ("interrupt", &["aborted"]),
        }
    }

    /// Returns true if the capture may go on in spite of it.
    fn is_bearable(self) -> bool {
        // The next move opens new connections, if it is already known that the old ones are broken.
        matches!(self, Trouble::Disconnection | Trouble::Eye(Blindness::Once))
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        self.description().0
    }
}

/// The time that a rig goes by.
enum Time {
    System,
    Simulated(Arc<SimulatedClock>),
}

impl Time {
    fn clock(&self) -> Arc<dyn Clock> {
        match self {
            Time::System => Arc::new(SystemClock),
            Time::Simulated(clock) => clock.clone(),
        }
    }

    /// Lets simulated time pass no faster than the system's, while a camera's thread works.
    fn keep_pace(&self, keeps_pace: bool) {
        if let Time::Simulated(clock) = self {
            clock.keep_pace(keeps_pace);
        }
    }
}

/// The hardware that moves the camera.
#[derive(Clone)]
enum Mover {
    Arm(Arc<SimulatedArm>),
    Machine(Arc<SimulatedMachine>, Firmware),
}

/// A camera and the hardware that moves it.
pub struct FailingRig {
    mover: Mover,
    time: Time,
    blindness: SharedBlindness,
}

impl FailingRig {
    /// One of several kinds of rigs in turn: each kind of hardware in simulated time, and more rarely with sockets and terminals
    /// in the time of the system.
    pub fn start(number: usize) -> FailingRig {
        let time = match number / 4 % 4 {
            3 => Time::System,
            _ => Time::Simulated(Arc::new(SimulatedClock::default())),
        };
        let machine = |firmware| {
            let machine = match &time {
                Time::Simulated(clock) => SimulatedMachine::in_time_of(clock, firmware, START, Duration::ZERO),
                Time::System => SimulatedMachine::start(firmware, START, Duration::ZERO),
            };
            Mover::Machine(Arc::new(machine), firmware)
        };
        let mover = match (number % 4, &time) {
            (0 | 1, Time::Simulated(clock)) => Mover::Arm(Arc::new(SimulatedArm::in_time_of(clock, DOWN))),
            (0 | 1, Time::System) => Mover::Arm(Arc::new(SimulatedArm::start(DOWN))),
            (2, _) => machine(Firmware::Grbl),
            _ => machine(Firmware::MARLIN),
        };
        FailingRig { mover, time, blindness: SharedBlindness::default() }
    }

    /// A random trouble that it may have. In the time of the system, that is one which shows at once: a time-out would have to be
    /// long enough for a busy machine.
    pub fn trouble(&self, random: &mut Random) -> Trouble {
        let mut all = vec![Trouble::Eye(Blindness::Once), Trouble::Eye(Blindness::Gone), Trouble::Interrupt];
        all.extend(match self.mover {
            Mover::Arm(_) => vec![
                Trouble::Arm(arm::Fault::ProtectiveStop { after_m: 0.0005 }),
                Trouble::Arm(arm::Fault::Nonsense),
                Trouble::Disconnection,
            ],
            Mover::Machine(..) => vec![Trouble::Machine(machine::Fault::Refusing), Trouble::Restart],
        });
        let limit_switch = Trouble::Machine(machine::Fault::LimitSwitch { after_mm: 0.5 });
        match (&self.time, &self.mover) {
            (Time::System, Mover::Machine(_, Firmware::Grbl)) => all.push(limit_switch),
            (Time::System, _) => {}
            (Time::Simulated(_), Mover::Arm(_)) => all.extend([
                Trouble::Eye(Blindness::Silent),
                Trouble::Arm(arm::Fault::Stuck),
                Trouble::Arm(arm::Fault::Ignoring),
                Trouble::Arm(arm::Fault::Silent),
            ]),
            (Time::Simulated(_), Mover::Machine(..)) => all.extend([
                Trouble::Eye(Blindness::Silent),
                limit_switch,
                Trouble::Machine(machine::Fault::Stuck),
                Trouble::Machine(machine::Fault::Silent),
            ]),
        }
        all[random.below(all.len())]
    }

    /// Captures, with a trouble after one of the frames, and matches the frames. Panics if anything but the expected happens.
    pub fn capture(&self, trouble: Option<Trouble>, random: &mut Random) {
        let mut stage = self.open();
        let (plan, policy) = self.sequence();
        let mut camera = self.camera(policy.frame_timeout);
        let interrupts = AtomicUsize::new(0);
        // A camera that fails is asked for another frame; a stage fails at the next move, of which the last is the way back.
        let frames = plan.frames().len();
        let after = random.below(if matches!(trouble, Some(Trouble::Eye(_))) { frames - 1 } else { frames });
        let clock = self.time.clock();
        let (mut retries, start) = (0, clock.now());
        let observe = |_: Duration, progress: CaptureProgress| {
            match progress {
                CaptureProgress::Captured(index) if index == after => {
                    trouble.into_iter().for_each(|trouble| self.cause(trouble, &interrupts));
                }
                CaptureProgress::Retrying(_) => retries += 1,
                _ => {}
            }
            let is_taken = matches!(progress, CaptureProgress::Capturing(_) | CaptureProgress::Retrying(_));
            self.time.keep_pace(is_taken && self.blindness() != Some(Blindness::Silent));
        };
        let taken = acquire_images_with_clock(&*clock, &mut stage, &mut camera, &plan, policy, &interrupts, observe);
        self.time.keep_pace(false);
        let what = trouble.map_or("nothing", Trouble::name);
        let (took, longest) = (clock.now() - start, if let Time::System = self.time { 2 * PATIENCE } else { LONGEST });
        assert!(took < longest, "{what}: it took {took:?}");
        drop(stage);
        drop(camera);
        self.assert_rest(what);
        let (images, error) = match taken {
            Ok(Acquisition { images, failure, .. }) => (Some(images), failure),
            Err(error) => (None, Some(error)),
        };
        let (error, words) = (error.map(|error| error.to_string()), trouble.map_or(&[][..], |trouble| trouble.description().1));
        match &error {
            Some(error) => assert!(words.iter().any(|word| error.contains(word)), "{what} was reported as: {error}"),
            None => assert!(trouble.is_none_or(Trouble::is_bearable), "{what} was not reported"),
        }
        if matches!(trouble, Some(Trouble::Eye(Blindness::Once))) {
            assert_eq!(retries, 1, "{what}: retries");
        }
        if let Some(images) = images {
            check_match(Acquisition { images, poses: Vec::new(), failure: None }, what);
        }
        self.repair();
    }

    fn open(&self) -> AnyStage {
        let limits = if let Time::System = self.time { PATIENT } else { LIMITS };
        let opened = match &self.mover {
            Mover::Arm(arm) => arm.stage(&limits),
            Mover::Machine(machine, _) => machine.stage(&limits),
        };
        opened.unwrap_or_else(|error| panic!("after a repair, the stage is refused: {error}"))
    }

    fn blindness(&self) -> Option<Blindness> {
        *self.blindness.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn sequence(&self) -> (Plan, Policy) {
        let plan = Plan::new(Views::HORIZONTAL, (f64::from(DISPARITY) * PIXEL_UM) as u32);
        let policy = Policy {
            settle: Duration::ZERO,
            move_timeout: PATIENCE,
            frame_timeout: FRAME_TIMEOUT,
            retries: 1,
            tolerance_um: 200,
            backlash_um: 0,
            return_to_center: true,
        };
        (plan, policy)
    }

    fn camera(&self, timeout: Duration) -> ThreadedCamera<Eye> {
        let place_um: Arc<dyn Fn() -> f64 + Send + Sync> = match self.mover.clone() {
            Mover::Arm(arm) => {
                let home = arm.pose()[0];
                Arc::new(move || (arm.pose()[0] - home) * 1e6)
            }
            Mover::Machine(machine, _) => {
                let home = machine.place()[0];
                Arc::new(move || (machine.place()[0] - home) * 1e3)
            }
        };
        let (blindness, clock) = (self.blindness.clone(), self.time.clock());
        let eye = move || Ok(Eye { place_um: place_um.clone(), blindness: blindness.clone(), clock: clock.clone() });
        ThreadedCamera::new(eye, timeout)
    }

    fn cause(&self, trouble: Trouble, interrupts: &AtomicUsize) {
        match (trouble, &self.mover) {
            (Trouble::Arm(fault), Mover::Arm(arm)) => arm.fail(fault),
            (Trouble::Disconnection, Mover::Arm(arm)) => arm.disconnect(),
            (Trouble::Machine(fault), Mover::Machine(machine, _)) => machine.fail(fault),
            (Trouble::Restart, Mover::Machine(machine, _)) => machine.restart(),
            (Trouble::Eye(blindness), _) => *self.blindness.lock().unwrap_or_else(PoisonError::into_inner) = Some(blindness),
            (Trouble::Interrupt, _) => _ = interrupts.fetch_add(1, std::sync::atomic::Ordering::Relaxed),
            _ => unreachable!("it is for another rig"),
        }
    }

    /// Waits until nothing moves.
    fn assert_rest(&self, what: &str) {
        let clock = self.time.clock();
        let start = clock.now();
        let is_moving = || match &self.mover {
            // What is stuck in a move will not end it, but does not move either.
            Mover::Arm(arm) => {
                let before = arm.pose();
                clock.sleep(LOOK);
                arm.is_moving() && arm.pose() != before
            }
            Mover::Machine(machine, _) => {
                let before = machine.place();
                clock.sleep(LOOK);
                machine.is_moving() && machine.place() != before
            }
        };
        while is_moving() {
            assert!(clock.now() - start < PATIENCE, "{what}: it still moves after the capture");
        }
    }

    /// Makes everything work again, as a person would.
    fn repair(&self) {
        *self.blindness.lock().unwrap_or_else(PoisonError::into_inner) = None;
        match &self.mover {
            Mover::Arm(arm) => {
                arm.release();
                // It keeps connections until it is told to close them.
                arm.disconnect();
                arm.heard();
            }
            Mover::Machine(machine, _) => {
                machine.fail(machine::Fault::None);
                machine.lock(false);
                machine.restart();
                machine.heard();
            }
        }
    }
}

/// Matches what was captured: the wall is where it should be.
fn check_match(acquisition: Acquisition, what: &str) {
    let frames = acquisition.frames();
    let engine = Engine::new(None, 2).expect("two threads");
    let [width, height] = SIZE.map(|side| side as u16);
    let params = SearchConfig {
        views: Views::HORIZONTAL,
        fusion: Fusion::Min,
        num_disparities: 8,
        ..SearchConfig::of_size(width, height)
    }
    .block_matching(5)
    .expect("valid parameters");
    let map: DisparityMap = engine.disparities(&frames.planes(), &params, &|| ()).expect("the frames fit");
    let wall = map.pixels().iter().flatten().filter(|disparity| (f32::from(**disparity) - DISPARITY as f32).abs() < 0.5).count();
    let all = map.pixels().len();
    assert!(wall * 10 > all * 9, "{what}: only {wall} of {all} pixels have the wall's disparity");
}

/// A fault of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blindness {
    /// The next picture fails.
    Once,
    /// All pictures fail.
    Gone,
    /// No picture comes.
    Silent,
}

/// The fault, shared by the camera and those who make it fail.
type SharedBlindness = Arc<Mutex<Option<Blindness>>>;

/// The camera.
struct Eye {
    /// Its place along the image's lines, in micrometres.
    place_um: Arc<dyn Fn() -> f64 + Send + Sync>,
    /// Its fault.
    blindness: SharedBlindness,
    /// The clock by which it falls silent.
    clock: Arc<dyn Clock>,
}

/// The reason why there is no picture.
#[derive(Debug)]
struct EyeError(&'static str);

impl fmt::Display for EyeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}

impl error::Error for EyeError {}

impl BlockingCamera for Eye {
    type Error = EyeError;

    fn take(&mut self, timeout: Duration, is_cancelled: &AtomicBool) -> Result<Picture, EyeError> {
        let found = {
            let mut blindness = self.blindness.lock().unwrap_or_else(PoisonError::into_inner);
            let found = *blindness;
            *blindness = found.filter(|found| *found != Blindness::Once);
            found
        };
        match found {
            None => Ok(Picture::Gray(picture((self.place_um)()))),
            Some(Blindness::Once) => Err(EyeError("a damaged picture")),
            Some(Blindness::Gone) => Err(EyeError("the sensor is gone")),
            Some(Blindness::Silent) => {
                let start = self.clock.now();
                // It only looks at the clock: time is another thread's.
                while self.clock.now() - start < timeout && !is_cancelled.load(Ordering::Relaxed) {
                    thread::sleep(Duration::from_millis(2));
                }
                Err(EyeError("no picture came"))
            }
        }
    }
}

/// The wall, seen from a place.
fn picture(place_um: f64) -> GrayImage {
    let shift = (place_um / PIXEL_UM).round() as i32;
    let texture = |u: i32, v: u32| {
        let hash = (u as u32).wrapping_mul(0x9E37_79B1) ^ v.wrapping_mul(0x85EB_CA77);
        (hash ^ hash >> 15).wrapping_mul(0x2C1B_3C6D) >> 24
    };
    GrayImage::from_fn(SIZE[0], SIZE[1], |u, v| Luma([texture(u as i32 + shift, v) as u8]))
}
