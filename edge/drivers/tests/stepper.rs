//! The stage with stepping motors, on mocked pins and on a simulated slide.

#[path = "simulated/slide.rs"]
mod slide;

use embedded_hal::{
    delay::DelayNs,
    digital::{ErrorKind, PinState},
};
use embedded_hal_mock::eh1::{
    MockError,
    delay::{CheckedDelay, Transaction as Wait},
    digital::{
        Mock,
        State::{High, Low},
        Transaction,
    },
};
use multiscopic_core::capture::{Position, Stage};
use multiscopic_drivers::stepper::{Axis, AxisEnd, AxisError, AxisId, Fixed, Pins, Stepper, StepperError};
use slide::{Clock, Pin, ScrewFault, Slide, pins};
use std::{cell::RefCell, io::ErrorKind as IoError};

/// 1.6 steps per micrometre. The switches lie a little beyond 30 mm.
const AXIS: Axis = Axis {
    steps: 3200,
    um: 2000,
    home_um: -31_000,
    min_um: -30_000,
    max_um: 30_000,
    release_um: 2000,
    speed_um_per_s: 20_000,
    acceleration_um_per_s2: 100_000,
    homing_um_per_s: 2000,
    forward: PinState::High,
    pressed: PinState::High,
};
/// The first position above the low switch, in steps.
const HOME: i32 = -49_600;
const ENDS: [i32; 2] = [HOME - 1, 49_600];
/// Steps/s.
const SPEED: f64 = 32_000.0;
/// Steps/s².
const ACCELERATION: f64 = 160_000.0;
/// Nanoseconds.
const PULSE: u32 = 2000;

type SlideStage<'s> = Stepper<Pins<Pin<'s>, Pin<'s>, Pin<'s>, Pin<'s>>, Pins<Pin<'s>, Pin<'s>, Pin<'s>, Pin<'s>>, Clock<'s>>;

fn slide() -> RefCell<Slide> {
    RefCell::new(Slide::new([-49_000, -48_000], ENDS, (1e9 / SPEED) as u64))
}

fn stage(slide: &RefCell<Slide>) -> SlideStage<'_> {
    Stepper::new([AXIS, AXIS], pins(slide, 0), pins(slide, 1), PULSE, Clock(slide)).unwrap()
}

/// Polls until the stage has arrived. No poll may take much longer than 10 ms.
fn arrive(stage: &mut impl Stage<Error = StepperError>, slide: &RefCell<Slide>) -> Result<(), StepperError> {
    for _ in 0..100_000 {
        let before = slide.borrow().now;
        let arrived = stage.has_arrived();
        let took = slide.borrow().now - before;
        assert!(took < 15_000_000, "a poll took {took} ns");
        if arrived? {
            return Ok(());
        }
    }
    panic!("the stage does not arrive")
}

fn homed(slide: &RefCell<Slide>) -> SlideStage<'_> {
    let mut stage = stage(slide);
    stage.home().unwrap();
    arrive(&mut stage, slide).unwrap();
    stage
}

fn at(slide: &RefCell<Slide>) -> [i32; 2] {
    [0, 1].map(|axis| slide.borrow().screws[axis].at)
}

fn assert_still<S: Stage<Error = StepperError>>(stage: &mut S, slide: &RefCell<Slide>) {
    let pulses = || [0, 1].map(|axis| slide.borrow().screws[axis].pulses);
    let before = pulses();
    for _ in 0..10 {
        assert_eq!(stage.has_arrived(), Ok(false));
    }
    assert_eq!(pulses(), before);
}

const fn position(x_um: i32, y_um: i32) -> Position {
    Position { x_um, y_um }
}

#[test]
fn homing_finds_the_switches_from_anywhere() {
    for start in [[-49_000, -48_000], [49_000, 0], [HOME, HOME - 1], [HOME - 3000, HOME + 1]] {
        let slide = RefCell::new(Slide::new(start, ENDS, 31_250));
        let mut stage = homed(&slide);
        assert_eq!((at(&slide), stage.position()), ([HOME; 2], Ok(Some(position(-31_000, -31_000)))), "from {start:?}");
        stage.move_to(Position::CENTER).unwrap();
        arrive(&mut stage, &slide).unwrap();
        assert_eq!((at(&slide), stage.drift()), ([0; 2], [0; 2]));
    }
}

#[test]
fn a_thousand_moves_do_not_drift() {
    let slide = slide();
    let mut stage = homed(&slide);
    let mut random = 1_u32;
    let mut um = || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (random >> 8) as i32 % 700
    };
    for _ in 0..1000 {
        let (x_um, y_um) = (um(), um());
        stage.move_to(position(x_um, y_um)).unwrap();
        arrive(&mut stage, &slide).unwrap();
        assert_eq!(stage.position(), Ok(Some(position(x_um, y_um))));
        let exact = |um: i32| (f64::from(um) * 1.6).round() as i32;
        assert_eq!(at(&slide), [exact(x_um), exact(y_um)]);
    }
    stage.home().unwrap();
    arrive(&mut stage, &slide).unwrap();
    assert_eq!(stage.drift(), [0; 2]);
}

