//! Rays of light.

use super::vec3::Vec3;

/// The points `origin + t * direction` for `t > 0`. The direction need not have length 1.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where the ray starts.
    pub origin: Vec3,
    /// The direction; its length is the unit of `t`.
    pub direction: Vec3,
}

impl Ray {
    /// The point at `t`.
    pub fn at(&self, t: f64) -> Vec3 {
        self.origin + self.direction * t
    }
}
