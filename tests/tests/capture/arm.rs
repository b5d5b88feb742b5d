//! The driver of the arm with a simulated arm and its faults.

use std::{
    f64::consts::PI,
    io::{self, Write},
    net::TcpListener,
    sync::Arc,
    thread,
    time::Duration,
};

use crate::hostile_arm::{ANSWERS, hear};
use multiscopic::{
    capture::{
        Clock, SystemClock,
        stage::{self, AnyStage, Limits, PosedStage, SafetyMode, StageError, StageSpec},
    },
    images::Transform,
};
use multiscopic_core::{
    Views,
    capture::{Camera, CaptureError, CaptureProgress, Plan, Policy, Position, Sequence, Stage},
};
use multiscopic_reference::split_mix::Random;
use multiscopic_tests::simulated::{
    SimulatedClock,
    arm::{Fault, Heard, SimulatedArm},
    pose::{Pose, angle, distance},
};

/// A tool that looks down.
const DOWN: Pose = [0.4, -0.2, 0.5, PI, 0.0, 0.0];
/// A tool with an arbitrary orientation.
const ASKEW: Pose = [-0.3, 0.25, 0.6, 0.3, -1.2, 0.7];

/// The time limit for whatever a stage does. With an arm behind real sockets, only a hung test reaches it.
const PATIENCE: Duration = Duration::from_secs(120);

/// Fast motions and short time-outs, for an arm in simulated time.
fn limits() -> Limits {
    Limits {
        speed_mm_s: 250.0,
        acceleration_mm_s2: 1200.0,
        connect_timeout: Duration::from_secs(2),
        silence_timeout: Duration::from_millis(1500),
        stall_timeout: Duration::from_secs(1),
        ..Limits::default()
    }
}

/// Time-outs that only a hung test reaches, for an arm in the time of the system.
fn patient() -> Limits {
    Limits { connect_timeout: PATIENCE, silence_timeout: PATIENCE, stall_timeout: PATIENCE, ..limits() }
}

fn at(x_um: i32, y_um: i32) -> Position {
    Position { x_um, y_um }
}

/// An arm and the clock that it goes by.
#[derive(Clone)]
struct Bench {
    clock: Arc<dyn Clock>,
    arm: Arc<SimulatedArm>,
    limits: Limits,
}

impl Bench {
    /// An arm in simulated time.
    fn new(pose: Pose) -> Bench {
        let clock = Arc::new(SimulatedClock::default());
        Bench { arm: Arc::new(SimulatedArm::in_time_of(&clock, pose)), clock, limits: limits() }
    }

    /// An arm behind sockets, in the time of the system.
    fn behind_sockets(pose: Pose) -> Bench {
        Bench { arm: Arc::new(SimulatedArm::start(pose)), clock: Arc::new(SystemClock), limits: patient() }
    }

    fn open(&self) -> Result<AnyStage, StageError> {
        self.arm.stage(&self.limits)
    }

    /// Waits until `is_over`.
    fn wait(&self, what: &str, mut is_over: impl FnMut() -> Result<bool, StageError>) -> Result<(), StageError> {
        let start = self.clock.now();
        while !is_over()? {
            assert!(self.clock.now() - start < PATIENCE, "it never came that {what}");
            self.clock.sleep(Duration::from_millis(2));
        }
        Ok(())
    }

    /// Waits until the stage has arrived, or fails.
    fn arrive(&self, stage: &mut AnyStage) -> Result<(), StageError> {
        self.wait("the stage arrives or fails", || stage.has_arrived())
    }

    fn go(&self, stage: &mut AnyStage, position: Position) -> Result<(), StageError> {
        stage.move_to(position)?;
        self.arrive(stage)
    }

    /// Starts a move and waits until the arm is on its way.
    fn set_out(&self, stage: &mut AnyStage, position: Position) {
        let start = self.arm.pose();
        stage.move_to(position).unwrap();
        self.wait("the arm moves", || Ok(distance(self.arm.pose(), start) >= 1e-3)).unwrap();
    }

