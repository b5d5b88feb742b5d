//! How far and how fast a stage may go.

use std::{ops::RangeInclusive, time::Duration};

use multiscopic_core::capture::Position;

use super::StageError;

/// How far and how fast a stage may go, and how long it is waited for.
///
/// The defaults are slow on purpose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// How far from where it was opened it may go, in micrometres, 1 to 1 000 000: 100 000. A longer move is refused before anything moves.
    pub reach_um: u32,
    /// Speed in millimetres per second, above 0 and at most 250, what arms beside people may do: 50.
    pub speed_mm_s: f64,
    /// Acceleration in millimetres per second squared, above 0 and at most 1200: 100. A machine that takes G-code has its own.
    pub acceleration_mm_s2: f64,
    /// How long a stage may take to answer for the first time, which some boards do only after they have booted: 10 s.
    pub connect_timeout: Duration,
    /// How long a stage may be silent that should speak: 3 s.
    pub silence_timeout: Duration,
    /// How long a stage may come no nearer to where it was sent: 5 s.
    pub stall_timeout: Duration,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            reach_um: 100_000,
            speed_mm_s: 50.0,
            acceleration_mm_s2: 100.0,
            connect_timeout: Duration::from_secs(10),
            silence_timeout: Duration::from_secs(3),
            stall_timeout: Duration::from_secs(5),
        }
    }
}

impl Limits {
    const REACH_UM: RangeInclusive<f64> = 1.0..=1e6;
    /// Nothing moves with less.
    const SPEED_MM_S: RangeInclusive<f64> = 1e-3..=250.0;
    const ACCELERATION_MM_S2: RangeInclusive<f64> = 1e-3..=1200.0;

    /// Refuses limits out of their range.
    pub(super) fn check(&self) -> Result<(), StageError> {
        let numbers = [
            ("reach in um", f64::from(self.reach_um), Self::REACH_UM),
            ("speed in mm/s", self.speed_mm_s, Self::SPEED_MM_S),
            ("acceleration in mm/s2", self.acceleration_mm_s2, Self::ACCELERATION_MM_S2),
        ];
        let outside = numbers.into_iter().find(|(_, value, range)| !range.contains(value));
        outside.map_or(Ok(()), |(name, value, range)| Err(StageError::Limits { name, value, range }))
    }

    /// Refuses a position beyond the reach.
    pub(super) fn admit(&self, position: Position) -> Result<(), StageError> {
        match f64::from(position.x_um).hypot(f64::from(position.y_um)) <= f64::from(self.reach_um) {
            true => Ok(()),
            false => Err(StageError::OutOfReach { position, reach_um: self.reach_um }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reach_is_a_circle() {
        let limits = Limits { reach_um: 5000, ..Limits::default() };
        let admits = |x_um, y_um| limits.admit(Position { x_um, y_um }).is_ok();
        assert!(admits(0, 0) && admits(-5000, 0) && admits(3000, -4000));
        assert!(!admits(5001, 0) && !admits(3001, 4000) && !admits(i32::MIN, i32::MIN));
        let refusal = limits.admit(Position { x_um: 0, y_um: 6000 }).unwrap_err().to_string();
        assert_eq!(refusal, "the stage may go 5 mm from where it began, not to (0, 6) mm; a longer reach must be allowed first");
    }

    #[test]
    fn limits_have_limits() {
        assert!(Limits::default().check().is_ok());
        let wrong = [f64::NAN, f64::INFINITY, 0.0, -1.0, 1201.0].map(|number| {
            let speed = Limits { speed_mm_s: number, ..Limits::default() };
            let acceleration = Limits { acceleration_mm_s2: number, ..Limits::default() };
            speed.check().is_err() && acceleration.check().is_err()
        });
        assert_eq!(wrong, [true; 5]);
        assert!(Limits { reach_um: 0, ..Limits::default() }.check().is_err());
    }
}
