//! Sweeps: the camera runs free while the stage slides it from one end of a line to the other, and back.

use std::{
    error, mem,
    sync::atomic::{AtomicUsize, Ordering},
    time::{Duration, Instant, SystemTime},
};

use multiscopic_core::capture::{CaptureError, Policy, Position};

use super::{
    Clock, POLL_INTERVAL,
    stage::{PosedStage, Tracking},
};
use crate::{error::Error, files::FramePose, images::Picture};

/// The time for which frames are taken beyond the end of a way: those that were exposed before it arrive later.
const LINGER: Duration = Duration::from_millis(500);
/// The share by which the speed of a stage that tells no places may be off.
const SPEED_TOLERANCE: f64 = 0.1;
/// The time around a moment in which places are averaged, to both sides, in seconds: stages report them late and unevenly.
const WINDOW_S: f64 = 0.05;

/// A camera that runs free. No call waits for a frame.
pub trait FreeCamera {
    /// The reason why there is no frame.
    type Error;

    /// Begins to run, with exposure, gain and focus held.
    ///
    /// # Errors
    /// The camera does not run.
    fn begin(&mut self) -> Result<(), Self::Error>;

    /// The next frame, once it has arrived.
    ///
    /// # Errors
    /// The camera has failed.
    fn arrived(&mut self) -> Result<Option<Arrival>, Self::Error>;

    /// Drops the next frame, once it has arrived, and returns true then.
    ///
    /// # Errors
    /// Those of [`arrived`](FreeCamera::arrived).
    fn skip(&mut self) -> Result<bool, Self::Error> {
        self.arrived().map(|arrival| arrival.is_some())
    }

    /// Ends to run.
    fn end(&mut self);
}

/// A frame, and the time at which it arrived.
#[derive(Clone, Debug)]
pub struct Arrival {
    /// The frame.
    pub picture: Picture,
    /// The time, which is a constant delay after the middle of its exposure, but for jitter.
    pub at: Instant,
}

/// Places of a stage, with their times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// Seconds and millimetres.
    places: Vec<[f64; 2]>,
    /// True if it moves before the first place and after the last one.
    is_part: bool,
}

impl Track {
    /// Adds a place in millimetres at a time in seconds, which does not go back.
    pub fn add(&mut self, seconds: f64, mm: f64) {
        self.places.push([seconds, mm]);
    }

    /// The places of a move between two rests, each a time and a place, while its speed in mm/s is constant: the ramps at both ends
    /// are even, and take what time the way does not. Empty if they take all of it.
    fn planned([from, to]: [[f64; 2]; 2], speed: f64) -> Track {
        let (seconds, way) = (to[0] - from[0], to[1] - from[1]);
        let at_speed = way.abs() / speed;
        let half = at_speed - seconds / 2.0;
        let [time, mm] = [0, 1].map(|axis| (from[axis] + to[axis]) / 2.0);
        let count = (half / WINDOW_S).ceil().max(0.0) as i32;
        let place = |n: i32| {
            let since = half * f64::from(n) / f64::from(count);
            [time + since, mm + way.signum() * speed * since]
        };
        Track { places: if count > 0 { (-count..=count).map(place).collect() } else { Vec::new() }, is_part: true }
    }

    /// True if the place at a time in seconds is known: before the first place and after the last one if it rests there.
    pub fn knows(&self, seconds: f64) -> bool {
        let ends = self.places.first().zip(self.places.last());
        ends.is_some_and(|(first, last)| !self.is_part || (first[0]..=last[0]).contains(&seconds))
    }

