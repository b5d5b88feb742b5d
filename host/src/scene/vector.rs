//! Points, directions and colours, and rigid placements of them.

use std::ops::{Add, Mul, Neg, Sub};

/// A point or direction in millimetres, or a colour as linear red, green and blue.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Vec3 {
    /// To the right, or red.
    pub x: f64,
    /// Along the second axis, or green.
    pub y: f64,
    /// Away from the camera, or blue.
    pub z: f64,
}

impl Vec3 {
    /// All three components zero.
    pub const ZERO: Vec3 = Vec3::new(0.0, 0.0, 0.0);
    /// The first axis.
    pub const X: Vec3 = Vec3::new(1.0, 0.0, 0.0);
    /// The second axis.
    pub const Y: Vec3 = Vec3::new(0.0, 1.0, 0.0);
    /// The third axis.
    pub const Z: Vec3 = Vec3::new(0.0, 0.0, 1.0);

    /// The vector of these components.
    pub const fn new(x: f64, y: f64, z: f64) -> Vec3 {
        Vec3 { x, y, z }
    }

    /// All three components the same.
    pub const fn splat(value: f64) -> Vec3 {
        Vec3::new(value, value, value)
    }

    /// The linear colour that is displayed as `0xRRGGBB`, with a display gamma of 2.
    pub const fn srgb(hex: u32) -> Vec3 {
        const fn linear(byte: u32) -> f64 {
            let value = (byte & 0xFF) as f64 / 255.0;
            value * value
        }
        Vec3::new(linear(hex >> 16), linear(hex >> 8), linear(hex))
    }

    /// The inner product.
    pub fn dot(self, other: Vec3) -> f64 {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    /// The vector product.
    pub fn cross(self, other: Vec3) -> Vec3 {
        Vec3::new(self.y * other.z - self.z * other.y, self.z * other.x - self.x * other.z, self.x * other.y - self.y * other.x)
    }

    /// The length.
    pub fn length(self) -> f64 {
        self.dot(self).sqrt()
    }

    /// The same direction with length 1.
    pub fn normalized(self) -> Vec3 {
        self * (1.0 / self.length())
    }

    /// This direction mirrored at a surface with unit normal `normal`.
    pub fn reflect(self, normal: Vec3) -> Vec3 {
        self - normal * (2.0 * self.dot(normal))
    }

    /// From `self` (`share` 0) to `other` (`share` 1) on a straight line.
    pub fn lerp(self, other: Vec3, share: f64) -> Vec3 {
        self + (other - self) * share
    }

    /// Each component times its counterpart, as a coloured surface does to coloured light.
    pub fn filter(self, other: Vec3) -> Vec3 {
        Vec3::new(self.x * other.x, self.y * other.y, self.z * other.z)
    }

    /// Each component through `f`.
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

/// Where a thing is and how it is turned: an origin and three unit axes at right angles.
///
/// Turns are given by the tangent of half their angle, which makes sine and cosine rational: no library function whose last
/// bit differs between machines is needed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The point that is the local origin.
    pub origin: Vec3,
    /// The local axes, in world directions.
    pub axes: [Vec3; 3],
}

impl Pose {
    /// At `origin`, with the world's axes.
    pub const fn at(origin: Vec3) -> Pose {
        Pose { origin, axes: [Vec3::X, Vec3::Y, Vec3::Z] }
    }

    /// Turned by `2 atan(half_tangent)` about its own axis 0, 1 or 2: the next axis moves towards the one after it.
    pub fn turned(mut self, axis: usize, half_tangent: f64) -> Pose {
        let square = half_tangent * half_tangent;
        let (cos, sin) = ((1.0 - square) / (1.0 + square), 2.0 * half_tangent / (1.0 + square));
        let [next, last] = [(axis + 1) % 3, (axis + 2) % 3];
        let (a, b) = (self.axes[next], self.axes[last]);
        self.axes[next] = a * cos + b * sin;
        self.axes[last] = b * cos - a * sin;
        self
    }

    /// The direction `world` in local components.
    pub fn local_direction(&self, world: Vec3) -> Vec3 {
        Vec3::new(self.axes[0].dot(world), self.axes[1].dot(world), self.axes[2].dot(world))
    }

    /// The point `world` in local coordinates.
    pub fn local_point(&self, world: Vec3) -> Vec3 {
        self.local_direction(world - self.origin)
    }

    /// The direction with components `local` in the world.
    pub fn world_direction(&self, local: Vec3) -> Vec3 {
        self.axes[0] * local.x + self.axes[1] * local.y + self.axes[2] * local.z
    }
}

/// Half a line: the points `origin + t * direction` for `t > 0`. The direction need not have length 1.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it starts.
    pub origin: Vec3,
    /// Where it goes; the unit of `t`.
    pub direction: Vec3,
}

impl Ray {
    /// The point at `t`.
    pub fn at(&self, t: f64) -> Vec3 {
        self.origin + self.direction * t
    }
}
