//! Vectors, rays and poses in space.

use std::ops::{Add, Mul, Neg, Sub};

/// A point or direction in millimetres, or a colour in linear red, green and blue.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vec3 {
    /// The first coordinate, or red.
    pub x: f64,
    /// The second coordinate, or green.
    pub y: f64,
    /// The third coordinate, or blue.
    pub z: f64,
}

impl Vec3 {
    /// The zero vector.
    pub const ZERO: Vec3 = Vec3::new(0.0, 0.0, 0.0);
    /// The unit vector along the first axis.
    pub(crate) const X: Vec3 = Vec3::new(1.0, 0.0, 0.0);
    /// The unit vector along the second axis.
    pub(crate) const Y: Vec3 = Vec3::new(0.0, 1.0, 0.0);
    /// The unit vector along the third axis.
    pub(crate) const Z: Vec3 = Vec3::new(0.0, 0.0, 1.0);

    /// The vector with these components.
    pub const fn new(x: f64, y: f64, z: f64) -> Vec3 {
        Vec3 { x, y, z }
    }

    /// The vector with three equal components.
    pub(crate) const fn splat(value: f64) -> Vec3 {
        Vec3::new(value, value, value)
    }

    /// The linear colour that a display with a gamma of 2 shows for `0xRRGGBB`.
    pub(crate) const fn srgb(hex: u32) -> Vec3 {
        const fn linear(byte: u32) -> f64 {
            let value = (byte & 0xFF) as f64 / 255.0;
            value * value
        }
        Vec3::new(linear(hex >> 16), linear(hex >> 8), linear(hex))
    }

    /// The dot product.
    pub(crate) fn dot(self, other: Vec3) -> f64 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// The cross product.
    pub fn cross(self, other: Vec3) -> Vec3 {
        Vec3::new(self.y * other.z - self.z * other.y, self.z * other.x - self.x * other.z, self.x * other.y - self.y * other.x)
    }

    /// The length.
    pub fn length(self) -> f64 {
        self.dot(self).sqrt()
    }

    /// The unit vector in the same direction.
    pub(crate) fn normalized(self) -> Vec3 {
        self * (1.0 / self.length())
    }

    /// The direction after reflection at a surface with the unit normal `normal`.
    pub(crate) fn reflect(self, normal: Vec3) -> Vec3 {
        self - normal * (2.0 * self.dot(normal))
    }

    /// Linear interpolation from `self` (`share` 0) to `other` (`share` 1).
    pub(crate) fn lerp(self, other: Vec3, share: f64) -> Vec3 {
        self + (other - self) * share
    }

    /// The product of each pair of components: coloured light on a coloured surface.
    pub fn filter(self, other: Vec3) -> Vec3 {
        Vec3::new(self.x * other.x, self.y * other.y, self.z * other.z)
    }

    /// Applies `f` to each component.
    pub fn map(self, f: impl Fn(f64) -> f64) -> Vec3 {
        Vec3::new(f(self.x), f(self.y), f(self.z))
    }
}

impl Add for Vec3 {
    type Output = Vec3;
    fn add(self, other: Vec3) -> Vec3 {
        Vec3::new(self.x + other.x, self.y + other.y, self.z + other.z)
    }
}

impl Sub for Vec3 {
    type Output = Vec3;
    fn sub(self, other: Vec3) -> Vec3 {
        Vec3::new(self.x - other.x, self.y - other.y, self.z - other.z)
    }
}

impl Mul<f64> for Vec3 {
    type Output = Vec3;
    fn mul(self, scale: f64) -> Vec3 {
        Vec3::new(self.x * scale, self.y * scale, self.z * scale)
    }
}

impl Neg for Vec3 {
    type Output = Vec3;
    fn neg(self) -> Vec3 {
        Vec3::ZERO - self
    }
}

impl From<[f64; 3]> for Vec3 {
    fn from([x, y, z]: [f64; 3]) -> Vec3 {
        Vec3::new(x, y, z)
    }
}