    /// Calls `fails`, which must end soon after the longest time-outs.
    fn soon<T>(&self, fails: impl FnOnce() -> T) -> T {
        let start = self.clock.now();
        let result = fails();
        let took = self.clock.now() - start;
        let Limits { connect_timeout, silence_timeout, .. } = self.limits;
        assert!(took < connect_timeout + silence_timeout + Duration::from_secs(2), "it took {took:?}");
        result
    }

    /// Waits until the arm has received the order to stop and stands still.
    fn stops(&self) {
        let mut heard = self.arm.heard();
        let has_stopped = || {
            heard.extend(self.arm.heard());
            Ok(!self.arm.is_moving() && heard.last() == Some(&Heard::Stop))
        };
        self.wait("the arm stopped", has_stopped).unwrap();
    }

    /// Stops the stage after an error, checks that the arm received the order, and repairs it. The stage then
    /// works, with the same centre.
    fn recovers(&self, stage: &mut AnyStage, start: Pose) {
        let _ = self.soon(|| stage.stop());
        self.stops();
        self.arm.release();
        self.soon(|| self.go(stage, at(0, 3000))).unwrap();
        assert_at(self.arm.pose(), moved(start, at(0, 3000)));
    }
}

/// The pose of a tool moved in its own plane, computed with a rotation matrix.
fn moved(start: Pose, position: Position) -> Pose {
    let [rx, ry, rz] = [start[3], start[4], start[5]];
    let angle = (rx * rx + ry * ry + rz * rz).sqrt();
    let [x, y, z] = [rx / angle, ry / angle, rz / angle];
    let (s, c) = angle.sin_cos();
    let t = 1.0 - c;
    // The first two columns: the tool's axes in the base's frame.
    let right = [t * x * x + c, t * x * y + s * z, t * x * z - s * y];
    let down = [t * x * y - s * z, t * y * y + c, t * y * z + s * x];
    let mut pose = start;
    for i in 0..3 {
        pose[i] += right[i] * f64::from(position.x_um) * 1e-6 + down[i] * f64::from(position.y_um) * 1e-6;
    }
    pose
}

#[track_caller]
fn assert_at(found: Pose, expected: Pose) {
    let off = (distance(found, expected), angle(found, expected));
    // The script rounds to nanometres and nanoradians.
    assert!(off.0 < 1e-8 && off.1 < 1e-8, "{found:?} is {off:?} from {expected:?}");
}

#[test]
fn the_pose_is_what_the_arm_measures() {
    let bench = Bench::new(ASKEW);
    let mut stage = bench.open().unwrap();
    bench.go(&mut stage, at(20_000, -5_000)).unwrap();
    let Transform { translation_mm, rotation_deg } = stage.pose().unwrap().expect("an arm measures poses");
    let expected = bench.arm.pose();
    for (axis, (mm, deg)) in translation_mm.into_iter().zip(rotation_deg).enumerate() {
        assert!((mm - 1e3 * expected[axis]).abs() < 1e-9, "{translation_mm:?} instead of {expected:?}");
        assert!((deg - expected[3 + axis].to_degrees()).abs() < 1e-9, "{rotation_deg:?} instead of {expected:?}");
    }
}

#[test]
fn moves_a_tool_that_looks_down() {
    let bench = Bench::new(DOWN);
    let mut stage = bench.open().unwrap();
    assert_eq!(stage.position().unwrap(), Some(Position::CENTER));
    // The tool's x axis is the base's; its y axis is reversed.
    for (position, x, y) in [
        (at(20_000, 0), 0.42, -0.2),
        (at(-20_000, 0), 0.38, -0.2),
        (at(0, -20_000), 0.4, -0.18),
        (at(0, 20_000), 0.4, -0.22),
        (at(0, 0), 0.4, -0.2),
    ] {
        bench.go(&mut stage, position).unwrap();
        assert_at(bench.arm.pose(), [x, y, 0.5, PI, 0.0, 0.0]);
        assert_eq!(stage.position().unwrap(), Some(position));
    }
}

