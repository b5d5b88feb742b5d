//! A camera and the simulated hardware that moves it.

use std::{
    sync::{Arc, PoisonError, atomic::AtomicUsize},
    thread,
    time::{Duration, Instant},
};

use multiscopic::{
    DisparityMap, Engine,
    capture::{
        Acquisition, ThreadedCamera, acquire_images,
        stage::{self, AnyStage, Limits, StageSpec},
    },
};
use multiscopic_core::{
    Fusion, SearchConfig, Views,
    capture::{CaptureProgress, Plan, Policy},
};

use super::eye::{Blindness, Eye, PIXEL_UM, SIZE, SharedBlindness};
use crate::{
    simulated::{
        arm::{self, SimulatedArm},
        machine::{self, Firmware, SimulatedMachine},
        pose::Pose,
    },
    split_mix::Random,
};

/// The disparity of the wall.
const DISPARITY: i32 = 4;
/// A tool that looks down.
const DOWN: Pose = [0.4, -0.2, 0.5, std::f64::consts::PI, 0.0, 0.0];
/// The position at which machines start, in millimetres.
const START: [f64; 2] = [120.5, 80.25];
/// How long the hardware may take to come to rest after a capture.
const UNREST: Duration = Duration::from_secs(10);
/// How long a capture may take with every retry and time-out.
const PATIENCE: Duration = Duration::from_secs(90);

/// Time limits that a busy machine keeps.
const LIMITS: Limits = Limits {
    reach_um: 100_000,
    speed_mm_s: 250.0,
    acceleration_mm_s2: 1200.0,
    connect_timeout: Duration::from_secs(10),
    silence_timeout: Duration::from_secs(2),
    stall_timeout: Duration::from_secs(1),
};

/// What goes wrong with a capture.
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
    /// What it is called, and what an error that it causes must say: one of these.
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
            Trouble::Machine(machine::Fault::Stuck) => ("machine: stuck", &["came no nearer", "is still busy"]),
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

    /// Whether the capture may go on in spite of it.
    fn is_bearable(self) -> bool {
        // The next move opens new connections, if it is already known that the old ones are broken.
        matches!(self, Trouble::Disconnection | Trouble::Eye(Blindness::Once))
    }

    /// What it is called.
    pub fn name(self) -> &'static str {
        self.description().0
    }
}

/// What moves the camera.
#[derive(Clone)]
enum Mover {
    Arm(Arc<SimulatedArm>),
    Machine(Arc<SimulatedMachine>),
}

/// A camera and what moves it.
pub struct FailingRig {
    mover: Mover,
    blindness: SharedBlindness,
}

impl FailingRig {
    /// One of several kinds of rigs in turn.
    pub fn start(number: usize) -> FailingRig {
        let machine = |firmware| Mover::Machine(Arc::new(SimulatedMachine::start(firmware, START, Duration::ZERO)));
        let mover = match number % 4 {
            0 | 1 => Mover::Arm(Arc::new(SimulatedArm::start(DOWN))),
            2 => machine(Firmware::Grbl),
            _ => machine(Firmware::Marlin),
        };
        FailingRig { mover, blindness: SharedBlindness::default() }
    }

    /// What may go wrong with it.
    pub fn trouble(&self, random: &mut Random) -> Trouble {
        let of_all =
            [Trouble::Eye(Blindness::Once), Trouble::Eye(Blindness::Gone), Trouble::Eye(Blindness::Silent), Trouble::Interrupt];
        let of_mover = match self.mover {
            Mover::Arm(_) => vec![
                Trouble::Arm(arm::Fault::ProtectiveStop { after_m: 0.0005 }),
                Trouble::Arm(arm::Fault::Stuck),
                Trouble::Arm(arm::Fault::Ignoring),
                Trouble::Arm(arm::Fault::Silent),
                Trouble::Arm(arm::Fault::Nonsense),
                Trouble::Disconnection,
            ],
            Mover::Machine(_) => vec![
                Trouble::Machine(machine::Fault::LimitSwitch { after_mm: 0.5 }),
                Trouble::Machine(machine::Fault::Stuck),
                Trouble::Machine(machine::Fault::Silent),
                Trouble::Machine(machine::Fault::Refusing),
                Trouble::Restart,
            ],
        };
        let all = [&of_all[..], &of_mover].concat();
        all[random.below(all.len())]
    }