    /// The place at a time in seconds, by a straight line through the places nearby, or the first or the last place beyond them. NaN
    /// of no places.
    pub fn at(&self, seconds: f64) -> f64 {
        let (Some([first, _]), Some([last, _])) = (self.places.first(), self.places.last()) else { return f64::NAN };
        let seconds = seconds.max(*first).min(*last);
        let from = self.places.partition_point(|[time, _]| *time < seconds - WINDOW_S);
        let to = self.places.partition_point(|[time, _]| *time <= seconds + WINDOW_S);
        // At least the two places around it.
        let around = self.places.partition_point(|[time, _]| *time < seconds);
        let near = &self.places[from.min(around.saturating_sub(1))..to.max(around + 1).min(self.places.len())];
        let mean = |axis: usize| near.iter().map(|place| place[axis]).sum::<f64>() / near.len() as f64;
        let (time, mm) = (mean(0), mean(1));
        let products = |axis: usize, mean: f64| near.iter().map(|place| (place[0] - time) * (place[axis] - mean)).sum::<f64>();
        let (square, product) = (products(0, time), products(1, mm));
        if square > 0.0 { mm + (seconds - time) * product / square } else { mm }
    }

    /// The times in seconds between which it moves at a constant speed, within a hundredth: where its places change as fast as in
    /// the middle of the way. `None` if that is nowhere.
    pub fn cruise(&self) -> Option<[f64; 2]> {
        let (first, last) = (self.places.first()?, self.places.last()?);
        let [low, high] = [0.4, 0.6].map(|share| {
            let mm = first[1] + share * (last[1] - first[1]);
            self.places.iter().find(|place| (place[1] - first[1]).abs() >= (mm - first[1]).abs()).copied()
        });
        let (low, high) = (low?, high?);
        let speed = (high[1] - low[1]) / (high[0] - low[0]);
        if !(speed.abs() > 0.0 && speed.is_finite()) {
            return None;
        }
        // The line that it would follow at this speed.
        let off = |place: &[f64; 2]| (place[1] - low[1] - speed * (place[0] - low[0])).abs();
        let tolerance = 0.01 * (last[1] - first[1]).abs();
        let middle = self.places.partition_point(|[time, _]| *time < (low[0] + high[0]) / 2.0);
        let from = self.places[..middle].iter().rposition(|place| off(place) > tolerance).map_or(0, |at| at + 1);
        let to =
            self.places[middle..].iter().position(|place| off(place) > tolerance).map_or(self.places.len(), |at| middle + at);
        Some([self.places.get(from)?[0], self.places.get(to.checked_sub(1)?)?[0]])
    }
}

/// One way along the line.
#[derive(Clone, Debug, Default)]
pub struct SweepPass {
    /// The places of the stage to the right of the centre.
    pub track: Track,
    /// The frames, with the times at which they arrived, in seconds.
    pub frames: Vec<(f64, Picture)>,
}

/// The frames of a sweep. Times are in seconds since it began.
#[derive(Debug)]
pub struct SweptFrames {
    /// The centre, which was taken at rest.
    pub center: Picture,
    /// The place of the centre, and the time.
    pub pose: FramePose,
    /// The way there, to the right, and the way back.
    pub passes: [SweepPass; 2],
    /// The time at which it began.
    pub began: SystemTime,
    /// The failure after the last frame. The stage may not be back at the centre.
    pub failure: Option<Error>,
}

/// Takes frames along a line of `length_um`, the middle of which is the centre of the stage: at the centre at rest, on the way from
/// the left end to the right one, and on the way back. Then the stage returns to the centre. `observe` is told each step, and the
/// time since the start. An increase of `interrupts` aborts it as it does a [capture](super::acquire_images).
///
/// # Errors
/// [`Error::Usage`] if the stage cannot do it, and [`Error::Capture`] if the stage or the camera failed, or it was aborted. The
/// stage has stopped by then. An end beyond the reach of the stage is refused before anything moves.
pub fn acquire_sweep<S, C>(
    clock: &dyn Clock,
    stage: &mut S,
    camera: &mut C,
    length_um: u32,
    policy: Policy,
    interrupts: &AtomicUsize,
    observe: impl FnMut(Duration, &str),
) -> Result<SweptFrames, Error>
where
    S: PosedStage<Error: error::Error + Send + Sync + 'static>,
    C: FreeCamera<Error: error::Error + Send + Sync + 'static>,
{
    let tracking = stage.tracking();
    if tracking == Tracking::None {
        return Err(Error::Usage(
            "nobody knows where this stage is while it moves, which a sweep needs: take an arm, a machine with Grbl, a command by exec: or \
             a simulated stage, or stop for each view"
                .into(),
        ));
    }
    let (handled, start) = (interrupts.load(Ordering::Relaxed), clock.now());
    let mut run = Run { clock, stage, tracking, place_um: 0, camera, policy, interrupts, handled, start, observe };
    let began = SystemTime::now();
    let taken = run.take(length_um as i32 / 2);
    run.camera.end();
    let ((center, pose), durations, passes, failure) =
        taken.map_err(|error| Error::Capture { frame: None, source: Box::new(run.stopped(error)) })?;
    if let Tracking::Planned(speed) = tracking {
        check_speed(speed, f64::from(length_um) / 1000.0, durations)?;
    }
    let failure = failure.map(|error| Error::Capture { frame: None, source: Box::new(error) });
    Ok(SweptFrames { center, pose, passes, began, failure })
}