#[test]
fn moves_a_tool_of_any_orientation() {
    let bench = Bench::new(ASKEW);
    let mut stage = bench.open().unwrap();
    // Repeating an order changes nothing.
    for position in [at(15_000, 0), at(-7_000, 12_345), at(-7_000, 12_345), at(0, -1)] {
        bench.go(&mut stage, position).unwrap();
        assert_at(bench.arm.pose(), moved(ASKEW, position));
        assert_eq!(stage.position().unwrap(), Some(position));
    }
    assert_eq!(bench.arm.heard().len(), 4);
}

#[test]
fn an_order_replaces_the_previous_one() {
    let bench = Bench::new(ASKEW);
    let mut stage = bench.open().unwrap();
    bench.set_out(&mut stage, at(90_000, 0));
    assert!(!stage.has_arrived().unwrap());
    bench.go(&mut stage, at(0, 2000)).unwrap();
    assert_at(bench.arm.pose(), moved(ASKEW, at(0, 2000)));
}

#[test]
fn nothing_moves_beyond_the_reach() {
    let bench = Bench::new(DOWN);
    let mut stage = bench.open().unwrap();
    for position in [at(100_001, 0), at(0, -100_001), at(80_000, 80_000), at(i32::MIN, i32::MIN)] {
        let refusal = stage.move_to(position).unwrap_err();
        assert!(matches!(refusal, StageError::OutOfReach { position: p, reach_um: 100_000 } if p == position), "{refusal}");
    }
    assert_eq!(bench.arm.heard(), []);
}

#[test]
fn a_stop_halts_the_arm() {
    let bench = Bench::new(DOWN);
    let mut stage = bench.open().unwrap();
    bench.set_out(&mut stage, at(90_000, 0));
    stage.stop().unwrap();
    assert!(!bench.arm.is_moving());
    let Some(Position { x_um, y_um: 0 }) = stage.position().unwrap() else { panic!("it is on its way") };
    assert!((1_000..80_000).contains(&x_um), "{x_um} um");
    assert!(!stage.has_arrived().unwrap(), "it is not where it was sent");
    // Again, at rest.
    stage.stop().unwrap();
    bench.recovers(&mut stage, DOWN);
}

#[test]
fn dropping_the_stage_halts_the_arm() {
    let bench = Bench::new(DOWN);
    let mut stage = bench.open().unwrap();
    bench.set_out(&mut stage, at(90_000, 0));
    drop(stage);
    assert!(!bench.arm.is_moving());
    assert_eq!(bench.arm.heard().last(), Some(&Heard::Stop));
    // At rest it sends nothing.
    let mut stage = bench.open().unwrap();
    bench.go(&mut stage, at(1000, 0)).unwrap();
    drop(stage);
    assert!(matches!(bench.arm.heard()[..], [Heard::Move(_)]));
}

#[test]
fn a_protective_stop_is_reported() {
    let bench = Bench::new(ASKEW);
    let mut stage = bench.open().unwrap();
    bench.arm.fail(Fault::ProtectiveStop { after_m: 0.01 });
    let error = bench.soon(|| bench.go(&mut stage, at(40_000, 0))).unwrap_err();
    assert!(matches!(error, StageError::SafetyStop(SafetyMode::PROTECTIVE_STOP)), "{error}");
    assert_eq!(error.to_string(), "the arm has stopped: protective stop (safety mode 3); release it at the teach pendant");
    // No order is sent to a stopped arm.
    bench.arm.heard();
    assert!(matches!(stage.move_to(at(0, 0)), Err(StageError::SafetyStop(_))));
    assert_eq!(bench.arm.heard(), []);
    bench.recovers(&mut stage, ASKEW);
}

#[test]
fn an_arm_that_never_arrives_times_out() {
    let bench = Bench::new(DOWN);
    let mut stage = bench.open().unwrap();
    bench.go(&mut stage, at(500, 0)).unwrap();
    bench.arm.fail(Fault::Stuck);
    let error = bench.soon(|| bench.go(&mut stage, at(20_000, 0))).unwrap_err();
    assert!(matches!(error, StageError::Stalled { distance_um: 19_490..19_510, .. }), "{error}");
    bench.recovers(&mut stage, DOWN);
}