/// A delay that records the times of the pulses.
struct Recorder<'s> {
    slide: &'s RefCell<Slide>,
    edges: &'s RefCell<Vec<u64>>,
}

impl DelayNs for Recorder<'_> {
    fn delay_ns(&mut self, ns: u32) {
        if ns == PULSE {
            self.edges.borrow_mut().push(self.slide.borrow().now);
        }
        Clock(self.slide).delay_ns(ns);
    }
}

#[test]
fn speed_and_acceleration_stay_within_their_limits() {
    let (slide, edges) = (slide(), RefCell::default());
    let delay = Recorder { slide: &slide, edges: &edges };
    let mut stage = Stepper::new([AXIS, AXIS], pins(&slide, 0), pins(&slide, 1), PULSE, delay).unwrap();
    stage.home().unwrap();
    while !stage.has_arrived().unwrap() {}
    let mut times = Vec::new();
    for um in [0, 20_000, 20_001, 19_990, -5000] {
        edges.borrow_mut().clear();
        // The pulse of the step before counts towards the first interval.
        let start = slide.borrow().now - u64::from(PULSE);
        stage.move_to(position(um, 0)).unwrap();
        while !stage.has_arrived().unwrap() {}
        let (mut before, mut speed, mut last): (_, f64, _) = (start as f64, 0.0, None);
        let (mut fastest, mut hardest): (f64, f64) = (0.0, 0.0);
        for &edge in edges.borrow().iter() {
            let seconds = (edge as f64 - before) * 1e-9;
            let now = 1.0 / seconds;
            let between = last.map_or(seconds / 2.0, |last: f64| (last + seconds) / 2.0);
            fastest = fastest.max(now);
            // Times are rounded to nanoseconds.
            let noise = 2e-9 * (now * now + speed * speed);
            hardest = hardest.max(((now - speed).abs() - noise) / between);
            (before, speed, last) = (edge as f64, now, Some(seconds));
        }
        assert!(fastest <= SPEED && hardest <= 1.001 * ACCELERATION, "to {um} um: {fastest} steps/s, {hardest} steps/s²");
        times.push((slide.borrow().now - start) as f64 * 1e-9);
    }
    // 20 mm at 20 mm/s, and a ramp of 0.2 s.
    assert!((times[1] - 1.2).abs() < 0.001, "{times:?}");
}

#[test]
fn stopping_decelerates_and_keeps_the_position() {
    let slide = slide();
    let mut stage = homed(&slide);
    for polls in [1, 3, 20, 60] {
        stage.move_to(Position::CENTER).unwrap();
        arrive(&mut stage, &slide).unwrap();
        stage.move_to(position(20_000, -10_000)).unwrap();
        for _ in 0..polls {
            assert_eq!(stage.has_arrived(), Ok(false));
        }
        let (before, began) = (at(&slide), slide.borrow().now);
        stage.stop().unwrap();
        let after = at(&slide);
        assert!(slide.borrow().now - began <= 201_000_000 && after[0] > before[0] && after[0] < 32_000);
        assert!((2 * after[1] + after[0]).abs() <= 1, "the stage left the line: {after:?}");
        let um = |steps: i32| (f64::from(steps) / 1.6).round() as i32;
        assert_eq!(stage.position(), Ok(Some(position(um(after[0]), um(after[1])))));
        assert_still(&mut stage, &slide);
        stage.stop().unwrap();
    }
    // A new target in the middle of a motion.
    stage.move_to(position(20_000, 0)).unwrap();
    for _ in 0..30 {
        stage.has_arrived().unwrap();
    }
    stage.move_to(position(0, 500)).unwrap();
    arrive(&mut stage, &slide).unwrap();
    assert_eq!(at(&slide), [0, 800]);
}

#[test]
fn a_limit_switch_stops_at_once_and_the_position_is_forgotten() {
    for (axis, end, um) in [(0, 1, [20_000, 10_000]), (1, 0, [-10_000, -20_000]), (1, 1, [0, 20_000])] {
        let slide = slide();
        let mut stage = homed(&slide);
        stage.move_to(Position::CENTER).unwrap();
        arrive(&mut stage, &slide).unwrap();
        let from = slide.borrow().screws[axis].pulses + 5000;
        slide.borrow_mut().screws[axis].fault = Some(ScrewFault::Pressed(end, from));
        stage.move_to(position(um[0], um[1])).unwrap();
        let direction = [AxisId::X, AxisId::Y][axis];
        let expected = StepperError::Limit { axis: direction, end: [AxisEnd::Low, AxisEnd::High][end] };
        assert_eq!(arrive(&mut stage, &slide), Err(expected));
        assert_eq!(slide.borrow().screws[axis].pulses, from, "the stage went on");
        assert_still(&mut stage, &slide);
        assert_eq!((stage.position(), stage.move_to(Position::CENTER)), (Ok(None), Err(StepperError::NotHomed)));

        slide.borrow_mut().screws[axis].fault = None;
        stage.home().unwrap();
        arrive(&mut stage, &slide).unwrap();
        assert_eq!((at(&slide), stage.drift()), ([HOME; 2], [0; 2]));
    }
}

