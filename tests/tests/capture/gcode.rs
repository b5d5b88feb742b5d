//! The drivers for Grbl and Marlin with simulated machines and their faults.

use std::{
    thread,
    time::{Duration, Instant},
};

use multiscopic::capture::stage::{self, AnyStage, Limits, StageError, StageSpec};
use multiscopic_core::{
    Views,
    capture::{Camera, CaptureError, CaptureProgress, Plan, Policy, Position, Sequence, Stage},
};
use multiscopic_tests::simulated::machine::{Fault, Firmware, SimulatedMachine};

/// The position at which machines start, in millimetres.
const START: [f64; 2] = [120.5, 80.25];

/// The tolerance of positions in millimetres: reports are rounded to 0.01 mm twice.
const EXACTLY: f64 = 0.011;

/// Fast motions. Time-outs are long, since a pseudo-terminal may take a second to pass data on while the
/// system is busy.
fn limits() -> Limits {
    Limits {
        speed_mm_s: 100.0,
        connect_timeout: Duration::from_secs(3),
        silence_timeout: Duration::from_secs(3),
        stall_timeout: Duration::from_secs(1),
        ..Limits::default()
    }
}

/// Slow motions, which must still be under way when something else happens.
fn slow() -> Limits {
    Limits { speed_mm_s: 20.0, ..limits() }
}

fn machine(firmware: Firmware) -> SimulatedMachine {
    SimulatedMachine::start(firmware, START, Duration::ZERO)
}

fn open(machine: &SimulatedMachine) -> Result<AnyStage, StageError> {
    open_with(machine, &limits())
}

fn open_with(machine: &SimulatedMachine, limits: &Limits) -> Result<AnyStage, StageError> {
    stage::open(&machine.spec().parse::<StageSpec>()?, limits)
}

fn at(x_um: i32, y_um: i32) -> Position {
    Position { x_um, y_um }
}

/// Runs a test with each firmware in parallel, since they mostly wait.
fn each(test: impl Fn(Firmware) + Sync) {
    thread::scope(|scope| {
        for firmware in [Firmware::Grbl, Firmware::GrblInches, Firmware::Marlin] {
            let test = &test;
            thread::Builder::new().name(format!("{firmware:?}")).spawn_scoped(scope, move || test(firmware)).expect("a thread");
        }
    });
}

/// Waits until the stage has arrived, or fails.
fn arrive(stage: &mut AnyStage) -> Result<(), StageError> {
    let start = Instant::now();
    while !stage.has_arrived()? {
        assert!(start.elapsed() < Duration::from_secs(20), "the stage neither arrives nor fails");
        thread::sleep(Duration::from_millis(4));
    }
    Ok(())
}

fn go(stage: &mut AnyStage, position: Position) -> Result<(), StageError> {
    stage.move_to(position)?;
    arrive(stage)
}

/// Starts a move and waits until the machine is on its way.
fn set_out(stage: &mut AnyStage, machine: &SimulatedMachine, position: Position) {
    let start = machine.place();
    stage.move_to(position).unwrap();
    let begin = Instant::now();
    while machine.place() == start {
        assert!(begin.elapsed() < Duration::from_secs(5), "the machine does not move");
        thread::sleep(Duration::from_millis(1));
    }
}

#[track_caller]
fn assert_at(machine: &SimulatedMachine, x: f64, y: f64) {
    let place = machine.place();
    assert!((place[0] - x).abs() < EXACTLY && (place[1] - y).abs() < EXACTLY, "{place:?} instead of {:?}", [x, y]);
}

/// Calls `fails`, which must end soon after the longest time-out.
fn soon<T>(fails: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = fails();
    assert!(start.elapsed() < Duration::from_secs(15), "it took {:?}", start.elapsed());
    result
}

/// Whether a machine received an order to stop.
fn is_stop(heard: &[String]) -> bool {
    heard.iter().any(|line| line == "M410") || heard.windows(2).any(|pair| pair == ["!", "^X"])
}

