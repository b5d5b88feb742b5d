//! The drivers for Grbl and for firmwares of the RepRap family with simulated machines and their faults.

use std::{sync::Arc, time::Duration};

use multiscopic::capture::{
    Clock, SystemClock,
    stage::{self, AnyStage, Limits, StageError},
};
use multiscopic_core::{
    Views,
    capture::{Camera, CaptureError, CaptureProgress, Plan, Policy, Position, Sequence, Stage},
};
use multiscopic_tests::simulated::{
    SimulatedClock,
    machine::{Fault, Firmware, RepRapKind, SimulatedMachine},
};

/// The position at which machines start, in millimetres.
const START: [f64; 2] = [120.5, 80.25];

/// The tolerance of positions in millimetres: reports are rounded to 0.01 mm twice.
const EXACTLY: f64 = 0.011;

/// The time limit for whatever a stage does. With a machine at a real terminal, only a hung test reaches it.
const PATIENCE: Duration = Duration::from_secs(120);

/// Fast motions.
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

/// Time-outs that only a hung test reaches, for a machine in the time of the system.
fn patient(limits: Limits) -> Limits {
    Limits { connect_timeout: PATIENCE, silence_timeout: PATIENCE, stall_timeout: PATIENCE, ..limits }
}

fn at(x_um: i32, y_um: i32) -> Position {
    Position { x_um, y_um }
}

/// A machine and the clock that it goes by.
struct Bench {
    clock: Arc<dyn Clock>,
    machine: SimulatedMachine,
}

impl Bench {
    /// A machine in simulated time.
    fn new(firmware: Firmware) -> Bench {
        Bench::booting(firmware, Duration::ZERO)
    }

    /// A machine in simulated time, which takes a while to boot.
    fn booting(firmware: Firmware, boot: Duration) -> Bench {
        let clock = Arc::new(SimulatedClock::default());
        Bench { machine: SimulatedMachine::in_time_of(&clock, firmware, START, boot), clock }
    }

    /// A machine at a pseudo-terminal, in the time of the system.
    fn at_terminal(firmware: Firmware) -> Bench {
        Bench { machine: SimulatedMachine::start(firmware, START, Duration::ZERO), clock: Arc::new(SystemClock) }
    }

    fn open(&self) -> Result<AnyStage, StageError> {
        self.machine.stage(&limits())
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

    /// Starts a move and waits until the machine is on its way.
    fn set_out(&self, stage: &mut AnyStage, position: Position) {
        let start = self.machine.place();
        stage.move_to(position).unwrap();
        self.wait("the machine moves", || Ok(self.machine.place() != start)).unwrap();
    }

    #[track_caller]
    fn assert_at(&self, x: f64, y: f64) {
        let place = self.machine.place();
        assert!((place[0] - x).abs() < EXACTLY && (place[1] - y).abs() < EXACTLY, "{place:?} instead of {:?}", [x, y]);
    }

    /// Calls `fails`, which must end soon after the longest time-out, in simulated time.
    fn soon<T>(&self, fails: impl FnOnce() -> T) -> T {
        let start = self.clock.now();
        let result = fails();
        let took = self.clock.now() - start;
        assert!(took < Duration::from_secs(5), "it took {took:?}");
        result
    }
}

/// Runs a test with each firmware.
fn each(test: impl Fn(Firmware)) {
    Firmware::ALL.into_iter().for_each(test);
}

/// Returns true if a machine with this firmware received an order to stop. The RepRap family is just sent no more segments.
fn is_stop(firmware: Firmware, heard: &[String]) -> bool {
    matches!(firmware, Firmware::RepRap(_)) || heard.windows(2).any(|pair| pair == ["!", "^X"])
}

#[test]
fn moves_to_positions() {
    each(|firmware| {
        let bench = Bench::new(firmware);
        let mut stage = bench.open().unwrap();
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
            bench.go(&mut stage, position).unwrap();
            assert!(!bench.machine.is_moving());
            bench.assert_at(x, y);
            let off = stage.position().unwrap().unwrap().distance_um(position);
            assert!(off <= 5, "{firmware:?} is {off} um from {position:?}");
        }
        // No zero was set, and no move was relative.
        let heard = bench.machine.heard();
        assert!(!heard.iter().any(|line| ["G92", "G54", "G10", "G91"].iter().any(|code| line.contains(code))), "{heard:?}");
    });
}

