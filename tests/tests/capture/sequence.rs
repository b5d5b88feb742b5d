//! The capture sequence with a simulated slide that vibrates, has backlash, and fails.

use multiscopic_core::{
    Views,
    capture::{Camera, CaptureError, CaptureProgress, Plan, Policy, Position, Sequence, Stage},
};
use multiscopic_tests::test_images::case::property;
use proptest::prelude::*;
use std::{cell::Cell, rc::Rc, time::Duration};

/// The interval at which the sequence is polled.
const TICK: Duration = Duration::from_millis(10);
const BASELINE_UM: u32 = 20_000;
/// The backlash of the stage's screws, to each side.
const PLAY_UM: f64 = 150.0;
const SPEED_UM_PER_S: f64 = 50_000.0;
const POLICY: Policy = Policy {
    settle: Duration::from_millis(50),
    move_timeout: Duration::from_secs(3),
    frame_timeout: Duration::from_millis(400),
    retries: 2,
    tolerance_um: 100,
    backlash_um: 500,
    return_to_center: true,
};

/// A fault, at the move or frame of this number, or from it on.
#[derive(Clone, Copy, Debug)]
struct Fault {
    kind: Kind,
    number: usize,
    lasts: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    /// The order to move is refused.
    Refused,
    /// A protective stop interrupts the move.
    Protective,
    /// The stage never arrives.
    Stuck,
    /// The stage reports arrival but measures another position.
    Off,
    /// The stage is bumped while the frame is taken.
    Bumped,
    /// The camera cannot be configured.
    Unset,
    /// The camera does not start.
    NotStarted,
    /// The frame is damaged.
    Damaged,
    /// The frame never comes.
    Silent,
    /// The camera cannot be released.
    Unreleased,
}

impl Fault {
    fn hits(fault: Option<Fault>, kind: Kind, number: usize) -> bool {
        fault.is_some_and(|fault| fault.kind == kind && (number == fault.number || fault.lasts && number > fault.number))
    }
}

/// A slide driven by screws.
struct Slide {
    clock: Rc<Cell<Duration>>,
    fault: Option<Fault>,
    /// The position of the screws in micrometres.
    at: [f64; 2],
    /// The position of the camera.
    camera: Rc<Cell<[f64; 2]>>,
    target: [f64; 2],
    updated: Duration,
    moves: usize,
    stopped: bool,
    /// The distance by which the stage was bumped.
    bump: Rc<Cell<f64>>,
    /// The time at which the camera came to rest.
    still_since: Rc<Cell<Duration>>,
}

impl Slide {
    fn advance(&mut self) {
        let now = self.clock.get();
        let seconds = (now - self.updated).as_secs_f64();
        self.updated = now;
        let way = [0, 1].map(|axis| self.target[axis] - self.at[axis]);
        let length = way[0].hypot(way[1]);
        if self.stopped || length == 0.0 || Fault::hits(self.fault, Kind::Stuck, self.moves) {
            return;
        }
        let part = (SPEED_UM_PER_S * seconds / length).min(1.0);
        let mut camera = self.camera.get();
        for axis in [0, 1] {
            self.at[axis] = if part == 1.0 { self.target[axis] } else { self.at[axis] + part * way[axis] };
            camera[axis] = camera[axis].clamp(self.at[axis] - PLAY_UM, self.at[axis] + PLAY_UM);
        }
        self.camera.set(camera);
        self.still_since.set(now);
    }

    fn moving(&self) -> bool {
        !self.stopped && self.at != self.target
    }
}

impl Stage for Slide {
    type Error = &'static str;

