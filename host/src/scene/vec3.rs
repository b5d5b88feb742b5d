//! Vectors: points, directions and colours.

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
    pub const X: Vec3 = Vec3::new(1.0, 0.0, 0.0);
    /// The unit vector along the second axis.
    pub const Y: Vec3 = Vec3::new(0.0, 1.0, 0.0);
    /// The unit vector along the third axis.
    pub const Z: Vec3 = Vec3::new(0.0, 0.0, 1.0);

    /// The vector with these components.
    pub const fn new(x: f64, y: f64, z: f64) -> Vec3 {
        Vec3 { x, y, z }
    }

    /// The vector with three equal components.
    pub const fn splat(value: f64) -> Vec3 {
        Vec3::new(value, value, value)
    }

    /// The linear colour that a display with a gamma of 2 shows for `0xRRGGBB`.
    pub const fn srgb(hex: u32) -> Vec3 {
        const fn linear(byte: u32) -> f64 {
            let value = (byte & 0xFF) as f64 / 255.0;
            value * value
        }
        Vec3::new(linear(hex >> 16), linear(hex >> 8), linear(hex))
    }

    /// The dot product.
    pub fn dot(self, other: Vec3) -> f64 {
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
    pub fn normalized(self) -> Vec3 {
        self * (1.0 / self.length())
    }

    /// The direction after reflection at a surface with the unit normal `normal`.
    pub fn reflect(self, normal: Vec3) -> Vec3 {
        self - normal * (2.0 * self.dot(normal))
    }

    /// Linear interpolation from `self` (`share` 0) to `other` (`share` 1).
    pub fn lerp(self, other: Vec3, share: f64) -> Vec3 {
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