#[test]
fn moves_to_positions() {
    each(|firmware| {
        let machine = machine(firmware);
        let mut stage = open(&machine).unwrap();
        assert_eq!(stage.position().unwrap(), Some(Position::CENTER), "{firmware:?}");
        // The machine's Y axis points up.
        for (position, x, y) in [
            (at(20_000, 0), 140.5, 80.25),
            (at(-20_000, 0), 100.5, 80.25),
            (at(0, -10_000), 120.5, 90.25),
            (at(0, 10_000), 120.5, 70.25),
            (at(0, 10_000), 120.5, 70.25),
            (at(0, 0), 120.5, 80.25),
        ] {
            go(&mut stage, position).unwrap();
            assert!(!machine.is_moving());
            assert_at(&machine, x, y);
            let off = stage.position().unwrap().unwrap().distance_um(position);
            assert!(off <= 5, "{firmware:?} is {off} um from {position:?}");
        }
        // No zero was set, and no move was relative.
        let heard = machine.heard();
        assert!(!heard.iter().any(|line| ["G92", "G54", "G10", "G91"].iter().any(|code| line.contains(code))), "{heard:?}");
    });
}

#[test]
fn nothing_moves_beyond_the_reach() {
    each(|firmware| {
        let machine = machine(firmware);
        let mut stage = open(&machine).unwrap();
        machine.heard();
        assert!(matches!(stage.move_to(at(100_001, 0)), Err(StageError::OutOfReach { .. })));
        assert_eq!(machine.heard(), [""; 0]);
    });
}

#[test]
fn a_booting_machine_is_waited_for() {
    each(|firmware| {
        let machine = SimulatedMachine::start(firmware, START, Duration::from_millis(1200));
        go(&mut open(&machine).unwrap(), at(1000, 0)).unwrap();
    });
}

#[test]
fn a_stop_halts_and_keeps_the_position() {
    each(|firmware| {
        let machine = machine(firmware);
        let mut stage = open_with(&machine, &slow()).unwrap();
        set_out(&mut stage, &machine, at(60_000, 0));
        assert!(!stage.has_arrived().unwrap());
        soon(|| stage.stop()).unwrap();
        assert!(!machine.is_moving() && is_stop(&machine.heard()), "{firmware:?}");
        let place = stage.position().unwrap().unwrap();
        assert!((1..59_000).contains(&place.x_um), "{firmware:?} stopped at {place:?}");
        assert!(!stage.has_arrived().unwrap());
        // Again, at rest.
        stage.stop().unwrap();
        go(&mut stage, at(0, 2000)).unwrap();
        assert_at(&machine, 120.5, 78.25);
        // Another order stops it too.
        set_out(&mut stage, &machine, at(60_000, 0));
        go(&mut stage, at(0, 0)).unwrap();
        assert_at(&machine, 120.5, 80.25);
        // So does dropping the stage.
        set_out(&mut stage, &machine, at(60_000, 0));
        machine.heard();
        drop(stage);
        assert!(!machine.is_moving() && is_stop(&machine.heard()), "{firmware:?}");
    });
}

#[test]
fn a_limit_switch_is_reported() {
    each(|firmware| {
        let machine = machine(firmware);
        let mut stage = open(&machine).unwrap();
        machine.fail(Fault::LimitSwitch { after_mm: 3.0 });
        let error = soon(|| go(&mut stage, at(40_000, 0))).unwrap_err();
        assert!(matches!(error, StageError::Alarm { .. }), "{error}");
        let _ = soon(|| stage.stop());
        assert!(is_stop(&machine.heard()) && !machine.is_moving());
        machine.fail(Fault::None);
        machine.lock(false);
        drop(stage);
        machine.restart();
        go(&mut open(&machine).unwrap(), at(1000, 0)).unwrap();
    });
}