    fn move_to(&mut self, position: Position) -> Result<(), &'static str> {
        self.advance();
        self.moves += 1;
        if Fault::hits(self.fault, Kind::Refused, self.moves) {
            return Err("refused");
        }
        self.bump.set(0.0);
        (self.target, self.stopped) = ([position.x_um.into(), position.y_um.into()], false);
        Ok(())
    }

    fn has_arrived(&mut self) -> Result<bool, &'static str> {
        self.advance();
        if Fault::hits(self.fault, Kind::Protective, self.moves) {
            self.stopped = true;
            return Err("protective stop");
        }
        Ok(self.at == self.target)
    }

    fn position(&mut self) -> Result<Option<Position>, &'static str> {
        self.advance();
        let off = if Fault::hits(self.fault, Kind::Off, self.moves) { 101.0 } else { self.bump.get() };
        let [x, y] = self.at.map(|at| (at + off) as i32);
        Ok(Some(Position { x_um: x, y_um: y }))
    }

    fn stop(&mut self) -> Result<(), &'static str> {
        self.advance();
        self.stopped = true;
        Ok(())
    }
}

/// A camera that takes 100 ms for a frame and notes its position.
struct Eye {
    clock: Rc<Cell<Duration>>,
    fault: Option<Fault>,
    camera: Rc<Cell<[f64; 2]>>,
    still_since: Rc<Cell<Duration>>,
    bump: Rc<Cell<f64>>,
    begun: bool,
    ends: usize,
    starts: usize,
    index: usize,
    exposed: Duration,
    /// The index and position of each complete frame.
    frames: Vec<(usize, [f64; 2])>,
}

impl Camera for Eye {
    type Error = &'static str;

    fn begin(&mut self) -> Result<(), &'static str> {
        assert!(!self.begun, "it has begun already");
        self.begun = true;
        if Fault::hits(self.fault, Kind::Unset, 0) { Err("unset") } else { Ok(()) }
    }

    fn start(&mut self, index: usize) -> Result<(), &'static str> {
        assert!(self.begun);
        let now = self.clock.get();
        assert!(now - self.still_since.get() >= POLICY.settle - TICK, "vibrations have not faded");
        self.starts += 1;
        (self.index, self.exposed) = (index, now);
        if Fault::hits(self.fault, Kind::NotStarted, self.starts) { Err("not started") } else { Ok(()) }
    }

    fn is_complete(&mut self) -> Result<bool, &'static str> {
        assert!(self.begun);
        if Fault::hits(self.fault, Kind::Damaged, self.starts) {
            return Err("damaged");
        }
        let complete =
            self.clock.get() - self.exposed >= Duration::from_millis(100) && !Fault::hits(self.fault, Kind::Silent, self.starts);
        if complete && Fault::hits(self.fault, Kind::Bumped, self.starts) {
            self.bump.set(-5000.0);
        } else if complete {
            assert!(self.still_since.get() <= self.exposed, "moved while it was exposed");
            self.frames.push((self.index, self.camera.get()));
        }
        Ok(complete)
    }

    fn end(&mut self) -> Result<(), &'static str> {
        self.begun = false;
        self.ends += 1;
        if Fault::hits(self.fault, Kind::Unreleased, 0) { Err("unreleased") } else { Ok(()) }
    }
}

type Outcome = Result<CaptureProgress, CaptureError<&'static str, &'static str>>;

struct World {
    clock: Rc<Cell<Duration>>,
    slide: Slide,
    eye: Eye,
}

impl World {
    fn new(fault: Option<Fault>) -> World {
        let (clock, still_since) = (Rc::<Cell<Duration>>::default(), Rc::<Cell<Duration>>::default());
        let (camera, bump) = (Rc::<Cell<[f64; 2]>>::default(), Rc::<Cell<f64>>::default());
        World {
            clock: clock.clone(),
            slide: Slide {
                clock: clock.clone(),
                fault,
                at: [0.0; 2],
                camera: camera.clone(),
                target: [0.0; 2],
                updated: Duration::ZERO,
                moves: 0,
                stopped: false,
                bump: bump.clone(),
                still_since: still_since.clone(),
            },
            eye: Eye {
                clock,
                fault,
                camera,
                still_since,
                bump,
                begun: false,
                ends: 0,
                starts: 0,
                index: 0,
                exposed: Duration::ZERO,
                frames: Vec::new(),
            },
        }
    }

