//! A simulated stage.

use std::{
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};

use fastrand::Rng;
use multiscopic_core::capture::{Position, Stage};
use serde::Deserialize;

use super::{
    error::StageError,
    limits::Limits,
    posed::{PosedStage, Tracking},
};
use crate::{
    capture::{Clock, SystemClock},
    images::Transform,
};

/// A stage without hardware, which takes the time that a real one would, and makes the errors that it is told to.
#[derive(Debug)]
pub struct SimulatedStage {
    clock: Arc<dyn Clock>,
    limits: Limits,
    errors: StageImperfections,
    place: SimulatedPlace,
    /// The place to which the drives have taken it, in millimetres.
    driven: [f64; 2],
    /// The place of the carriage between the ends of its play, in millimetres.
    carried: [f64; 2],
    from: [f64; 2],
    target: Position,
    departure: Instant,
    /// The number of moves so far.
    moves: u32,
    random: Rng,
    /// The offset by which the current move misses its target, in millimetres, and its turn of the camera, in degrees.
    miss: ([f64; 2], [f64; 3]),
}

/// The differences of a stage from a perfect one. By default there are none.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StageImperfections {
    /// The lengths of moves to the right and down as multiples of those commanded.
    pub scale: [f64; 2],
    /// The angle by which the downward axis leans to the left, in degrees: positive turns it further away from the axis to the
    /// right.
    pub skew_deg: f64,
    /// Play between drive and camera along each axis, in millimetres.
    pub backlash_mm: f64,
    /// The most by which a move misses its target along each axis, in millimetres.
    pub repeatability_mm: f64,
    /// The most by which a move turns the camera about each axis, in degrees.
    pub rotation_deg: f64,
    /// The move on which it gets stuck halfway. The first is the one to the centre.
    pub stalls_at_move: Option<u32>,
    /// True if it does not tell where it is.
    #[serde(rename = "silent")]
    pub is_silent: bool,
}

/// The time for which a stage must stand still to count as stuck.
const STALL_TIME: Duration = Duration::from_millis(500);

impl Default for StageImperfections {
    fn default() -> StageImperfections {
        StageImperfections {
            scale: [1.0; 2],
            skew_deg: 0.0,
            backlash_mm: 0.0,
            repeatability_mm: 0.0,
            rotation_deg: 0.0,
            stalls_at_move: None,
            is_silent: false,
        }
    }
}

/// The pose to which a [`SimulatedStage`] has moved its camera. Clones are of the same place.
#[derive(Clone, Debug, Default)]
pub struct SimulatedPlace(Arc<Mutex<StagePose>>);

/// The place to which a stage has moved its camera, and the turn that it has given it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StagePose {
    /// Millimetres to the right of the centre and below it.
    pub position_mm: [f64; 2],
    /// A rotation vector about the axes to the right, down and ahead, in degrees.
    pub rotation_deg: [f64; 3],
}

impl SimulatedPlace {
    /// The place of the camera.
    pub fn get(&self) -> StagePose {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes the camera somewhere.
    pub(super) fn set(&self, pose: StagePose) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = pose;
    }
}

impl SimulatedStage {
    /// A stage at rest in the centre.
    ///
    /// # Errors
    /// The limits are out of range.
    pub fn new(limits: &Limits, errors: StageImperfections) -> Result<SimulatedStage, StageError> {
        SimulatedStage::with_clock(limits, errors, Arc::new(SystemClock))
    }

    /// A stage at rest in the centre, which moves in the time of `clock`.
    ///
    /// # Errors
    /// The limits are out of range.
    pub fn with_clock(limits: &Limits, errors: StageImperfections, clock: Arc<dyn Clock>) -> Result<SimulatedStage, StageError> {
        limits.check()?;
        let departure = clock.now();
        Ok(SimulatedStage {
            clock,
            limits: *limits,
            errors,
            place: SimulatedPlace::default(),
            driven: [0.0; 2],
            carried: [0.0; 2],
            from: [0.0; 2],
            target: Position::CENTER,
            departure,
            moves: 0,
            random: Rng::with_seed(1),
            miss: ([0.0; 2], [0.0; 3]),
        })
    }