#[test]
fn nothing_moves_beyond_the_reach() {
    each(|firmware| {
        let bench = Bench::new(firmware);
        let mut stage = bench.open().unwrap();
        bench.machine.heard();
        assert!(matches!(stage.move_to(at(100_001, 0)), Err(StageError::OutOfReach { .. })));
        assert_eq!(bench.machine.heard(), [""; 0]);
    });
}

#[test]
fn a_booting_machine_is_waited_for() {
    each(|firmware| {
        let bench = Bench::booting(firmware, Duration::from_millis(1200));
        bench.go(&mut bench.open().unwrap(), at(1000, 0)).unwrap();
    });
}

#[test]
fn a_stop_halts_and_keeps_the_position() {
    each(|firmware| {
        let bench = Bench::new(firmware);
        let mut stage = bench.machine.stage(&slow()).unwrap();
        bench.set_out(&mut stage, at(60_000, 0));
        assert!(!stage.has_arrived().unwrap());
        bench.soon(|| stage.stop()).unwrap();
        assert!(!bench.machine.is_moving() && is_stop(firmware, &bench.machine.heard()), "{firmware:?}");
        let place = stage.position().unwrap().unwrap();
        assert!((1..59_000).contains(&place.x_um), "{firmware:?} stopped at {place:?}");
        assert!(!stage.has_arrived().unwrap());
        // Again, at rest.
        stage.stop().unwrap();
        bench.go(&mut stage, at(0, 2000)).unwrap();
        bench.assert_at(120.5, 78.25);
        // Another order stops it too.
        bench.set_out(&mut stage, at(60_000, 0));
        bench.go(&mut stage, at(0, 0)).unwrap();
        bench.assert_at(120.5, 80.25);
        // So does dropping the stage.
        bench.set_out(&mut stage, at(60_000, 0));
        bench.machine.heard();
        drop(stage);
        assert!(!bench.machine.is_moving() && is_stop(firmware, &bench.machine.heard()), "{firmware:?}");
    });
}

#[test]
fn a_limit_switch_is_reported() {
    each(|firmware| {
        let bench = Bench::new(firmware);
        let mut stage = bench.open().unwrap();
        bench.machine.fail(Fault::LimitSwitch { after_mm: 3.0 });
        let error = bench.soon(|| bench.go(&mut stage, at(40_000, 0))).unwrap_err();
        assert!(matches!(error, StageError::Alarm { .. }), "{error}");
        let _ = bench.soon(|| stage.stop());
        assert!(is_stop(firmware, &bench.machine.heard()) && !bench.machine.is_moving());
        bench.machine.fail(Fault::None);
        bench.machine.lock(false);
        drop(stage);
        bench.machine.restart();
        bench.go(&mut bench.open().unwrap(), at(1000, 0)).unwrap();
    });
}

#[test]
fn a_locked_machine_is_refused() {
    let bench = Bench::new(Firmware::Grbl);
    bench.open().unwrap();
    bench.machine.lock(true);
    let error = bench.soon(|| bench.open()).map(drop).unwrap_err();
    assert!(matches!(error, StageError::Alarm { .. }) && error.to_string().contains("unlock"), "{error}");
    bench.machine.lock(false);
    bench.go(&mut bench.open().unwrap(), at(1000, 0)).unwrap();
}

#[test]
fn a_rejected_line_is_reported() {
    each(|firmware| {
        let bench = Bench::new(firmware);
        let mut stage = bench.open().unwrap();
        bench.machine.fail(Fault::Refusing);
        let error = bench.soon(|| bench.go(&mut stage, at(40_000, 0))).unwrap_err();
        assert!(matches!(&error, StageError::Refused { line, .. } if line.contains("G1 X")), "{error}");
        let _ = bench.soon(|| stage.stop());
        bench.machine.fail(Fault::None);
        bench.go(&mut stage, at(1000, 0)).unwrap();
        bench.assert_at(121.5, 80.25);
    });
}