#[test]
fn a_locked_machine_is_refused() {
    let machine = machine(Firmware::Grbl);
    open(&machine).unwrap();
    machine.lock(true);
    let error = soon(|| open(&machine)).map(drop).unwrap_err();
    assert!(matches!(error, StageError::Alarm { .. }) && error.to_string().contains("unlock"), "{error}");
    machine.lock(false);
    go(&mut open(&machine).unwrap(), at(1000, 0)).unwrap();
}

#[test]
fn a_rejected_line_is_reported() {
    each(|firmware| {
        let machine = machine(firmware);
        let mut stage = open(&machine).unwrap();
        machine.fail(Fault::Refusing);
        let error = soon(|| go(&mut stage, at(40_000, 0))).unwrap_err();
        assert!(matches!(&error, StageError::Refused { line, .. } if line.contains("G1 X160.5")), "{error}");
        let _ = soon(|| stage.stop());
        machine.fail(Fault::None);
        go(&mut stage, at(1000, 0)).unwrap();
        assert_at(&machine, 121.5, 80.25);
    });
}

#[test]
fn a_machine_that_never_arrives_times_out() {
    each(|firmware| {
        let machine = machine(firmware);
        let mut stage = open(&machine).unwrap();
        machine.fail(Fault::Stuck);
        let error = soon(|| go(&mut stage, at(40_000, 0))).unwrap_err();
        match firmware {
            Firmware::Marlin => assert!(matches!(error, StageError::Late { .. }), "{error}"),
            _ => assert!(matches!(error, StageError::Stalled { distance_um: 39_990..=40_010, .. }), "{error}"),
        }
        let _ = soon(|| stage.stop());
        assert!(is_stop(&machine.heard()) || firmware == Firmware::Marlin);
        machine.fail(Fault::None);
        while machine.is_moving() {
            thread::sleep(Duration::from_millis(10));
        }
        go(&mut stage, at(1000, 0)).unwrap();
        assert_at(&machine, 121.5, 80.25);
    });
}

#[test]
fn a_silent_machine_times_out() {
    each(|firmware| {
        let machine = machine(firmware);
        let mut stage = open_with(&machine, &Limits { silence_timeout: Duration::from_secs(1), ..limits() }).unwrap();
        set_out(&mut stage, &machine, at(40_000, 0));
        machine.fail(Fault::Silent);
        let error = soon(|| arrive(&mut stage)).unwrap_err();
        assert!(matches!(error, StageError::Silent { .. }), "{error}");
        assert!(matches!(soon(|| stage.stop()), Err(StageError::Silent { .. })));
        assert!(is_stop(&machine.heard()) && !machine.is_moving(), "{firmware:?} was not told to stop");
        drop(stage);
        let error = soon(|| open(&machine)).map(drop).unwrap_err();
        assert!(matches!(error, StageError::Silent { .. }), "{error}");
        machine.fail(Fault::None);
        go(&mut open(&machine).unwrap(), at(1000, 0)).unwrap();
    });
}

#[test]
fn a_machine_that_does_not_stop_is_reset() {
    let machine = machine(Firmware::Grbl);
    // The reset must come before the move ends.
    let mut stage = open_with(&machine, &Limits { silence_timeout: Duration::from_secs(1), ..slow() }).unwrap();
    machine.fail(Fault::Unstoppable);
    set_out(&mut stage, &machine, at(90_000, 0));
    let error = soon(|| stage.stop()).unwrap_err();
    assert!(matches!(error, StageError::StillMoving { .. }), "{error}");
    // The reset stopped it, and its position is lost.
    assert!(!machine.is_moving());
    assert!(matches!(stage.move_to(at(0, 0)), Err(StageError::Alarm { .. })));
}