/// The points `origin + t * direction` for `t > 0`. The direction need not have length 1.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// The start of the ray.
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

/// A position and an orientation: an origin and three perpendicular unit axes.
///
/// Rotations are given by the tangent of half their angle, which makes sine and cosine rational. So no
/// library function is needed whose last bit might differ between machines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The local origin, in world coordinates.
    pub origin: Vec3,
    /// The local axes, in world coordinates.
    pub axes: [Vec3; 3],
}

impl Pose {
    /// A pose at `origin`, parallel to the world's axes.
    pub const fn at(origin: Vec3) -> Pose {
        Pose { origin, axes: [Vec3::X, Vec3::Y, Vec3::Z] }
    }

    /// The pose rotated by `2 atan(half_tangent)` about its own axis 0, 1 or 2. A positive angle turns the
    /// next axis towards the one after it.
    pub fn turned(mut self, axis: usize, half_tangent: f64) -> Pose {
        let square = half_tangent * half_tangent;
        let (cos, sin) = ((1.0 - square) / (1.0 + square), 2.0 * half_tangent / (1.0 + square));
        let [next, last] = [(axis + 1) % 3, (axis + 2) % 3];
        let (a, b) = (self.axes[next], self.axes[last]);
        self.axes[next] = a * cos + b * sin;
        self.axes[last] = b * cos - a * sin;
        self
    }

    /// The pose moved along its own axes.
    pub fn moved(self, [x, y, z]: [f64; 3]) -> Pose {
        Pose { origin: self.origin + self.axes[0] * x + self.axes[1] * y + self.axes[2] * z, ..self }
    }

    /// The pose rotated about its own axes by a rotation vector: its direction is the axis, its length the angle in radians.
    /// The last bits may differ between machines.
    pub fn rotated(self, rotation: [f64; 3]) -> Pose {
        let [x, y, z] = rotation;
        let vector = Vec3::new(x, y, z);
        let angle = vector.length();
        if angle == 0.0 {
            return self;
        }
        let axis = vector * (1.0 / angle);
        let (sin, cos) = angle.sin_cos();
        // Rodrigues' formula.
        let turn = |local: Vec3| local * cos + axis.cross(local) * sin + axis * (axis.dot(local) * (1.0 - cos));
        Pose { axes: [Vec3::X, Vec3::Y, Vec3::Z].map(|local| self.world_direction(turn(local))), ..self }
    }

    /// Converts a direction from world to local coordinates.
    pub fn local_direction(&self, world: Vec3) -> Vec3 {
        Vec3::new(self.axes[0].dot(world), self.axes[1].dot(world), self.axes[2].dot(world))
    }

    /// Converts a point from world to local coordinates.
    pub(crate) fn local_point(&self, world: Vec3) -> Vec3 {
        self.local_direction(world - self.origin)
    }

    /// Converts a direction from local to world coordinates.
    pub fn world_direction(&self, local: Vec3) -> Vec3 {
        self.axes[0] * local.x + self.axes[1] * local.y + self.axes[2] * local.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rotation_vector_turns_as_three_turns_do() {
        let pose = Pose::at(Vec3::new(1.0, 2.0, 3.0)).turned(0, 0.3).turned(2, -0.2);
        for axis in 0..3 {
            let half_tangent: f64 = 0.07;
            let mut vector = [0.0; 3];
            vector[axis] = 2.0 * half_tangent.atan();
            let [expected, found] = [pose.turned(axis, half_tangent), pose.rotated(vector)];
            for (a, b) in expected.axes.iter().zip(found.axes) {
                assert!((*a - b).length() < 1e-14, "axis {axis}: {a:?}, {b:?}");
            }
        }
        assert_eq!(pose.rotated([0.0; 3]), pose);
        let there = pose.moved([4.0, -5.0, 6.0]);
        assert!((pose.local_point(there.origin) - Vec3::new(4.0, -5.0, 6.0)).length() < 1e-12);
    }
}