    /// The place of the camera.
    pub fn place(&self) -> SimulatedPlace {
        self.place.clone()
    }

    /// Moves the camera to where it is by now. Returns true if it has arrived.
    fn update(&mut self) -> bool {
        let target = [self.target.x_um, self.target.y_um].map(|um| f64::from(um) / 1000.0);
        let way = [target[0] - self.from[0], target[1] - self.from[1]];
        let length = way[0].hypot(way[1]);
        let share = match length > 0.0 {
            true => (self.limits.travelled_mm(length, self.elapsed()) / length).min(if self.is_stuck() { 0.5 } else { 1.0 }),
            false => 1.0,
        };
        self.drive([self.from[0] + share * way[0], self.from[1] + share * way[1]]);
        share >= 1.0
    }

    /// The time since the current move began.
    fn elapsed(&self) -> Duration {
        self.clock.now() - self.departure
    }

    fn is_stuck(&self) -> bool {
        self.errors.stalls_at_move == Some(self.moves)
    }

    /// Drives to a place in millimetres, and takes the camera along.
    fn drive(&mut self, driven: [f64; 2]) {
        self.driven = driven;
        let StageImperfections { scale, skew_deg, backlash_mm, .. } = self.errors;
        let carried = |axis: usize| self.carried[axis].clamp(driven[axis] - backlash_mm / 2.0, driven[axis] + backlash_mm / 2.0);
        self.carried = [carried(0), carried(1)];
        let [x, y] = [0, 1].map(|axis| scale[axis] * self.carried[axis]);
        let (sin, cos) = skew_deg.to_radians().sin_cos();
        let ([miss_x, miss_y], rotation_deg) = self.miss;
        self.place.set(StagePose { position_mm: [x - sin * y + miss_x, cos * y + miss_y], rotation_deg });
    }

    /// The place to which the drives have taken it, in whole micrometres.
    fn measured(&mut self) -> Position {
        self.update();
        let [x_um, y_um] = self.driven.map(|mm| (1000.0 * mm).round() as i32);
        Position { x_um, y_um }
    }
}

impl Stage for SimulatedStage {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.check_reach(position)?;
        self.update();
        (self.from, self.target, self.departure) = (self.driven, position, self.clock.now());
        self.moves += 1;
        let mut within = |most: f64| most * (2.0 * self.random.f64() - 1.0);
        let StageImperfections { repeatability_mm, rotation_deg, .. } = self.errors;
        self.miss = ([(); 2].map(|()| within(repeatability_mm)), [(); 3].map(|()| within(rotation_deg)));
        Ok(())
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        match self.update() {
            false if self.is_stuck() && self.elapsed() > STALL_TIME => {
                let distance_um = self.measured().distance_um(self.target);
                Err(StageError::Stalled { distance_um, after: self.elapsed() })
            }
            arrived => Ok(arrived),
        }
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        let measured = self.measured();
        Ok((!self.errors.is_silent).then_some(measured))
    }

    fn stop(&mut self) -> Result<(), StageError> {
        let here = self.measured();
        self.drive([here.x_um, here.y_um].map(|um| f64::from(um) / 1000.0));
        (self.from, self.target, self.departure) = (self.driven, here, self.clock.now());
        Ok(())
    }
}

/// It measures what an arm does, in the frame of the place where it was opened: where its drives are, and by how much a move missed
/// its target and turned the camera. Play, and axes that are skew or of another scale, it does not notice.
impl PosedStage for SimulatedStage {
    fn tracking(&self) -> Tracking {
        if self.errors.is_silent { Tracking::Planned(self.limits.speed_mm_s) } else { Tracking::Measured }
    }

