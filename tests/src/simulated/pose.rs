//! Poses in the arm's notation, computed with quaternions, and straight motions between them.

use std::{
    ops::Mul,
    time::{Duration, Instant},
};

/// A pose: a position in metres, then a rotation vector in radians.
pub type Pose = [f64; 6];

/// URScript's `pose_trans`: transforms `to` from the frame of `from` into the base's.
pub fn pose_trans(from: Pose, to: Pose) -> Pose {
    let turn = Quaternion::of(from);
    let moved = turn.turn([to[0], to[1], to[2]]);
    let rotation = (turn * Quaternion::of(to)).rotation();
    [from[0] + moved[0], from[1] + moved[1], from[2] + moved[2], rotation[0], rotation[1], rotation[2]]
}

/// Interpolates between two poses: along a straight line, with even rotation.
pub fn between(from: Pose, to: Pose, share: f64) -> Pose {
    let start = Quaternion::of(from);
    let whole = (start.inverse() * Quaternion::of(to)).rotation();
    let turned = match whole == [0.0; 3] {
        // Return it as given: several rotation vectors describe one rotation.
        true => [from[3], from[4], from[5]],
        false => (start * Quaternion::turning(whole.map(|angle| angle * share))).rotation(),
    };
    let place = |i: usize| from[i] + (to[i] - from[i]) * share;
    [place(0), place(1), place(2), turned[0], turned[1], turned[2]]
}

/// The distance between two poses in metres.
pub fn distance(a: Pose, b: Pose) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1]).hypot(a[2] - b[2])
}

/// The angle between two poses in radians.
pub fn angle(a: Pose, b: Pose) -> f64 {
    let [x, y, z] = (Quaternion::of(a).inverse() * Quaternion::of(b)).rotation();
    x.hypot(y).hypot(z)
}

#[derive(Clone, Copy)]
struct Quaternion {
    real: f64,
    imaginary: [f64; 3],
}

impl Quaternion {
    fn of(pose: Pose) -> Quaternion {
        Quaternion::turning([pose[3], pose[4], pose[5]])
    }

    fn turning(rotation: [f64; 3]) -> Quaternion {
        let angle = rotation[0].hypot(rotation[1]).hypot(rotation[2]);
        let share = if angle < 1e-12 { 0.5 } else { (angle / 2.0).sin() / angle };
        Quaternion { real: (angle / 2.0).cos(), imaginary: rotation.map(|component| component * share) }
    }

    fn rotation(self) -> [f64; 3] {
        let sine = self.imaginary[0].hypot(self.imaginary[1]).hypot(self.imaginary[2]);
        if sine < 1e-12 {
            return [0.0; 3];
        }
        let angle = 2.0 * sine.atan2(self.real);
        self.imaginary.map(|component| component / sine * angle)
    }

    fn inverse(self) -> Quaternion {
        Quaternion { real: self.real, imaginary: self.imaginary.map(|component| -component) }
    }

    fn turn(self, vector: [f64; 3]) -> [f64; 3] {
        (self * Quaternion { real: 0.0, imaginary: vector } * self.inverse()).imaginary
    }
}

impl Mul for Quaternion {
    type Output = Quaternion;

    fn mul(self, other: Quaternion) -> Quaternion {
        let (w, [x, y, z]) = (self.real, self.imaginary);
        let (v, [a, b, c]) = (other.real, other.imaginary);
        Quaternion {
            real: w * v - x * a - y * b - z * c,
            imaginary: [w * a + x * v + y * c - z * b, w * b - x * c + y * v + z * a, w * c + x * b - y * a + z * v],
        }
    }
}

/// A straight motion with a trapezoidal speed profile: it accelerates, cruises and decelerates.
#[derive(Clone, Debug)]
pub(super) struct Motion {
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

#[cfg(test)]
mod tests {
    use super::*;

    use std::f64::consts::{FRAC_PI_2, PI};

    #[track_caller]
    fn assert_near(found: Pose, expected: Pose) {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?} instead of {expected:?}");
    }

    #[test]
    fn transformations_equal_hand_computed_poses() {
        let offset = [0.1, 0.2, 0.0, 0.0, 0.0, 0.0];
        assert_near(pose_trans([1.0, 2.0, 3.0, 0.0, 0.0, 0.0], offset), [1.1, 2.2, 3.0, 0.0, 0.0, 0.0]);
        // A tool that looks down has its y axis reversed.
        assert_near(pose_trans([1.0, 2.0, 3.0, PI, 0.0, 0.0], offset), [1.1, 1.8, 3.0, PI, 0.0, 0.0]);
        // A quarter turn about z: x becomes y, y becomes -x.
        assert_near(pose_trans([1.0, 2.0, 3.0, 0.0, 0.0, FRAC_PI_2], offset), [0.8, 2.1, 3.0, 0.0, 0.0, FRAC_PI_2]);
        // A third of a turn about (1, 1, 1): x becomes y, y becomes z.
        let third = 2.0 * PI / 3.0 / 3f64.sqrt();
        assert_near(pose_trans([0.0, 0.0, 0.0, third, third, third], offset), [0.0, 0.1, 0.2, third, third, third]);
        // Rotations about one axis add up.
        assert_near(pose_trans([0.0, 0.0, 0.0, 0.0, 0.0, 0.3], [0.0, 0.0, 0.0, 0.0, 0.0, 0.2]), [0.0, 0.0, 0.0, 0.0, 0.0, 0.5]);
    }

    #[test]
    fn interpolation_meets_in_the_middle() {
        let (from, to) = ([0.0, 0.0, 0.0, 0.0, 0.2, 0.0], [0.2, 0.0, -0.4, 0.0, 0.4, 0.0]);
        assert_near(between(from, to, 0.5), [0.1, 0.0, -0.2, 0.0, 0.3, 0.0]);
        assert!((angle(from, to) - 0.2).abs() < 1e-12);
    }
}
