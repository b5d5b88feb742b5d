//! The limits of a stage: reach, speed and waiting times, and detecting moves that make no progress.

use std::{
    ops::RangeInclusive,
    time::{Duration, Instant},
};

use multiscopic_core::capture::Position;

use super::error::StageError;

/// The limits of a stage: reach, speed and waiting times.
///
/// The defaults are slow on purpose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// The largest distance from where the stage was opened, in micrometres: 1 to 1 000 000, by default 100 000.
    /// A position beyond that is refused before anything moves.
    pub reach_um: u32,
    /// Speed in millimetres per second: above 0 and at most 250, the limit for robots next to people. By
    /// default 50.
    pub speed_mm_s: f64,
    /// Acceleration in millimetres per second squared: above 0 and at most 1200, by default 100. G-code
    /// machines ignore it: they have their own.
    pub acceleration_mm_s2: f64,
    /// The time that a stage may take to answer for the first time. By default 10 s, because some boards boot when
    /// their port is opened.
    pub connect_timeout: Duration,
    /// The time that a stage may take to answer, or to send its next report. By default 3 s.
    pub silence_timeout: Duration,
    /// The time for which a stage may make no progress towards its target. By default 5 s.
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
    /// Below 1 µm/s, a stage would seem not to move at all.
    const SPEED_MM_S: RangeInclusive<f64> = 1e-3..=250.0;
    const ACCELERATION_MM_S2: RangeInclusive<f64> = 1e-3..=1200.0;

    /// The time that a move of `distance_mm` takes from rest to rest, at this acceleration and speed.
    pub fn travel_time(&self, distance_mm: f64) -> Duration {
        let Limits { speed_mm_s: speed, acceleration_mm_s2: acceleration, .. } = *self;
        let seconds = match distance_mm * acceleration < speed.powi(2) {
            true => 2.0 * (distance_mm / acceleration).sqrt(),
            false => distance_mm / speed + speed / acceleration,
        };
        Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX)
    }

    /// The way in millimetres that a move of `distance_mm` has come `elapsed` after it began: from rest to rest, at this
    /// acceleration and speed.
    pub fn travelled_mm(&self, distance_mm: f64, elapsed: Duration) -> f64 {
        let (whole, time) = (self.travel_time(distance_mm).as_secs_f64(), elapsed.as_secs_f64());
        let Limits { speed_mm_s: speed, acceleration_mm_s2: acceleration, .. } = *self;
        // The way back from the end is the same.
        let since_rest = time.min(whole - time).max(0.0);
        let ramp = since_rest.min(speed / acceleration);
        let way = acceleration * ramp * ramp / 2.0 + speed * (since_rest - ramp);
        if 2.0 * time <= whole { way } else { distance_mm - way }
    }

    /// Fails if a limit is out of range.
    pub(super) fn check(&self) -> Result<(), StageError> {
        let numbers = [
            ("reach in um", f64::from(self.reach_um), Self::REACH_UM),
            ("speed in mm/s", self.speed_mm_s, Self::SPEED_MM_S),
            ("acceleration in mm/s2", self.acceleration_mm_s2, Self::ACCELERATION_MM_S2),
        ];
        let outside = numbers.into_iter().find(|(_, value, range)| !range.contains(value));
        outside.map_or(Ok(()), |(name, value, range)| Err(StageError::Limits { name, value, range }))
    }

    /// Fails if a position is out of reach.
    pub(super) fn check_reach(&self, position: Position) -> Result<(), StageError> {
        match f64::from(position.x_um).hypot(f64::from(position.y_um)) <= f64::from(self.reach_um) {
            true => Ok(()),
            false => Err(StageError::OutOfReach { position, reach_um: self.reach_um }),
        }
    }
}

/// Measures how long a stage has come no nearer to its target.
#[derive(Clone, Copy, Debug)]
pub(super) struct StallTimer {
    /// The shortest distance to the target so far.
    nearest: f64,
    /// When it was reached.
    since: Instant,
    /// The least approach that counts as progress.
    min_step: f64,
}