    /// Captures to the end. `each` is told every step, and may abort.
    fn capture(&mut self, positions: &[Position], policy: Policy, mut each: impl FnMut(CaptureProgress) -> bool) -> Outcome {
        let mut sequence = Sequence::new(positions, policy);
        let start = self.clock.get();
        loop {
            self.clock.set(self.clock.get() + TICK);
            match sequence.poll(self.clock.get(), &mut self.slide, &mut self.eye) {
                Ok(CaptureProgress::Done) => return Ok(CaptureProgress::Done),
                Ok(progress) => {
                    if each(progress) {
                        sequence.abort();
                    }
                }
                Err(error) => {
                    let again = sequence.poll(self.clock.get(), &mut self.slide, &mut self.eye);
                    assert_eq!(again, Err(CaptureError::Ended));
                    return Err(error);
                }
            }
            // Up to three attempts for each frame and for each of the six moves, which go by way of the start
            // of the approach.
            let longest = 6 * 3 * (2 * POLICY.move_timeout + POLICY.settle + 3 * POLICY.frame_timeout);
            assert!(self.clock.get() - start < longest, "it takes too long");
        }
    }

    /// Checks what must hold at the end of every capture.
    fn assert_at_rest(&mut self, outcome: &Outcome, captures: usize) {
        self.clock.set(self.clock.get() + TICK);
        self.slide.advance();
        assert!(!self.slide.moving(), "{outcome:?}: the stage still moves");
        assert_eq!((self.eye.begun, self.eye.ends), (false, captures), "{outcome:?}: the camera was not released");
        match outcome {
            Err(error) if error.is_of_stage() => assert!(self.slide.stopped, "{error}: the stage was not stopped"),
            Err(CaptureError::Camera { error: "unset", .. }) => assert!(self.slide.stopped),
            _ => assert_eq!(self.slide.at, [0.0; 2], "{outcome:?}: the stage did not return"),
        }
    }
}

fn faults() -> impl Strategy<Value = Fault> {
    use Kind::{Bumped, Damaged, NotStarted, Off, Protective, Refused, Silent, Stuck, Unreleased, Unset};
    let kind =
        prop::sample::select(vec![Refused, Protective, Stuck, Off, Bumped, Unset, NotStarted, Damaged, Silent, Unreleased]);
    (kind, 1..=13_usize, any::<bool>()).prop_map(|(kind, number, lasts)| match kind {
        Unset | Unreleased => Fault { kind, number: 0, lasts },
        _ => Fault { kind, number, lasts },
    })
}

/// Views of an array of three by three.
fn views() -> impl Strategy<Value = Views> {
    (1..=255_u8)
        .prop_map(|bits| (0..).zip(Views::ARRAY.iter()).filter(|(k, _)| bits >> k & 1 != 0).map(|(_, view)| view).collect())
}

#[test]
fn frames_are_one_baseline_apart_despite_backlash() {
    property(64, (views(), prop::array::uniform2(-PLAY_UM..PLAY_UM)), |&(views, lag)| {
        let plan = Plan::new(views, BASELINE_UM);
        let mut world = World::new(None);
        world.slide.camera.set(lag);
        let mut captured = Vec::new();
        let outcome = world.capture(plan.positions(), POLICY, |progress| {
            if let CaptureProgress::Captured(index) = progress {
                captured.push(index);
            }
            false
        });
        assert_eq!(outcome, Ok(CaptureProgress::Done));
        world.assert_at_rest(&outcome, 1);
        assert_eq!(captured, (0..plan.frames().len()).collect::<Vec<_>>());
        let (indices, places): (Vec<usize>, Vec<[f64; 2]>) = world.eye.frames.into_iter().unzip();
        assert_eq!(indices, captured);
        let baseline = f64::from(BASELINE_UM);
        for (view, place) in views.iter().zip(&places[1..]) {
            let [dx, dy] = [view.right(), view.down()].map(|baselines| f64::from(baselines) * baseline);
            assert_eq!(*place, [places[0][0] + dx, places[0][1] + dy], "{view:?}");
        }
    });
}