#[test]
fn the_end_of_the_travel_is_found() {
    for firmware in Firmware::ALL.into_iter().filter(|firmware| matches!(firmware, Firmware::RepRap(_))) {
        let bench = Bench::new(firmware);
        let mut stage = bench.open().unwrap();
        bench.machine.fail(Fault::SoftLimit { at_x: 125.0 });
        let error = bench.soon(|| bench.go(&mut stage, at(40_000, 0))).unwrap_err().to_string();
        assert!(error.contains("it is at X125.00 Y80.25; is that the end of its travel?"), "{error}");
        stage.stop().unwrap();
        bench.go(&mut stage, at(1000, 0)).unwrap();
        bench.assert_at(121.5, 80.25);
    }
}

#[test]
fn other_firmware_is_refused_by_name() {
    let bench = Bench::new(Firmware::RepRap(RepRapKind::Other));
    let error = bench.open().map(drop).unwrap_err().to_string();
    assert!(error.contains("found the firmware Teacup") && error.contains("Klipper"), "{error}");
    assert!(!bench.machine.heard().iter().any(|line| line.contains("G1")));
}

#[test]
fn a_machine_that_never_arrives_times_out() {
    each(|firmware| {
        let bench = Bench::new(firmware);
        let mut stage = bench.open().unwrap();
        bench.machine.fail(Fault::Stuck);
        let error = bench.soon(|| bench.go(&mut stage, at(40_000, 0))).unwrap_err();
        match firmware {
            Firmware::MARLIN => assert!(matches!(error, StageError::Late { .. }), "{error}"),
            // The others do not say that they are busy.
            Firmware::RepRap(_) => assert!(matches!(error, StageError::Silent { .. }), "{error}"),
            _ => assert!(matches!(error, StageError::Stalled { distance_um: 39_990..=40_010, .. }), "{error}"),
        }
        let _ = bench.soon(|| stage.stop());
        assert!(is_stop(firmware, &bench.machine.heard()));
        bench.machine.fail(Fault::None);
        bench.wait("the machine stands", || Ok(!bench.machine.is_moving())).unwrap();
        bench.go(&mut stage, at(1000, 0)).unwrap();
        bench.assert_at(121.5, 80.25);
    });
}

#[test]
fn a_silent_machine_times_out() {
    each(|firmware| {
        let bench = Bench::new(firmware);
        let mut stage = bench.machine.stage(&Limits { silence_timeout: Duration::from_secs(1), ..limits() }).unwrap();
        bench.set_out(&mut stage, at(40_000, 0));
        bench.machine.fail(Fault::Silent);
        let error = bench.soon(|| bench.arrive(&mut stage)).unwrap_err();
        assert!(matches!(error, StageError::Silent { .. }), "{error}");
        assert!(matches!(bench.soon(|| stage.stop()), Err(StageError::Silent { .. })));
        assert!(is_stop(firmware, &bench.machine.heard()) && !bench.machine.is_moving(), "{firmware:?} was not told to stop");
        drop(stage);
        let error = bench.soon(|| bench.open()).map(drop).unwrap_err();
        assert!(matches!(error, StageError::Silent { .. }), "{error}");
        bench.machine.fail(Fault::None);
        bench.go(&mut bench.open().unwrap(), at(1000, 0)).unwrap();
    });
}

#[test]
fn a_machine_that_does_not_stop_is_reset() {
    let bench = Bench::new(Firmware::Grbl);
    // The reset must come before the move ends.
    let mut stage = bench.machine.stage(&Limits { silence_timeout: Duration::from_secs(1), ..slow() }).unwrap();
    bench.machine.fail(Fault::Unstoppable);
    bench.set_out(&mut stage, at(90_000, 0));
    bench.soon(|| stage.stop()).unwrap();
    // The reset stopped it, and its position is lost.
    assert!(!bench.machine.is_moving());
    assert!(matches!(stage.move_to(at(0, 0)), Err(StageError::Alarm { .. })));
}

