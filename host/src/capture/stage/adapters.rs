//! Stages made from others: of any kind, or along other axes.

use multiscopic_core::capture::{Position, Stage};

use super::{
    error::StageError,
    posed::{PosedStage, Tracking},
    simulated::{SimulatedPlace, StagePose},
};
use crate::images::Transform;

/// A stage whose positions are turned about its centre, so that a camera that is mounted at an angle moves along its own rows and
/// columns.
#[derive(Debug)]
pub struct TurnedStage<S> {
    stage: S,
    /// Radians from the stage's axis to the right towards that down.
    angle: f64,
}

impl<S> TurnedStage<S> {
    /// Turns the axes of `stage` by `angle` radians, from right towards down.
    pub fn new(stage: S, angle: f64) -> TurnedStage<S> {
        TurnedStage { stage, angle }
    }
}

/// The position turned about the centre, to the nearest micrometre.
fn turned(Position { x_um, y_um }: Position, angle: f64) -> Position {
    let ([x, y], (sin, cos)) = ([x_um, y_um].map(f64::from), angle.sin_cos());
    Position { x_um: (x * cos - y * sin).round() as i32, y_um: (x * sin + y * cos).round() as i32 }
}

impl<S: Stage> Stage for TurnedStage<S> {
    type Error = S::Error;

    fn move_to(&mut self, position: Position) -> Result<(), S::Error> {
        self.stage.move_to(turned(position, self.angle))
    }

    fn has_arrived(&mut self) -> Result<bool, S::Error> {
        self.stage.has_arrived()
    }

    fn position(&mut self) -> Result<Option<Position>, S::Error> {
        Ok(self.stage.position()?.map(|position| turned(position, -self.angle)))
    }

    fn stop(&mut self) -> Result<(), S::Error> {
        self.stage.stop()
    }
}

impl<S: PosedStage> PosedStage for TurnedStage<S> {
    fn tracking(&self) -> Tracking {
        self.stage.tracking()
    }

    fn pose(&mut self) -> Result<Option<Transform>, S::Error> {
        self.stage.pose()
    }
}

/// A stage that tells a simulated camera where it is: where it was measured to be, or else where it was sent.
#[derive(Debug)]
pub struct FollowedStage<S> {
    stage: S,
    place: SimulatedPlace,
    target: Position,
}

impl<S> FollowedStage<S> {
    /// A stage that stands in its centre.
    pub fn new(stage: S) -> FollowedStage<S> {
        FollowedStage { stage, place: SimulatedPlace::default(), target: Position::CENTER }
    }

    /// The place of the camera, which changes when the stage's [position](Stage::position) is asked for.
    pub fn place(&self) -> SimulatedPlace {
        self.place.clone()
    }
}

impl<S: Stage> Stage for FollowedStage<S> {
    type Error = S::Error;

    fn move_to(&mut self, position: Position) -> Result<(), S::Error> {
        self.stage.move_to(position)?;
        self.target = position;
        Ok(())
    }

    fn has_arrived(&mut self) -> Result<bool, S::Error> {
        self.stage.has_arrived()
    }

    fn position(&mut self) -> Result<Option<Position>, S::Error> {
        let measured = self.stage.position()?;
        let Position { x_um, y_um } = measured.unwrap_or(self.target);
        self.place.set(StagePose { position_mm: [x_um, y_um].map(|um| f64::from(um) / 1e3), ..StagePose::default() });
        Ok(measured)
    }

    fn stop(&mut self) -> Result<(), S::Error> {
        self.stage.stop()
    }
}

impl<S: PosedStage> PosedStage for FollowedStage<S> {
    fn tracking(&self) -> Tracking {
        self.stage.tracking()
    }

    fn pose(&mut self) -> Result<Option<Transform>, S::Error> {
        self.stage.pose()
    }
}

/// A stage of any kind.
pub struct AnyStage(Box<dyn PosedStage<Error = StageError> + Send>);

impl AnyStage {
    /// Boxes a stage.
    pub fn new(stage: impl PosedStage<Error = StageError> + Send + 'static) -> AnyStage {
        AnyStage(Box::new(stage))
    }
}

impl Stage for AnyStage {
    type Error = StageError;

    fn move_to(&mut self, position: Position) -> Result<(), StageError> {
        self.0.move_to(position)
    }

    fn has_arrived(&mut self) -> Result<bool, StageError> {
        self.0.has_arrived()
    }

    fn position(&mut self) -> Result<Option<Position>, StageError> {
        self.0.position()
    }

    fn stop(&mut self) -> Result<(), StageError> {
        self.0.stop()
    }
}

impl PosedStage for AnyStage {
    fn tracking(&self) -> Tracking {
        self.0.tracking()
    }

    fn pose(&mut self) -> Result<Option<Transform>, StageError> {
        self.0.pose()
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::capture::{
        Clock, SteppedClock,
        stage::{Limits, SimulatedStage, StageImperfections},
    };

    #[test]
    fn a_camera_follows_what_is_measured() {
        let limits = Limits { speed_mm_s: 250.0, acceleration_mm_s2: 1200.0, ..Limits::default() };
        let clock = SteppedClock::new();
        let stage = SimulatedStage::with_clock(&limits, StageImperfections::default(), clock.clone()).unwrap();
        let mut stage = FollowedStage::new(stage);
        let place = stage.place();
        stage.move_to(Position { x_um: 20_000, y_um: -4000 }).unwrap();
        clock.sleep(limits.travel_time(20.4) / 2);
        let halfway = stage.position().unwrap().unwrap();
        assert!((5000..15_000).contains(&halfway.x_um), "{halfway:?}");
        assert_eq!(place.get().position_mm, [halfway.x_um, halfway.y_um].map(|um| f64::from(um) / 1e3));
    }

    #[test]
    fn positions_are_turned_there_and_back() {
        let limits = Limits { speed_mm_s: 250.0, acceleration_mm_s2: 1200.0, ..Limits::default() };
        let clock = SteppedClock::new();
        let stage = SimulatedStage::with_clock(&limits, StageImperfections::default(), clock.clone()).unwrap();
        let place = stage.place();
        let mut stage = TurnedStage::new(stage, 30.0_f64.to_radians());
        let right = Position { x_um: 2000, y_um: 0 };
        stage.move_to(right).unwrap();
        while !stage.has_arrived().unwrap() {
            clock.sleep(Duration::from_millis(1));
        }
        assert_eq!(place.get().position_mm, [1.732, 1.0]);
        assert_eq!(stage.position().unwrap(), Some(right));
    }
}