    fn pose(&mut self) -> Result<Option<Transform>, StageError> {
        self.update();
        let ([x, y], ([miss_x, miss_y], rotation_deg)) = (self.driven, self.miss);
        Ok(Some(Transform { translation_mm: [x + miss_x, y + miss_y, 0.0], rotation_deg }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::SteppedClock;

    #[test]
    fn takes_its_time_and_stops() {
        let limits = Limits { speed_mm_s: 250.0, acceleration_mm_s2: 1200.0, ..Limits::default() };
        let clock = SteppedClock::new();
        let mut stage = SimulatedStage::with_clock(&limits, StageImperfections::default(), clock.clone()).unwrap();
        let place = stage.place();
        let right = Position { x_um: 10_000, y_um: 0 };
        let start = clock.now();
        stage.move_to(right).unwrap();
        assert!(!stage.has_arrived().unwrap());
        while !stage.has_arrived().unwrap() {
            clock.sleep(Duration::from_millis(1));
        }
        assert!(clock.now() - start >= limits.travel_time(10.0));
        assert_eq!((place.get().position_mm, stage.position().unwrap()), ([10.0, 0.0], Some(right)));
        stage.move_to(Position { x_um: 100_000, y_um: 0 }).unwrap();
        stage.stop().unwrap();
        assert!(stage.has_arrived().unwrap() && place.get().position_mm[0] < 100.0);
        assert!(stage.move_to(Position { x_um: 100_001, y_um: 0 }).unwrap_err().to_string().contains("beyond the reach"));
    }

    /// The poses to which a stage with errors takes the camera, move by move.
    fn places(errors: StageImperfections, moves: &[[i32; 2]]) -> Vec<StagePose> {
        let limits = Limits { speed_mm_s: 250.0, acceleration_mm_s2: 1200.0, ..Limits::default() };
        let clock = SteppedClock::new();
        let mut stage = SimulatedStage::with_clock(&limits, errors, clock.clone()).unwrap();
        let mut arrive = |&[x_um, y_um]: &[i32; 2]| {
            stage.move_to(Position { x_um, y_um }).unwrap();
            while !stage.has_arrived().unwrap() {
                clock.sleep(Duration::from_millis(1));
            }
            assert_eq!(stage.position().unwrap(), Some(Position { x_um, y_um }), "the drives do not notice");
            stage.place().get()
        };
        moves.iter().map(&mut arrive).collect()
    }

    #[test]
    fn errors_are_those_that_were_asked_for() {
        let perfect = StageImperfections::default();
        let near = |found: StagePose, x: f64, y: f64| {
            let [dx, dy] = [found.position_mm[0] - x, found.position_mm[1] - y];
            assert!(dx.hypot(dy) < 1e-9, "{found:?} instead of {x}, {y}");
        };
        let scaled = places(StageImperfections { scale: [1.02, 0.99], ..perfect }, &[[1000, 0], [0, -1000]]);
        near(scaled[0], 1.02, 0.0);
        near(scaled[1], 0.0, -0.99);
        // The downward axis leans to the left.
        let skewed = places(StageImperfections { skew_deg: 30.0, ..perfect }, &[[1000, 0], [0, 2000]]);
        near(skewed[0], 1.0, 0.0);
        near(skewed[1], -1.0, 3.0_f64.sqrt());
        // The first move takes up half of the play, the way back all of it.
        let loose = places(StageImperfections { backlash_mm: 0.2, ..perfect }, &[[1000, 0], [500, 0], [550, 0], [2000, 0]]);
        near(loose[0], 0.9, 0.0);
        near(loose[1], 0.6, 0.0);
        near(loose[2], 0.6, 0.0);
        near(loose[3], 1.9, 0.0);
        let shaky = StageImperfections { repeatability_mm: 0.1, rotation_deg: 0.5, ..perfect };
        let moves = [[0, 0]; 40];
        let found = places(shaky, &moves);
        let values = |of: &dyn Fn(&StagePose) -> Vec<f64>| {
            let all: Vec<f64> = found.iter().flat_map(of).collect();
            (all.iter().copied().fold(f64::INFINITY, f64::min), all.iter().copied().fold(f64::NEG_INFINITY, f64::max))
        };
        let (least, most) = values(&|pose| pose.position_mm.to_vec());
        assert!((-0.1..-0.08).contains(&least) && (0.08..=0.1).contains(&most), "{least} to {most}");
        let (least, most) = values(&|pose| pose.rotation_deg.to_vec());
        assert!((-0.5..-0.4).contains(&least) && (0.4..=0.5).contains(&most), "{least} to {most}");
        assert_eq!(places(shaky, &moves), found, "errors are the same in every run");
    }
}