#[test]
fn without_a_one_sided_approach_backlash_shows() {
    let mut world = World::new(None);
    let plan = Plan::new(Views::HORIZONTAL, BASELINE_UM);
    assert!(world.capture(plan.positions(), Policy { backlash_um: 0, ..POLICY }, |_| false).is_ok());
    let [center, left] = [0, 1].map(|i| world.eye.frames[i].1[0]);
    assert_eq!(center - left, f64::from(BASELINE_UM) - PLAY_UM);
}

#[test]
fn an_array_of_nine_takes_the_same_sequence() {
    let positions: [Position; 9] =
        std::array::from_fn(|i| Position { x_um: 10_000 * (i as i32 % 3 - 1), y_um: 10_000 * (i as i32 / 3 - 1) });
    let mut world = World::new(None);
    let outcome = world.capture(&positions, POLICY, |_| false);
    world.assert_at_rest(&outcome, 1);
    assert_eq!(world.eye.frames.len(), 9);
    for (frame, position) in world.eye.frames.iter().zip(positions) {
        assert_eq!(frame.1, [position.x_um, position.y_um].map(|um| f64::from(um) - PLAY_UM));
    }
}

#[test]
fn every_fault_ends_at_rest_and_the_next_capture_works() {
    property(2000, (views(), faults(), any::<bool>()), |&(views, fault, backlash)| {
        let plan = Plan::new(views, BASELINE_UM);
        let policy = Policy { backlash_um: if backlash { POLICY.backlash_um } else { 0 }, ..POLICY };
        let frames = plan.frames().len();
        // Including the way back.
        let moves = if backlash { 2 * frames } else { frames } + 1;
        let mut world = World::new(Some(fault));
        let (mut retries, mut captured) = (0, 0);
        let outcome = world.capture(plan.positions(), policy, |progress| {
            retries += usize::from(matches!(progress, CaptureProgress::Retrying(_)));
            captured += usize::from(matches!(progress, CaptureProgress::Captured(_)));
            false
        });
        world.assert_at_rest(&outcome, 1);
        let Fault { kind, number, lasts } = fault;
        let index = number.wrapping_sub(1);
        let camera = |error| Err(CaptureError::Camera { index, error });
        let whole = || assert_eq!((outcome, captured), (Ok(CaptureProgress::Done), frames), "{fault:?}");
        match kind {
            Kind::Refused if number <= moves => assert_eq!(outcome, Err(CaptureError::Stage("refused"))),
            Kind::Protective if number <= moves => assert_eq!(outcome, Err(CaptureError::Stage("protective stop"))),
            // Without an approach, the first move has no distance.
            Kind::Stuck if number <= moves && (lasts || backlash || number > 1) => {
                assert_eq!(outcome, Err(CaptureError::MoveTimeout { after: policy.move_timeout }));
            }
            Kind::Off if lasts && number < moves => assert!(matches!(outcome, Err(CaptureError::Missed { .. })), "{outcome:?}"),
            Kind::Bumped if lasts && number <= frames => {
                assert!(matches!(outcome, Err(CaptureError::Missed { index: at, .. }) if at == index), "{outcome:?}");
            }
            Kind::Unset => assert_eq!(outcome, Err(CaptureError::Camera { index: 0, error: "unset" })),
            Kind::Unreleased => assert_eq!(outcome, Err(CaptureError::Camera { index: frames - 1, error: "unreleased" })),
            Kind::NotStarted if lasts && number <= frames => assert_eq!(outcome, camera("not started")),
            Kind::Damaged if lasts && number <= frames => assert_eq!(outcome, camera("damaged")),
            Kind::Silent if lasts && number <= frames => {
                assert_eq!(outcome, Err(CaptureError::FrameTimeout { index, after: policy.frame_timeout }));
            }
            // Faults that occur once are retried.
            Kind::Bumped | Kind::NotStarted | Kind::Damaged | Kind::Silent if number <= frames => {
                whole();
                assert_eq!(retries, 1, "{fault:?}");
            }
            _ => whole(),
        }
        (world.slide.fault, world.eye.fault) = (None, None);
        world.eye.frames.clear();
        let outcome = world.capture(plan.positions(), policy, |_| false);
        assert_eq!(outcome, Ok(CaptureProgress::Done), "after {fault:?}");
        world.assert_at_rest(&outcome, 2);
        assert_eq!(world.eye.frames.len(), frames);
    });
}