#[test]
fn a_restart_loses_the_position() {
    each(|firmware| {
        let machine = machine(firmware);
        let mut stage = open_with(&machine, &slow()).unwrap();
        set_out(&mut stage, &machine, at(40_000, 0));
        machine.restart();
        let error = soon(|| arrive(&mut stage)).unwrap_err();
        assert!(matches!(error, StageError::Restarted { .. }), "{error}");
        // It must not be sent to its old coordinates, which are elsewhere now.
        machine.heard();
        assert!(matches!(stage.move_to(at(0, 0)), Err(StageError::Restarted { .. })));
        assert!(!machine.heard().iter().any(|line| line.contains("G1")));
        drop(stage);
        go(&mut open(&machine).unwrap(), at(1000, 0)).unwrap();
        assert_at(&machine, 1.0, 0.0);
    });
}

#[test]
fn an_unplugged_machine_is_reported() {
    each(|firmware| {
        let mut machine = machine(firmware);
        let mut stage = open_with(&machine, &slow()).unwrap();
        set_out(&mut stage, &machine, at(40_000, 0));
        machine.unplug();
        let error = soon(|| arrive(&mut stage)).unwrap_err();
        assert!(matches!(error, StageError::Disconnected { .. }), "{error}");
        assert!(matches!(soon(|| stage.stop()), Err(StageError::Disconnected { .. })));
        drop(stage);
        assert!(matches!(soon(|| open(&machine)), Err(StageError::Connect { .. } | StageError::Disconnected { .. })));
    });
}

#[test]
fn another_device_is_refused() {
    let machine = machine(Firmware::Grbl);
    machine.fail(Fault::OtherProtocol);
    let error = soon(|| open(&machine)).map(drop).unwrap_err();
    assert!(matches!(&error, StageError::Protocol { found, .. } if found.contains("$GPGGA")), "{error}");
    let error = stage::open(&"gcode:/dev/no-such-port".parse().unwrap(), &limits()).map(drop).unwrap_err();
    assert!(matches!(error, StageError::Connect { .. }) && error.to_string().contains("/dev/no-such-port"), "{error}");
    // Only one process can have it open.
    machine.fail(Fault::None);
    let first = open(&machine).unwrap();
    assert!(matches!(open(&machine), Err(StageError::Connect { .. })));
    drop(first);
    open(&machine).unwrap();
}

/// A camera with instantaneous frames, which fails if the machine moves.
struct Witness<'m>(&'m SimulatedMachine, Vec<[f64; 2]>);

impl Camera for Witness<'_> {
    type Error = std::convert::Infallible;

    fn begin(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }

    fn start(&mut self, _: usize) -> Result<(), Self::Error> {
        assert!(!self.0.is_moving());
        self.1.push(self.0.place());
        Ok(())
    }

    fn is_complete(&mut self) -> Result<bool, Self::Error> {
        Ok(true)
    }

    fn end(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

#[test]
fn a_sequence_compensates_backlash() {
    each(|firmware| {
        let machine = machine(firmware);
        let mut stage = open(&machine).unwrap();
        let plan = Plan::new(Views::HORIZONTAL, 15_000);
        let policy = Policy { settle: Duration::from_millis(5), backlash_um: 500, ..Policy::default() };
        let mut camera = Witness(&machine, Vec::new());
        let mut sequence: Sequence<'_, StageError, _> = Sequence::new(plan.positions(), policy);
        let begin = Instant::now();
        let ended: Result<(), CaptureError<_, _>> = loop {
            match sequence.poll(begin.elapsed(), &mut stage, &mut camera) {
                Ok(CaptureProgress::Done) => break Ok(()),
                Ok(_) => thread::sleep(Duration::from_millis(2)),
                Err(error) => break Err(error),
            }
        };
        ended.unwrap();
        for (place, x) in camera.1.iter().zip([120.5, 105.5, 135.5]) {
            assert!((place[0] - x).abs() < EXACTLY && (place[1] - 80.25).abs() < EXACTLY, "{firmware:?}: {place:?}");
        }
        assert_eq!(camera.1.len(), 3);
        assert_at(&machine, 120.5, 80.25);
    });
}