impl StallTimer {
    /// Starts at time `now`, at a distance from the target. All distances are in one unit, the caller's.
    pub(super) fn start(distance: f64, min_step: f64, now: Instant) -> StallTimer {
        StallTimer { nearest: distance, since: now, min_step }
    }

    /// Takes the distance at time `at`, and returns how long there has been no progress.
    pub(super) fn update(&mut self, distance: f64, at: Instant) -> Duration {
        if distance < self.nearest - self.min_step {
            (self.nearest, self.since) = (distance, at);
        }
        at.saturating_duration_since(self.since)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reach_is_a_circle() {
        let limits = Limits { reach_um: 5000, ..Limits::default() };
        let is_in_reach = |x_um, y_um| limits.check_reach(Position { x_um, y_um }).is_ok();
        assert!(is_in_reach(0, 0) && is_in_reach(-5000, 0) && is_in_reach(3000, -4000));
        assert!(!is_in_reach(5001, 0) && !is_in_reach(3001, 4000) && !is_in_reach(i32::MIN, i32::MIN));
        let refusal = limits.check_reach(Position { x_um: 0, y_um: 6000 }).unwrap_err().to_string();
        assert_eq!(
            refusal,
            "(0, 6) mm is beyond the reach of 5 mm from where the stage started; allow a longer reach if that is safe"
        );
    }

    #[test]
    fn moves_speed_up_and_slow_down() {
        let limits = Limits { speed_mm_s: 50.0, acceleration_mm_s2: 100.0, ..Limits::default() };
        let seconds = |mm| limits.travel_time(mm).as_secs_f64();
        // Half a second and 12.5 mm to reach the speed, and as much to stop.
        assert_eq!([seconds(0.0), seconds(25.0), seconds(75.0)], [0.0, 1.0, 2.0]);
        assert!((seconds(1.0) - 0.2).abs() < 1e-9);
    }

    #[test]
    fn moves_are_at_constant_speed_between_their_ramps() {
        let limits = Limits { speed_mm_s: 50.0, acceleration_mm_s2: 100.0, ..Limits::default() };
        let travelled = |mm: f64, seconds: f64| limits.travelled_mm(mm, Duration::from_secs_f64(seconds));
        assert_eq!(
            [0.0, 0.1, 0.5, 0.75, 1.25, 1.5, 2.0, 9.0].map(|s| travelled(75.0, s)),
            [0.0, 0.5, 12.5, 25.0, 50.0, 62.5, 75.0, 75.0]
        );
        // A short move never reaches the speed.
        assert!((travelled(1.0, 0.1) - 0.5).abs() < 1e-9 && travelled(1.0, 0.2) == 1.0);
    }

    #[test]
    fn values_out_of_range_are_refused() {
        assert!(Limits::default().check().is_ok());
        let wrong = [f64::NAN, f64::INFINITY, 0.0, -1.0, 1201.0].map(|number| {
            let speed = Limits { speed_mm_s: number, ..Limits::default() };
            let acceleration = Limits { acceleration_mm_s2: number, ..Limits::default() };
            speed.check().is_err() && acceleration.check().is_err()
        });
        assert_eq!(wrong, [true; 5]);
        assert!(Limits { reach_um: 0, ..Limits::default() }.check().is_err());
    }

    #[test]
    fn only_progress_resets_the_timer() {
        let mut timer = StallTimer::start(10.0, 0.5, Instant::now());
        let seconds = |number| timer.since + Duration::from_secs(number);
        let [at_1, at_3, at_4] = [1, 3, 4].map(seconds);
        assert_eq!(timer.update(9.6, at_1), Duration::from_secs(1));
        assert_eq!(timer.update(9.4, at_3), Duration::ZERO);
        assert_eq!(timer.update(12.0, at_4), Duration::from_secs(1));
    }
}