#[test]
fn a_restart_loses_the_position() {
    each(|firmware| {
        let bench = Bench::new(firmware);
        let mut stage = bench.machine.stage(&slow()).unwrap();
        bench.set_out(&mut stage, at(40_000, 0));
        bench.machine.restart();
        let error = bench.soon(|| bench.arrive(&mut stage)).unwrap_err();
        assert!(matches!(error, StageError::Restarted { .. }), "{error}");
        // It must not be sent to its old coordinates, which are elsewhere now.
        bench.machine.heard();
        assert!(matches!(stage.move_to(at(0, 0)), Err(StageError::Restarted { .. })));
        assert!(!bench.machine.heard().iter().any(|line| line.contains("G1")));
        drop(stage);
        bench.go(&mut bench.open().unwrap(), at(1000, 0)).unwrap();
        bench.assert_at(1.0, 0.0);
    });
}

#[test]
fn an_unplugged_machine_is_reported() {
    each(|firmware| {
        for (mut bench, limits) in [(Bench::new(firmware), slow()), (Bench::at_terminal(firmware), patient(slow()))] {
            let mut stage = bench.machine.stage(&limits).unwrap();
            bench.set_out(&mut stage, at(40_000, 0));
            bench.machine.unplug();
            let error = bench.arrive(&mut stage).unwrap_err();
            assert!(matches!(error, StageError::Disconnected { .. }), "{error}");
            assert!(matches!(stage.stop(), Err(StageError::Disconnected { .. })));
            drop(stage);
            let error = bench.machine.stage(&limits).map(drop).unwrap_err();
            assert!(matches!(error, StageError::Connect { .. } | StageError::Disconnected { .. }), "{error}");
        }
    });
}

#[test]
fn another_device_is_refused() {
    let bench = Bench::at_terminal(Firmware::Grbl);
    bench.machine.fail(Fault::OtherProtocol);
    // It speaks from the start, so that the refusal needs no patience, however late its words come.
    let error = loop {
        match bench.machine.stage(&Limits { connect_timeout: Duration::from_secs(1), ..limits() }).map(drop).unwrap_err() {
            StageError::Silent { .. } => {}
            error => break error,
        }
    };
    assert!(matches!(&error, StageError::Protocol { found, .. } if found.contains("$GPGGA")), "{error}");
    let error = stage::open(&"gcode:/dev/no-such-port".parse().unwrap(), &limits()).map(drop).unwrap_err();
    assert!(matches!(error, StageError::Connect { .. }) && error.to_string().contains("/dev/no-such-port"), "{error}");
    // Only one process can have it open.
    bench.machine.fail(Fault::None);
    let open = || bench.machine.stage(&patient(limits()));
    let first = open().unwrap();
    assert!(matches!(open(), Err(StageError::Connect { .. })));
    drop(first);
    open().unwrap();
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
        for (bench, limits) in [(Bench::new(firmware), limits()), (Bench::at_terminal(firmware), patient(limits()))] {
            let mut stage = bench.machine.stage(&limits).unwrap();
            let plan = Plan::new(Views::HORIZONTAL, 15_000);
            let policy =
                Policy { settle: Duration::from_millis(5), move_timeout: PATIENCE, backlash_um: 500, ..Policy::default() };
            let mut camera = Witness(&bench.machine, Vec::new());
            let mut sequence: Sequence<'_, StageError, _> = Sequence::new(plan.positions(), policy);
            let begin = bench.clock.now();
            let ended: Result<(), CaptureError<_, _>> = loop {
                match sequence.poll(bench.clock.now() - begin, &mut stage, &mut camera) {
                    Ok(CaptureProgress::Done) => break Ok(()),
                    Ok(_) => bench.clock.sleep(Duration::from_millis(2)),
                    Err(error) => break Err(error),
                }
            };
            ended.unwrap();
            for (place, x) in camera.1.iter().zip([120.5, 105.5, 135.5]) {
                assert!((place[0] - x).abs() < EXACTLY && (place[1] - 80.25).abs() < EXACTLY, "{firmware:?}: {place:?}");
            }
            assert_eq!(camera.1.len(), 3);
            bench.assert_at(120.5, 80.25);
        }
    });
}