#[test]
fn an_arm_that_ignores_orders_is_reported() {
    let bench = Bench::new(DOWN);
    let mut stage = bench.open().unwrap();
    bench.arm.fail(Fault::Ignoring);
    let error = bench.soon(|| bench.go(&mut stage, at(20_000, 0))).unwrap_err();
    assert!(matches!(error, StageError::Ignored { .. }), "{error}");
    bench.recovers(&mut stage, DOWN);
}

#[test]
fn local_control_is_reported() {
    let bench = Bench::new(DOWN);
    bench.arm.fail(Fault::LocalControl);
    let error = bench.soon(|| {
        let mut stage = bench.open()?;
        bench.clock.sleep(Duration::from_millis(50));
        bench.go(&mut stage, at(20_000, 0))
    });
    let error = error.unwrap_err();
    assert!(matches!(error, StageError::Disconnected { .. }) && error.to_string().contains("remote control"), "{error}");
    bench.arm.release();
    bench.go(&mut bench.open().unwrap(), at(1000, 0)).unwrap();
}

#[test]
fn a_silent_arm_times_out() {
    let bench = Bench::new(ASKEW);
    let mut stage = bench.open().unwrap();
    bench.set_out(&mut stage, at(90_000, 0));
    bench.arm.fail(Fault::Silent);
    let error = bench.soon(|| bench.arrive(&mut stage)).unwrap_err();
    assert!(matches!(error, StageError::Silent { .. }), "{error}");
    // The stop is not visible, but it is received.
    assert!(matches!(bench.soon(|| stage.stop()), Err(StageError::Silent { .. })));
    bench.recovers(&mut stage, ASKEW);

    bench.arm.fail(Fault::Silent);
    let error = bench.soon(|| bench.open()).map(drop).unwrap_err();
    assert!(matches!(&error, StageError::Silent { from, .. } if from.contains("arm.simulated")), "{error}");
    bench.arm.release();
    bench.open().unwrap();
}

#[test]
fn a_lost_connection_is_reported() {
    for (bench, is_simulated) in [(Bench::new(ASKEW), true), (Bench::behind_sockets(ASKEW), false)] {
        let mut stage = bench.open().unwrap();
        bench.set_out(&mut stage, at(90_000, 0));
        bench.arm.disconnect();
        let error = bench.soon(|| bench.arrive(&mut stage)).unwrap_err();
        assert!(matches!(error, StageError::Disconnected { .. }), "{error}");
        assert!(!is_simulated || bench.arm.is_moving(), "it goes on by itself");
        bench.recovers(&mut stage, ASKEW);
    }
}

#[test]
fn a_nonsensical_pose_is_reported() {
    let bench = Bench::new(DOWN);
    let mut stage = bench.open().unwrap();
    bench.set_out(&mut stage, at(90_000, 0));
    bench.arm.fail(Fault::Nonsense);
    let error = bench.soon(|| bench.arrive(&mut stage)).unwrap_err();
    assert!(matches!(&error, StageError::Protocol { found, .. } if found.contains("NaN")), "{error}");
    bench.recovers(&mut stage, DOWN);
}

#[test]
fn another_protocol_is_refused() {
    for bench in [Bench::new(DOWN), Bench::behind_sockets(DOWN)] {
        bench.arm.fail(Fault::OtherProtocol);
        let error = bench.open().map(drop).unwrap_err();
        assert!(matches!(&error, StageError::Protocol { found, .. } if found.contains("SSH-2.0")), "{error}");
        bench.arm.release();
        bench.open().unwrap();
    }
}

#[test]
fn an_address_without_an_arm_is_refused() {
    let open = |spec: &str, limits: &Limits| stage::open(&spec.parse().unwrap(), limits);
    let arm = SimulatedArm::start(DOWN);
    let (spec, ports) = (arm.spec(), arm.ports());
    drop(arm);
    // A closed port, an unknown name, an unknown host.
    for spec in [spec.as_str(), "ur10:no-such-arm.invalid", "ur10:192.0.2.1"] {
        let error = open(spec, &limits()).map(drop).unwrap_err();
        assert!(matches!(error, StageError::Connect { .. }), "{error}");
    }
    let arm = SimulatedArm::listen([127, 0, 0, 1].into(), ports, DOWN).unwrap();
    assert_eq!(arm.spec(), spec);
    open(&spec, &patient()).unwrap();
}