/// Refuses a sweep of a stage that does not have the speed that it was given, by the times in seconds that it took for half of the
/// length and for all of it: the ramps and the delays of both are the same.
fn check_speed(speed: f64, length_mm: f64, [half, whole]: [f64; 2]) -> Result<(), Error> {
    let found = length_mm / 2.0 / (whole - half);
    if (found / speed - 1.0).abs() <= SPEED_TOLERANCE {
        return Ok(());
    }
    let found = if found > 0.0 && found.is_finite() { format!("slid at {found:.1} mm/s") } else { "took no time".into() };
    Err(Error::Usage(format!(
        "the stage {found} where {speed} mm/s were asked for, and tells no places, so that those of the frames are not known: give a \
         --speed that it has, or a longer --sweep"
    )))
}

/// A sweep under way.
struct Run<'a, S, C, F> {
    clock: &'a dyn Clock,
    stage: &'a mut S,
    tracking: Tracking,
    /// The place to which it was sent last, to the right of the centre.
    place_um: i32,
    camera: &'a mut C,
    policy: Policy,
    interrupts: &'a AtomicUsize,
    /// The interrupts that count no more.
    handled: usize,
    start: Instant,
    observe: F,
}

type Failure<S, C> = CaptureError<<S as multiscopic_core::capture::Stage>::Error, <C as FreeCamera>::Error>;
type Taken<S, C> = ((Picture, FramePose), [f64; 2], [SweepPass; 2], Option<Failure<S, C>>);

