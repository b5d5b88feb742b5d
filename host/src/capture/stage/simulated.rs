//! A simulated stage.

use std::{
    sync::{Arc, Mutex, PoisonError},
    time::Instant,
};

use multiscopic_core::capture::{Position, Stage};

use super::{error::StageError, limits::Limits};

/// A stage without hardware, which takes the time that a real one would.
#[derive(Debug)]
pub struct SimulatedStage {
    limits: Limits,
    place: SimulatedPlace,
    from: [f64; 2],
    target: Position,
    departure: Instant,
}

/// Where a [`SimulatedStage`] has moved its camera. Clones are of the same place.
#[derive(Clone, Debug, Default)]
pub struct SimulatedPlace(Arc<Mutex<[f64; 2]>>);

impl SimulatedPlace {
    /// Millimetres to the right of the centre and below it.
    pub fn get(&self) -> [f64; 2] {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set(&self, place: [f64; 2]) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = place;
    }
}

impl SimulatedStage {
    /// A stage at rest in the centre.
    ///
    /// # Errors
    /// The limits are out of range.
    pub fn new(limits: &Limits) -> Result<SimulatedStage, StageError> {
        limits.check()?;
        let (target, departure) = (Position::CENTER, Instant::now());
        Ok(SimulatedStage { limits: *limits, place: SimulatedPlace::default(), from: [0.0; 2], target, departure })
    }

    /// Where the camera is.
    pub fn place(&self) -> SimulatedPlace {
        self.place.clone()
    }

    /// Moves the camera to where it is by now, and tells whether it has arrived.
    fn update(&mut self) -> bool {
        let target = [self.target.x_um, self.target.y_um].map(|um| f64::from(um) / 1000.0);
        let way = [target[0] - self.from[0], target[1] - self.from[1]];
        let whole = self.limits.travel_time(way[0].hypot(way[1]));
        let share = match whole.is_zero() {
            true => 1.0,
            false => (self.departure.elapsed().as_secs_f64() / whole.as_secs_f64()).min(1.0),
        };
        self.place.set([self.from[0] + share * way[0], self.from[1] + share * way[1]]);
        share >= 1.0
    }

    /// Where the camera is, in whole micrometres.
    fn measured(&mut self) -> Position {
        self.update();
        let [x_um, y_um] = self.place.get().map(|mm| (1000.0 * mm).round() as i32);
        Position { x_um, y_um }
    }
}

impl Stage for SimulatedStage {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.limits.check_reach(position)?;
        self.update();
        (self.from, self.target, self.departure) = (self.place.get(), position, Instant::now());
        Ok(())
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        Ok(self.update())
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        Ok(Some(self.measured()))
    }

    fn stop(&mut self) -> Result<(), StageError> {
        let here = self.measured();
        self.place.set([here.x_um, here.y_um].map(|um| f64::from(um) / 1000.0));
        (self.from, self.target, self.departure) = (self.place.get(), here, Instant::now());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn takes_its_time_and_stops() {
        let limits = Limits { speed_mm_s: 250.0, acceleration_mm_s2: 1200.0, ..Limits::default() };
        let mut stage = SimulatedStage::new(&limits).unwrap();
        let place = stage.place();
        let right = Position { x_um: 10_000, y_um: 0 };
        let start = Instant::now();
        stage.move_to(right).unwrap();
        assert!(!stage.has_arrived().unwrap());
        while !stage.has_arrived().unwrap() {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(start.elapsed() >= limits.travel_time(10.0));
        assert_eq!((place.get(), stage.position().unwrap()), ([10.0, 0.0], Some(right)));
        stage.move_to(Position { x_um: 100_000, y_um: 0 }).unwrap();
        stage.stop().unwrap();
        assert!(stage.has_arrived().unwrap() && place.get()[0] < 100.0);
        assert!(stage.move_to(Position { x_um: 100_001, y_um: 0 }).unwrap_err().to_string().contains("beyond the reach"));
    }
}