#[test]
fn an_arm_that_is_not_ready_is_refused() {
    let bench = Bench::new(DOWN);
    for (robot, safety, words) in [
        (5, 1, "the arm is idle with its brakes on"),
        (3, 1, "the arm is switched off"),
        (-1, 1, "the arm is without a controller"),
        (99, 1, "the arm is in mode 99"),
        (7, 5, "safeguard stop"),
        (7, 7, "emergency stop of the arm"),
        (7, 11, "safety mode 11"),
    ] {
        bench.arm.set_modes(robot, safety);
        let error = bench.open().map(drop).unwrap_err();
        assert!(matches!(error, StageError::NotReady { .. } | StageError::SafetyStop(_)), "{error}");
        assert!(error.to_string().contains(words), "{error}");
    }
    // Reduced speed does not prevent motions.
    bench.arm.set_modes(7, 2);
    bench.go(&mut bench.open().unwrap(), at(1000, 0)).unwrap();
}

/// Answers the first requests of the handshake, then waits for the end, or hangs up.
fn answering(answers: Vec<Vec<u8>>, waits: bool) -> StageSpec {
    let port = TcpListener::bind("127.0.0.1:0").unwrap();
    let spec = format!("ur10:127.0.0.1:{0},{0}", port.local_addr().unwrap().port());
    thread::spawn(move || -> io::Result<()> {
        let (mut stream, _) = port.accept()?;
        for answer in answers {
            hear(&mut stream)?;
            stream.write_all(&answer)?;
        }
        if waits { io::copy(&mut stream, &mut io::sink()).map(drop) } else { Ok(()) }
    });
    spec.parse().unwrap()
}

/// Answers the handshake as an arm does, then sends `noise`.
fn noisy(noise: Vec<u8>) -> StageSpec {
    let [version, recipe, start] = ANSWERS;
    answering(vec![version.into(), recipe.into(), [start, &noise].concat()], false)
}