#[test]
fn failed_switches_end_the_homing() {
    let cases = [
        (ScrewFault::Released, StepperError::SwitchNotFound { axis: AxisId::Y }),
        (ScrewFault::Pressed(0, 0), StepperError::SwitchStuck { axis: AxisId::Y }),
        (ScrewFault::Jam(0..u32::MAX), StepperError::SwitchNotFound { axis: AxisId::Y }),
    ];
    for (fault, error) in cases {
        let slide = slide();
        slide.borrow_mut().screws[1].fault = Some(fault);
        let mut stage = stage(&slide);
        stage.home().unwrap();
        assert_eq!(arrive(&mut stage, &slide), Err(error));
        assert_still(&mut stage, &slide);
        assert_eq!(stage.position(), Ok(None));
    }
}

#[test]
fn homing_measures_lost_steps() {
    let slide = slide();
    let mut stage = homed(&slide);
    let from = slide.borrow().screws[0].pulses + 1000;
    slide.borrow_mut().screws[0].fault = Some(ScrewFault::Jam(from..from + 250));
    stage.move_to(Position::CENTER).unwrap();
    arrive(&mut stage, &slide).unwrap();
    assert_eq!((at(&slide), stage.position()), ([-250, 0], Ok(Some(Position::CENTER))), "steps are counted, not measured");
    stage.home().unwrap();
    arrive(&mut stage, &slide).unwrap();
    assert_eq!((at(&slide), stage.drift()), ([HOME; 2], [250, 0]));
}

#[test]
fn positions_out_of_range_are_refused_and_change_nothing() {
    let slide = slide();
    let mut stage = stage(&slide);
    assert_eq!(stage.move_to(Position::CENTER), Err(StepperError::NotHomed));
    assert_eq!((stage.position(), stage.has_arrived()), (Ok(None), Ok(false)));
    let mut stage = homed(&slide);
    let beyond = |axis, um| StepperError::Beyond { axis, um, min_um: -30_000, max_um: 30_000 };
    assert_eq!(stage.move_to(position(30_001, 0)), Err(beyond(AxisId::X, 30_001)));
    assert_eq!(stage.move_to(position(0, i32::MIN)), Err(beyond(AxisId::Y, i32::MIN)));
    stage.move_to(position(30_000, -30_000)).unwrap();
    arrive(&mut stage, &slide).unwrap();
    assert_eq!(at(&slide), [48_000, -48_000]);
    let bad = Axis { um: 0, ..AXIS };
    let error = Stepper::new([AXIS, bad], pins(&slide, 0), pins(&slide, 1), PULSE, Clock(&slide)).err();
    assert_eq!(error, Some(StepperError::Axis { axis: AxisId::Y, error: AxisError::Ratio { steps: 3200, um: 0 } }));
}

#[test]
fn pins_are_set_in_order_and_their_errors_end_the_motion() {
    let (set, get) = (Transaction::set, Transaction::get);
    for failing in [None, Some(0), Some(1), Some(2)] {
        let mut pulses = vec![set(High), set(Low), set(High), set(Low)];
        // A step from rest to rest takes as long as the first step of a ramp.
        let first = (1e9 * (2.0 / ACCELERATION).sqrt()) as u32;
        let mut waits = [first - PULSE, PULSE, first - PULSE, PULSE].map(Wait::delay_ns).to_vec();
        if let Some(failing) = failing {
            pulses[failing] = set([High, Low][failing % 2]).with_error(MockError::Io(IoError::NotConnected));
            pulses.truncate(failing + 1);
            waits.truncate(failing + 1);
        }
        let mut step = Mock::new(&pulses);
        // Towards the switch, away from it, and along x also towards the target.
        let mut dirs = [Mock::new(&[set(Low), set(High), set(High)]), Mock::new(&[set(Low), set(High)])];
        // Pressed, then released.
        let mut lows = [(); 2].map(|()| Mock::new(&[get(High), get(Low)]));
        let (mut still, mut delay) = (Mock::new(&[]), CheckedDelay::new(&waits));
        let [x, y] = [(&step, 0), (&still, 1)].map(|(step, i)| Pins {
            step: step.clone(),
            dir: dirs[i].clone(),
            low: lows[i].clone(),
            high: Fixed(PinState::Low),
        });
        let axis = Axis { min_um: -31_000, ..AXIS };
        let mut stage = Stepper::new([axis, axis], x, y, PULSE, delay.clone()).unwrap();
        stage.home().unwrap();
        assert_eq!(stage.has_arrived(), Ok(true));
        // Two steps.
        stage.move_to(position(-30_999, -31_000)).unwrap();
        let error = StepperError::Pin { axis: AxisId::X, kind: ErrorKind::Other };
        assert_eq!(stage.has_arrived(), if failing.is_some() { Err(error) } else { Ok(true) });
        assert_eq!(stage.position().unwrap().is_some(), failing.is_none());
        step.done();
        still.done();
        delay.done();
        dirs.iter_mut().chain(&mut lows).for_each(Mock::done);
    }
}