impl<S: PosedStage, C: FreeCamera, F: FnMut(Duration, &str)> Run<'_, S, C, F> {
    fn take(&mut self, half_um: i32) -> Result<Taken<S, C>, Failure<S, C>> {
        let camera = |error| CaptureError::Camera { index: 0, error };
        self.camera.begin().map_err(camera)?;
        self.say("capturing the centre frame");
        let (mut at_rest, _) = self.travel(0, true)?;
        let (_, center) = at_rest.frames.pop().expect("a way lasts until there is a frame");
        let counted = self.stage.position().map_err(CaptureError::Stage)?;
        let pose = FramePose {
            asked_mm: [0.0; 2],
            counted_mm: counted.map(|Position { x_um, y_um }| [x_um, y_um].map(|um| f64::from(um) / 1000.0)),
            exposed: Some(SystemTime::now()),
            measured: self.stage.pose().map_err(CaptureError::Stage)?,
        };
        self.say("moving to the left end");
        let (_, half) = self.travel(-half_um, false)?;
        self.say("sweeping to the right");
        let (there, whole) = self.travel(half_um, true)?;
        self.say("sweeping back");
        let (back, _) = self.travel(-half_um, true)?;
        self.say("returning to the centre");
        let failure = if self.policy.return_to_center { self.travel(0, false).err() } else { None };
        if failure.is_some() {
            // There is a failure to report already.
            let _ = self.stage.stop();
        }
        self.say("done");
        Ok(((center, pose), [half, whole], [there, back], failure))
    }

    fn say(&mut self, step: &str) {
        (self.observe)(self.clock.now() - self.start, step);
    }

    fn seconds(&self, at: Instant) -> f64 {
        at.saturating_duration_since(self.start).as_secs_f64()
    }

    /// Moves to a place until the stage has stood there for a while, and keeps the frames or drops them: at least one. Returns the
    /// seconds until it arrived, too.
    fn travel(&mut self, x_um: i32, is_kept: bool) -> Result<(SweepPass, f64), Failure<S, C>> {
        self.stage.move_to(Position { x_um, y_um: 0 }).map_err(CaptureError::Stage)?;
        let mut pass = SweepPass::default();
        let from_um = mem::replace(&mut self.place_um, x_um);
        let (begun, mut arrived) = (self.clock.now(), None);
        let (mut count, mut last_frame) = (0, begun);
        loop {
            if self.interrupts.load(Ordering::Relaxed) != self.handled {
                return Err(CaptureError::Aborted);
            }
            let before = self.clock.now();
            let place = match self.tracking {
                Tracking::Measured => self.stage.position().map_err(CaptureError::Stage)?,
                Tracking::Planned(_) | Tracking::None => None,
            };
            let now = self.clock.now();
            if let Some(Position { x_um, .. }) = place {
                pass.track.add(self.seconds(before + (now - before) / 2), f64::from(x_um) / 1000.0);
            }
            let failed = |error| CaptureError::Camera { index: count, error };
            let has_come = match is_kept {
                true => {
                    self.camera.arrived().map_err(failed)?.map(|frame| pass.frames.push((self.seconds(frame.at), frame.picture)))
                }
                false => self.camera.skip().map_err(failed)?.then_some(()),
            };
            if has_come.is_some() {
                (count, last_frame) = (count + 1, now);
            }
            let after = self.policy.frame_timeout;
            if now - last_frame > after {
                return Err(CaptureError::FrameTimeout { index: count, after });
            }
            if arrived.is_none() && self.stage.has_arrived().map_err(CaptureError::Stage)? {
                arrived = Some(now);
            }
            match arrived {
                Some(since) if now - since >= LINGER.max(self.policy.settle) && count > 0 => {
                    if let Tracking::Planned(speed) = self.tracking {
                        let [from, to] =
                            [(begun, from_um), (since, x_um)].map(|(at, um)| [self.seconds(at), f64::from(um) / 1000.0]);
                        pass.track = Track::planned([from, to], speed);
                    }
                    return Ok((pass, (since - begun).as_secs_f64()));
                }
                None if now - begun > self.policy.move_timeout => {
                    return Err(CaptureError::MoveTimeout { after: self.policy.move_timeout });
                }
                _ => self.clock.sleep(POLL_INTERVAL),
            }
        }
    }

    /// Stops the stage after a failure. One that was only interrupted returns to the centre, until it is interrupted again.
    fn stopped(&mut self, error: Failure<S, C>) -> Failure<S, C> {
        if let Err(failed) = self.stage.stop() {
            return CaptureError::NotStopped(failed);
        }
        if !matches!(error, CaptureError::Aborted) || !self.policy.return_to_center {
            return error;
        }
        self.say("returning to the centre");
        self.handled = self.interrupts.load(Ordering::Relaxed);
        let begun = self.clock.now();
        let mut is_back = self.stage.move_to(Position::CENTER).is_err();
        while !is_back {
            self.clock.sleep(POLL_INTERVAL);
            let is_interrupted = self.interrupts.load(Ordering::Relaxed) != self.handled;
            is_back = match self.stage.has_arrived() {
                Ok(false) => is_interrupted || self.clock.now() - begun > self.policy.move_timeout,
                Ok(true) => return error,
                Err(_) => true,
            };
        }
        match self.stage.stop() {
            Ok(()) => error,
            Err(failed) => CaptureError::NotStopped(failed),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::{convert::Infallible, sync::Arc};

    use image::GrayImage;
    use multiscopic_core::capture::Stage;

    use super::*;
    use crate::capture::{
        SteppedClock,
        stage::{Limits, SimulatedStage, StageError, StageImperfections},
    };

    /// A camera that takes a frame every 50 ms.
    struct Eye(Arc<SteppedClock>, Instant);

    impl FreeCamera for Eye {
        type Error = Infallible;

        fn begin(&mut self) -> Result<(), Infallible> {
            Ok(())
        }

        fn arrived(&mut self) -> Result<Option<Arrival>, Infallible> {
            let at = self.1 + Duration::from_millis(50);
            if self.0.now() < at {
                return Ok(None);
            }
            self.1 = at;
            Ok(Some(Arrival { picture: Picture::Gray(GrayImage::new(1, 1)), at }))
        }

        fn end(&mut self) {}
    }

    /// The outcome of a sweep over 40 mm that is interrupted at a step, and the place of the stage after it.
    fn run(reach_um: u32, stalls_at_move: Option<u32>, interrupted: &str) -> (Result<SweptFrames, Error>, Position) {
        let clock = SteppedClock::new();
        let limits = Limits { reach_um, speed_mm_s: 20.0, ..Limits::default() };
        let errors = StageImperfections { stalls_at_move, ..StageImperfections::default() };
        let mut stage = SimulatedStage::with_clock(&limits, errors, clock.clone()).unwrap();
        let mut camera = Eye(clock.clone(), clock.now());
        let interrupts = AtomicUsize::new(0);
        let observe = |_, step: &str| _ = (step == interrupted).then(|| interrupts.fetch_add(1, Ordering::Relaxed));
        let policy = Policy::default();
        let taken = acquire_sweep(&*clock, &mut stage, &mut camera, 40_000, policy, &interrupts, observe);
        (taken, stage.position().unwrap().unwrap())
    }

    #[test]
    fn frames_come_there_and_back() {
        let (taken, place) = run(20_000, None, "");
        let taken = taken.unwrap();
        assert_eq!((place, taken.failure.is_none()), (Position::CENTER, true));
        for (pass, sign) in taken.passes.iter().zip([1.0, -1.0]) {
            // 2.2 s of motion and half a second of rest.
            assert!((53..=55).contains(&pass.frames.len()), "{}", pass.frames.len());
            let begun = pass.track.cruise().unwrap()[0];
            let (early, late) = (pass.track.at(begun + 0.5), pass.track.at(begun + 1.0));
            assert!((sign * (late - early) - 10.0).abs() < 0.01, "{early} {late}");
        }
    }

    #[test]
    fn a_sweep_that_fails_ends_at_rest() {
        let message = |taken: Result<SweptFrames, Error>| taken.unwrap_err().to_string();
        let (taken, place) = run(19_999, None, "");
        assert!(message(taken).contains("beyond the reach of 19.999 mm"));
        assert_eq!(place, Position::CENTER, "nothing has moved");
        let (taken, place) = run(20_000, None, "sweeping back");
        assert!(message(taken).contains("abort"));
        assert_eq!(place, Position::CENTER, "an interrupt returns it");
        // It moves to the centre, to the left end, and gets stuck on the way to the right.
        let (taken, place) = run(20_000, Some(3), "");
        assert!(message(taken).contains("came no nearer"));
        assert!(place.x_um.abs() < 19_000, "{place:?}");
    }

    #[test]
    fn a_stage_that_tells_no_places_is_where_its_speed_puts_it() {
        let clock = SteppedClock::new();
        let limits = Limits { speed_mm_s: 20.0, acceleration_mm_s2: 100.0, ..Limits::default() };
        let silent = StageImperfections { is_silent: true, ..StageImperfections::default() };
        let mut stage = SimulatedStage::with_clock(&limits, silent, clock.clone()).unwrap();
        let (mut camera, interrupts) = (Eye(clock.clone(), clock.now()), AtomicUsize::new(0));
        let taken = acquire_sweep(&*clock, &mut stage, &mut camera, 40_000, Policy::default(), &interrupts, |_, _| ());
        for pass in taken.unwrap().passes {
            // 1.8 s between ramps of 0.2 s, in the middle of the way.
            let [from, to] = pass.track.cruise().unwrap();
            assert!((to - from - 1.8).abs() < 0.03, "{from} to {to}");
            let (start, end) = (pass.track.at(from), pass.track.at(to));
            assert!((start + end).abs() < 1e-6 && ((end - start).abs() - 36.0).abs() < 0.5, "{start} to {end}");
            assert!(pass.track.knows(from) && !pass.track.knows(from - 0.1) && !pass.track.knows(to + 0.1));
        }
    }

    #[test]
    fn a_stage_of_another_speed_is_refused() {
        // Both ways have the same ramps and delays.
        assert!(check_speed(20.0, 40.0, [1.3, 2.3]).is_ok());
        let refusal = check_speed(20.0, 40.0, [2.3, 4.3]).unwrap_err().to_string();
        assert!(refusal.starts_with("the stage slid at 10.0 mm/s where 20 mm/s were asked for"), "{refusal}");
        assert!(check_speed(20.0, 40.0, [1.0, 1.0]).unwrap_err().to_string().contains("took no time"));
    }

    /// A stage that cannot tell where it is.
    struct Blind;

    impl Stage for Blind {
        type Error = StageError;

        fn move_to(&mut self, _: Position) -> Result<(), StageError> {
            panic!("it is not asked to move")
        }

        fn has_arrived(&mut self) -> Result<bool, StageError> {
            Ok(true)
        }

        fn position(&mut self) -> Result<Option<Position>, StageError> {
            Ok(None)
        }

        fn stop(&mut self) -> Result<(), StageError> {
            Ok(())
        }
    }

    impl PosedStage for Blind {}

    #[test]
    fn a_stage_that_does_not_tell_its_place_is_refused() {
        let clock = SteppedClock::new();
        let (mut camera, interrupts) = (Eye(clock.clone(), clock.now()), AtomicUsize::new(0));
        let taken = acquire_sweep(&*clock, &mut Blind, &mut camera, 40_000, Policy::default(), &interrupts, |_, _| ());
        assert!(taken.unwrap_err().to_string().contains("nobody knows where this stage is while it moves"));
    }

    /// A trapezoid of 40 mm at 20 mm/s, with ramps of 0.2 s, seen every 8 ms, to the micrometre.
    fn track() -> Track {
        let mut track = Track::default();
        let limits = crate::capture::stage::Limits { speed_mm_s: 20.0, acceleration_mm_s2: 100.0, ..Default::default() };
        for n in 0..400 {
            let time = f64::from(n) * 0.008;
            let mm = limits.travelled_mm(40.0, Duration::from_secs_f64((time - 0.4).max(0.0))) - 20.0;
            track.add(time, (1000.0 * mm).round() / 1000.0);
        }
        track
    }

    #[test]
    fn places_between_the_samples() {
        let track = track();
        // At a constant speed, and at rest.
        for (time, mm) in [(1.0, -10.0), (1.2345, -5.31), (2.0, 10.0), (0.1, -20.0), (9.0, 20.0)] {
            assert!((track.at(time) - mm).abs() < 2e-3, "{} at {time}", track.at(time));
        }
        // Half way up the ramp, 0.1 s after the start.
        assert!((track.at(0.5) + 19.5).abs() < 0.05, "{}", track.at(0.5));
        assert!(Track::default().at(1.0).is_nan());
        let mut sparse = Track::default();
        sparse.add(0.0, 0.0);
        sparse.add(1.0, 10.0);
        assert_eq!(sparse.at(0.25), 2.5);
    }

    #[test]
    fn the_speed_is_constant_between_the_ramps() {
        let [from, to] = track().cruise().unwrap();
        // Within a hundredth of the length, a ramp is as good as straight for its last 0.09 s.
        assert!((0.5..0.62).contains(&from) && (2.38..2.5).contains(&to), "{from} to {to}");
        let mut still = Track::default();
        (0..9).for_each(|n| still.add(f64::from(n), 1.0));
        assert_eq!([still.cruise(), Track::default().cruise()], [None; 2]);
    }
}