#[test]
fn an_incomplete_handshake_names_what_came() {
    let [version, recipe, start] = ANSWERS.map(<[u8]>::to_vec);
    let lacking = b"\0\x33O\0DOUBLE,VECTOR6D,VECTOR6D,INT32,NOT_FOUND,UINT32".to_vec();
    // A sample of zeros in recipe 1, and a text.
    let sample = [&[0, 120, b'U', 1][..], &[0; 116]].concat();
    let text = b"\0\x0cM\x02hi\x04RTDE\x01".to_vec();
    let limits = Limits { connect_timeout: Duration::from_millis(600), ..patient() };
    for (answers, words) in [
        (vec![], "nothing came from the arm at 127.0.0.1"),
        (vec![version.clone(), lacking], "found a controller without the variables safety_mode, expected newer software"),
        (vec![version.clone(), recipe.clone(), sample.clone()], "found samples, but not an answer to the start within"),
        (vec![version.clone(), text], "found texts, but not an answer about the variables within"),
        (vec![version, recipe, start[..2].into()], "found a part of a package, but not an answer to the start within"),
    ] {
        let error = stage::open(&answering(answers, true), &limits).map(drop).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

#[test]
fn random_bytes_do_no_harm() {
    let mut random = Random(5);
    for i in 0..200 {
        let mut noise: Vec<u8> = (0..random.below(600)).map(|_| random.byte()).collect();
        // Half of the noise is in packages of the right type, some of the right length.
        if i % 2 == 0 {
            let length = if i % 4 == 0 { 4 + 116 } else { 3 + random.below(200) };
            noise.resize(length.max(4), 0xff);
            noise[..4].copy_from_slice(&[0, length as u8, b'U', 1]);
        }
        let error = stage::open(&noisy(noise), &patient()).map(drop).unwrap_err();
        assert!(matches!(error, StageError::Protocol { .. } | StageError::Disconnected { .. }), "{error}");
    }
}

/// A camera that notes the arm's pose while it takes a frame.
struct Witness {
    arm: Arc<SimulatedArm>,
    seen: Vec<(usize, Pose)>,
    polls: u32,
}

impl Camera for Witness {
    type Error = std::convert::Infallible;

    fn begin(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }

    fn start(&mut self, index: usize) -> Result<(), Self::Error> {
        self.seen.push((index, self.arm.pose()));
        self.polls = 0;
        Ok(())
    }

    fn is_complete(&mut self) -> Result<bool, Self::Error> {
        assert!(!self.arm.is_moving(), "a frame is taken while the arm moves");
        self.polls += 1;
        Ok(self.polls == 3)
    }

    fn end(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

type Failure = CaptureError<StageError, std::convert::Infallible>;

impl Bench {
    /// Runs a sequence to its end and calls `meanwhile` after each step.
    fn capture(
        &self,
        stage: &mut AnyStage,
        plan: &Plan,
        mut meanwhile: impl FnMut(CaptureProgress, &mut Sequence<'_, StageError, std::convert::Infallible>),
    ) -> (Result<(), Failure>, Vec<(usize, Pose)>) {
        let mut camera = Witness { arm: self.arm.clone(), seen: Vec::new(), polls: 0 };
        let policy = Policy { settle: Duration::from_millis(20), move_timeout: PATIENCE, ..Policy::default() };
        let mut sequence = Sequence::new(plan.positions(), policy);
        let begin = self.clock.now();
        loop {
            match sequence.poll(self.clock.now() - begin, stage, &mut camera) {
                Ok(CaptureProgress::Done) => return (Ok(()), camera.seen),
                Ok(progress) => meanwhile(progress, &mut sequence),
                Err(error) => return (Err(error), camera.seen),
            }
            self.clock.sleep(Duration::from_millis(2));
        }
    }
}

#[test]
fn a_sequence_takes_five_frames() {
    for bench in [Bench::new(ASKEW), Bench::behind_sockets(ASKEW)] {
        let mut stage = bench.open().unwrap();
        let plan = Plan::new(Views::CROSS, 20_000);
        let (ended, seen) = bench.capture(&mut stage, &plan, |_, _| ());
        ended.unwrap();
        assert_eq!(seen.len(), 5);
        for (i, ((index, pose), position)) in seen.into_iter().zip(plan.positions()).enumerate() {
            assert_eq!(index, i);
            assert_at(pose, moved(ASKEW, *position));
        }
        assert_at(bench.arm.pose(), ASKEW);
    }
}

#[test]
fn an_aborted_sequence_returns_to_the_centre() {
    let bench = Bench::new(DOWN);
    let mut stage = bench.open().unwrap();
    let plan = Plan::new(Views::HORIZONTAL, 50_000);
    // On the way to the left pose.
    let far = |progress| progress == CaptureProgress::Moving(1) && distance(bench.arm.pose(), DOWN) > 0.01;
    let (aborted, seen) = bench.capture(&mut stage, &plan, |progress, sequence| {
        if far(progress) {
            sequence.abort();
        }
    });
    assert!(matches!(aborted, Err(CaptureError::Aborted)) && seen.len() == 1);
    assert!(matches!(bench.arm.heard()[..], [Heard::Move(_), Heard::Move(_), Heard::Stop, Heard::Move(_)]));
    assert_at(bench.arm.pose(), DOWN);

    for fault in [Fault::ProtectiveStop { after_m: 0.02 }, Fault::Stuck, Fault::Silent, Fault::Nonsense] {
        let (failed, _) = bench.capture(&mut stage, &plan, |progress, _| {
            if far(progress) {
                bench.arm.fail(fault);
            }
        });
        assert!(failed.as_ref().is_err_and(CaptureError::is_of_stage), "{failed:?}");
        // Nothing tells that such an arm stands still.
        let is_unknown = matches!(fault, Fault::Silent | Fault::Nonsense);
        assert_eq!(matches!(failed, Err(CaptureError::NotStopped(_))), is_unknown, "{failed:?}");
        bench.stops();
        bench.arm.release();
        let (ended, seen) = bench.capture(&mut stage, &plan, |_, _| ());
        ended.unwrap();
        assert!(seen.len() == 3 && distance(bench.arm.pose(), DOWN) < 1e-8, "{fault:?}");
    }
}