#[test]
fn an_abort_returns_and_a_second_one_stays() {
    property(500, (views(), 1..700_usize, 1..60_usize), |&(views, first, between)| {
        let plan = Plan::new(views, BASELINE_UM);
        let mut world = World::new(None);
        let (mut polls, mut returning) = (0, false);
        let outcome = world.capture(plan.positions(), POLICY, |progress| {
            polls += 1;
            returning |= progress == CaptureProgress::Returning;
            polls == first
        });
        match outcome {
            Ok(progress) => assert!(progress == CaptureProgress::Done && polls < first),
            // On the way back, an abort only stops.
            Err(error) => assert_eq!(error, CaptureError::Aborted),
        }
        world.slide.advance();
        assert!(!world.slide.moving() && !world.eye.begun);

        let mut polls = 0;
        let outcome = world.capture(plan.positions(), POLICY, |_| {
            polls += 1;
            polls == 3 || polls == 3 + between
        });
        assert_eq!(outcome, Err(CaptureError::Aborted));
        world.slide.advance();
        assert!(!world.slide.moving() && !world.eye.begun && returning | (polls > 0));
    });
}

/// A stage that is there at once, but so far off.
struct OffBy(u32, Position);

impl Stage for OffBy {
    type Error = ();

    fn move_to(&mut self, position: Position) -> Result<(), ()> {
        self.1 = position;
        Ok(())
    }

    fn has_arrived(&mut self) -> Result<bool, ()> {
        Ok(true)
    }

    fn position(&mut self) -> Result<Option<Position>, ()> {
        Ok(Some(Position { x_um: self.1.x_um - self.0 as i32, y_um: self.1.y_um + 3 }))
    }

    fn stop(&mut self) -> Result<(), ()> {
        Ok(())
    }
}

/// A camera that takes a frame at once.
struct Ready;

impl Camera for Ready {
    type Error = ();

    fn begin(&mut self) -> Result<(), ()> {
        Ok(())
    }

    fn start(&mut self, _: usize) -> Result<(), ()> {
        Ok(())
    }

    fn is_complete(&mut self) -> Result<bool, ()> {
        Ok(true)
    }

    fn end(&mut self) -> Result<(), ()> {
        Ok(())
    }
}

#[test]
fn tolerances_and_waiting_times_are_exact() {
    let positions = [Position { x_um: 20_000, y_um: 0 }];
    let outcome = |off: u32| {
        let (mut sequence, mut stage) = (Sequence::new(&positions, POLICY), OffBy(off, Position::CENTER));
        let mut now = Duration::ZERO;
        loop {
            match sequence.poll(now, &mut stage, &mut Ready) {
                Ok(CaptureProgress::Settling(_)) => {
                    // Its time begins now. A moment before its end it is not over, and at its end it is.
                    let before = now + POLICY.settle - Duration::from_nanos(1);
                    assert_eq!(sequence.poll(before, &mut stage, &mut Ready), Ok(CaptureProgress::Settling(0)));
                    now += POLICY.settle;
                    assert_ne!(sequence.poll(now, &mut stage, &mut Ready)?, CaptureProgress::Settling(0));
                }
                Ok(CaptureProgress::Done) => return Ok(CaptureProgress::Done),
                Err(error) => return Err(error),
                Ok(_) => now += TICK,
            }
        }
    };
    assert_eq!(outcome(POLICY.tolerance_um), Ok(CaptureProgress::Done));
    assert!(matches!(outcome(POLICY.tolerance_um + 1), Err(CaptureError::Missed { index: 0, .. })));
}