    /// Captures, with a trouble after one of the frames, and matches what was captured. Panics unless what happens is what
    /// should.
    pub fn capture(&self, trouble: Option<Trouble>, random: &mut Random) {
        let mut stage = self.open();
        let (plan, policy) = self.sequence();
        let mut camera = self.camera(policy.frame_timeout);
        let interrupts = AtomicUsize::new(0);
        // A camera that fails is asked for another frame; a stage fails at the next move, of which the last is the way back.
        let frames = plan.frames().len();
        let after = random.below(if matches!(trouble, Some(Trouble::Eye(_))) { frames - 1 } else { frames });
        let (mut retries, start) = (0, Instant::now());
        let taken = acquire_images(&mut stage, &mut camera, &plan, policy, &interrupts, |_, progress| match progress {
            CaptureProgress::Captured(index) if index == after => {
                trouble.into_iter().for_each(|trouble| self.cause(trouble, &interrupts));
            }
            CaptureProgress::Retrying(_) => retries += 1,
            _ => {}
        });
        let what = trouble.map_or("nothing", Trouble::name);
        assert!(start.elapsed() < PATIENCE, "{what}: it took {:?}", start.elapsed());
        drop(stage);
        drop(camera);
        self.assert_rest(what);
        let (images, error) = match taken {
            Ok(Acquisition { images, failure }) => (Some(images), failure),
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
            check_match(Acquisition { images, failure: None }, what);
        }
        self.repair();
    }

    fn open(&self) -> AnyStage {
        let spec = match &self.mover {
            Mover::Arm(arm) => arm.spec(),
            Mover::Machine(machine) => machine.spec(),
        };
        let spec: StageSpec = spec.parse().expect("a stage");
        stage::open(&spec, &LIMITS).unwrap_or_else(|error| panic!("after a repair, {spec} is refused: {error}"))
    }

    fn sequence(&self) -> (Plan, Policy) {
        let plan = Plan::new(Views::HORIZONTAL, (f64::from(DISPARITY) * PIXEL_UM) as u32);
        let policy = Policy {
            settle: Duration::ZERO,
            move_timeout: Duration::from_secs(20),
            frame_timeout: Duration::from_secs(1),
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
            Mover::Machine(machine) => {
                let home = machine.place()[0];
                Arc::new(move || (machine.place()[0] - home) * 1e3)
            }
        };
        let blindness = self.blindness.clone();
        ThreadedCamera::new(move || Ok(Eye { place_um: place_um.clone(), blindness: blindness.clone() }), timeout)
    }

    fn cause(&self, trouble: Trouble, interrupts: &AtomicUsize) {
        match (trouble, &self.mover) {
            (Trouble::Arm(fault), Mover::Arm(arm)) => arm.fail(fault),
            (Trouble::Disconnection, Mover::Arm(arm)) => arm.disconnect(),
            (Trouble::Machine(fault), Mover::Machine(machine)) => machine.fail(fault),
            (Trouble::Restart, Mover::Machine(machine)) => machine.restart(),
            (Trouble::Eye(blindness), _) => *self.blindness.lock().unwrap_or_else(PoisonError::into_inner) = Some(blindness),
            (Trouble::Interrupt, _) => _ = interrupts.fetch_add(1, std::sync::atomic::Ordering::Relaxed),
            _ => unreachable!("it is for another rig"),
        }
    }

    /// Waits until nothing moves.
    fn assert_rest(&self, what: &str) {
        let start = Instant::now();
        let is_moving = || match &self.mover {
            // What is stuck in a move will not end it, but does not move either.
            Mover::Arm(arm) => {
                let before = arm.pose();
                thread::sleep(Duration::from_millis(3));
                arm.is_moving() && arm.pose() != before
            }
            Mover::Machine(machine) => {
                let before = machine.place();
                thread::sleep(Duration::from_millis(3));
                machine.is_moving() && machine.place() != before
            }
        };
        while is_moving() {
            assert!(start.elapsed() < UNREST, "{what}: it still moves after the capture");
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
            Mover::Machine(machine) => {
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
