//! The simulated camera while it moves, in simulated time.

use std::{
    convert::Infallible,
    sync::Arc,
    time::{Duration, Instant},
};

use fastrand::Rng;

use super::{
    Clock,
    simulated_camera::SimulatedCamera,
    stage::StagePose,
    sweep::{Arrival, FreeCamera},
};
use crate::images::Picture;

/// The places from which a row is rendered that is exposed while the camera moves.
const EXPOSURES: u32 = 3;

/// A simulated camera that runs free. It sees where it is whenever it is asked for frames, which should be often.
#[derive(Debug)]
pub struct SimulatedStream {
    camera: SimulatedCamera,
    clock: Arc<dyn Clock>,
    began: Instant,
    /// The number of the next frame.
    number: u32,
    random: Rng,
    /// The last picture, if it was taken at rest, and its place.
    at_rest: Option<(StagePose, Picture)>,
    /// The places of the camera since the exposure of the next frame began, and a little earlier.
    places: Vec<(Instant, StagePose)>,
}

impl SimulatedStream {
    /// The frames of a camera, in the time of `clock`, which is that of its stage.
    pub fn new(camera: SimulatedCamera, clock: Arc<dyn Clock>) -> SimulatedStream {
        let began = clock.now();
        SimulatedStream { camera, clock, began, number: 0, random: Rng::with_seed(1), at_rest: None, places: Vec::new() }
    }

    /// The middle of the exposure of the middle row of a frame.
    fn exposed(&self, number: u32) -> Instant {
        self.began + Duration::from_secs_f64((f64::from(number) + 1.0) / self.camera.timing().frames_per_s)
    }

    /// The place at a time, between those that were seen.
    fn place(&self, at: Instant) -> StagePose {
        let after = self.places.partition_point(|(time, _)| *time < at);
        let end = |index: usize| self.places.get(index.min(self.places.len() - 1)).copied().unwrap_or((at, StagePose::default()));
        let ((t0, from), (t1, to)) = (end(after.saturating_sub(1)), end(after));
        let whole = (t1 - t0).as_secs_f64();
        let share = if whole > 0.0 { at.saturating_duration_since(t0).as_secs_f64() / whole } else { 0.0 };
        let mix = |a: f64, b: f64| a + share.min(1.0) * (b - a);
        StagePose {
            position_mm: [0, 1].map(|axis| mix(from.position_mm[axis], to.position_mm[axis])),
            rotation_deg: [0, 1, 2].map(|axis| mix(from.rotation_deg[axis], to.rotation_deg[axis])),
        }
    }
}

/// A time before or after another, by a number of seconds.
fn offset(at: Instant, seconds: f64) -> Instant {
    match seconds < 0.0 {
        true => at.checked_sub(Duration::from_secs_f64(-seconds)).unwrap_or(at),
        false => at + Duration::from_secs_f64(seconds),
    }
}

impl FreeCamera for SimulatedStream {
    type Error = Infallible;

    fn begin(&mut self) -> Result<(), Infallible> {
        (self.began, self.number) = (self.clock.now(), 0);
        self.places.clear();
        Ok(())
    }

    fn arrived(&mut self) -> Result<Option<Arrival>, Infallible> {
        let Some((middle, at)) = self.next_frame() else { return Ok(None) };
        Ok(Some(Arrival { picture: self.picture(middle), at }))
    }

    fn skip(&mut self) -> Result<bool, Infallible> {
        Ok(self.next_frame().is_some())
    }

    fn end(&mut self) {}
}

impl SimulatedStream {
    /// The middle of the exposure of the next frame, and its arrival, if it has arrived by now and is not lost.
    fn next_frame(&mut self) -> Option<(Instant, Instant)> {
        let now = self.clock.now();
        self.places.push((now, self.camera.place()));
        let (timing, [_, rows]) = (*self.camera.timing(), self.camera.size());
        let middle = self.exposed(self.number);
        // A second covers the longest exposure.
        let keep = self.places.partition_point(|(time, _)| *time + Duration::from_secs(1) < middle);
        self.places.drain(..keep);
        // The last row is exposed up to then, at least.
        let read = offset(middle, 5e-7 * timing.line_us * f64::from(rows) + 5e-4 * timing.exposure_ms);
        let at = offset(middle, 1e-3 * (timing.delay_ms + timing.jitter_ms * self.random.clone().f64()));
        if now < at.max(read) {
            return None;
        }
        self.random.f64();
        self.number += 1;
        (!timing.drops_every.is_some_and(|every| self.number.is_multiple_of(every))).then_some((middle, at))
    }

    /// The picture whose middle row was exposed around a time. At rest, it is the same one again.
    fn picture(&mut self, middle: Instant) -> Picture {
        let (timing, [_, rows]) = (*self.camera.timing(), self.camera.size());
        let places = |row: u32| {
            let row = offset(middle, 1e-6 * timing.line_us * (f64::from(row) - f64::from(rows - 1) / 2.0));
            let place = |n: u32| {
                let share = (f64::from(n) + 0.5) / f64::from(EXPOSURES) - 0.5;
                self.place(offset(row, 1e-3 * timing.exposure_ms * share))
            };
            let places: Vec<StagePose> = (0..EXPOSURES).map(place).collect();
            if places.iter().all(|place| *place == places[0]) { places[..1].to_vec() } else { places }
        };
        let [first, last] = [0, rows - 1].map(&places);
        let rest = (first.len() == 1 && first == last).then(|| first[0]);
        match &self.at_rest {
            Some((place, picture)) if rest == Some(*place) => picture.clone(),
            _ => {
                let picture = self.camera.moving(places);
                self.at_rest = rest.map(|place| (place, picture.clone()));
                picture
            }
        }
    }
}
