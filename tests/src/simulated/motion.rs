//! How the arm moves.

use std::time::{Duration, Instant};

use crate::simulated::pose::{Pose, between, distance};

/// A straight motion that speeds up, goes on, and slows down.
#[derive(Clone, Debug)]
pub struct Motion {
    from: Pose,
    to: Pose,
    /// In metres, per second, per second squared.
    length: f64,
    speed: f64,
    acceleration: f64,
    /// How far it is, and how fast.
    gone: f64,
    now: f64,
    /// How it was told to stop, if it was.
    stopping: Option<f64>,
    at: Instant,
}

impl Motion {
    /// The steps of its arithmetic.
    const STEP: Duration = Duration::from_millis(1);

    /// A motion that begins now, in metres and seconds.
    pub fn new(from: Pose, to: Pose, speed: f64, acceleration: f64) -> Motion {
        let length = distance(from, to);
        Motion { from, to, length, speed, acceleration, gone: 0.0, now: 0.0, stopping: None, at: Instant::now() }
    }

    /// Goes on until now, with its speed scaled.
    pub fn advance(&mut self, scaling: f64) {
        let now = Instant::now();
        while now - self.at >= Self::STEP && !self.has_ended() {
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

    /// Slows down to a stand.
    pub fn stop(&mut self, deceleration: f64) {
        self.stopping = Some(deceleration);
    }

    /// Stands at once.
    pub fn halt(&mut self) {
        (self.stopping, self.now) = (Some(1.0), 0.0);
    }

    /// Whether it has come to its end, or stopped.
    pub fn has_ended(&self) -> bool {
        self.gone >= self.length || (self.stopping.is_some() && self.now == 0.0)
    }

    /// How far it has come, in metres.
    pub fn gone(&self) -> f64 {
        self.gone
    }

    /// Where it is.
    pub fn pose(&self) -> Pose {
        match self.gone >= self.length {
            true => self.to,
            false => between(self.from, self.to, self.gone / self.length),
        }
    }

    /// How fast it is, in metres per second along each axis; it does not say how fast it turns.
    pub fn velocity(&self) -> [f64; 6] {
        let along = |i: usize| if self.length > 0.0 { (self.to[i] - self.from[i]) / self.length * self.now } else { 0.0 };
        [along(0), along(1), along(2), 0.0, 0.0, 0.0]
    }
}
