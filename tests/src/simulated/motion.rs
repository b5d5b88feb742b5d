//! Straight motions with a trapezoidal speed profile.

use std::time::{Duration, Instant};

use crate::simulated::pose::{Pose, between, distance};

/// A straight motion that accelerates, cruises and decelerates.
#[derive(Clone, Debug)]
pub struct Motion {
    from: Pose,
    to: Pose,
    /// In metres, metres per second, and metres per second squared.
    length: f64,
    speed: f64,
    acceleration: f64,
    /// Distance covered and current speed.
    gone: f64,
    now: f64,
    /// The deceleration of a commanded stop.
    stopping: Option<f64>,
    at: Instant,
}

impl Motion {
    /// The integration step.
    const STEP: Duration = Duration::from_millis(1);

    /// A motion that begins at time `now`, in metres and seconds.
    pub fn new(from: Pose, to: Pose, speed: f64, acceleration: f64, now: Instant) -> Motion {
        let length = distance(from, to);
        Motion { from, to, length, speed, acceleration, gone: 0.0, now: 0.0, stopping: None, at: now }
    }

    /// Advances the motion to time `now`, at scaled speed. Time stands still for it once it has covered `limit` metres.
    pub fn advance(&mut self, now: Instant, scaling: f64, limit: f64) {
        while now - self.at >= Self::STEP && !self.has_ended() {
            if self.gone >= limit {
                self.at = now;
                return;
            }
            self.at += Self::STEP;
            let dt = Self::STEP.as_secs_f64();
            self.now = match self.stopping {
                Some(deceleration) => (self.now - deceleration * dt).max(0.0),
                None => {
                    let to_end = (2.0 * self.acceleration * (self.length - self.gone)).sqrt();
                    (self.now + self.acceleration * dt).min(self.speed * scaling).min(to_end)
                }
            };
            self.gone += self.now * dt;
            if self.length - self.gone < 1e-7 {
                (self.gone, self.now) = (self.length, 0.0);
            }
        }
    }

    /// Decelerates to a halt.
    pub fn stop(&mut self, deceleration: f64) {
        self.stopping = Some(deceleration);
    }

    /// Halts at once.
    pub fn halt(&mut self) {
        (self.stopping, self.now) = (Some(1.0), 0.0);
    }

    /// Returns true if it has reached its end or stopped.
    pub fn has_ended(&self) -> bool {
        self.gone >= self.length || (self.stopping.is_some() && self.now == 0.0)
    }

    /// The distance covered, in metres.
    pub fn gone(&self) -> f64 {
        self.gone
    }

    /// Its pose.
    pub fn pose(&self) -> Pose {
        match self.gone >= self.length {
            true => self.to,
            false => between(self.from, self.to, self.gone / self.length),
        }
    }

    /// The speed along each axis in metres per second; rotational speeds are reported as 0.
    pub fn velocity(&self) -> [f64; 6] {
        let along = |i: usize| if self.length > 0.0 { (self.to[i] - self.from[i]) / self.length * self.now } else { 0.0 };
        [along(0), along(1), along(2), 0.0, 0.0, 0.0]
    }
}
