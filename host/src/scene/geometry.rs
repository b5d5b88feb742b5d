//! Vectors, rays and poses in space, the shapes of objects, and where rays meet them.

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

/// The shortest distance at which a ray can meet a surface, in units of its direction. It keeps a ray from
/// meeting the surface it starts on.
const START: f64 = 1e-9;

/// A convex shape around the origin. Lengths are in millimetres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A sphere.
    Sphere {
        /// The radius.
        radius: f64,
    },
    /// A rectangle at `z = 0`, visible from both sides. Infinite sizes make it a plane.
    Panel {
        /// Half the size along `x`.
        half_width: f64,
        /// Half the size along `y`.
        half_height: f64,
    },
    /// A box.
    Block {
        /// Half the size along each axis.
        half: Vec3,
    },
    /// A cylinder along `y` with a hemisphere at each end.
    Rod {
        /// Half the length of the cylinder.
        half_length: f64,
        /// The radius of the cylinder and the hemispheres.
        radius: f64,
    },
}

impl Shape {
    /// The radius of the bounding sphere around the origin.
    pub(crate) fn bounding_radius(&self) -> f64 {
        match *self {
            Shape::Sphere { radius } => radius,
            Shape::Panel { half_width, half_height } => (half_width * half_width + half_height * half_height).sqrt(),
            Shape::Block { half } => half.length(),
            Shape::Rod { half_length, radius } => half_length + radius,
        }
    }

    /// The distance at which the ray first meets the surface, in units of its direction, and the outward unit
    /// normal there.
    pub(crate) fn hit(&self, ray: &Ray) -> Option<(f64, Vec3)> {
        match *self {
            Shape::Sphere { radius } => {
                let t = sphere(ray, Vec3::ZERO, radius)?;
                Some((t, ray.at(t) * (1.0 / radius)))
            }
            Shape::Panel { half_width, half_height } => {
                let t = -ray.origin.z / ray.direction.z;
                let p = ray.at(t);
                let inside = t > START && p.x.abs() <= half_width && p.y.abs() <= half_height;
                inside.then_some((t, Vec3::Z))
            }
            Shape::Block { half } => block(ray, half),
            Shape::Rod { half_length, radius } => rod(ray, half_length, radius),
        }
    }
}

/// The distance at which the ray first meets the sphere, from outside or inside.
fn sphere(ray: &Ray, center: Vec3, radius: f64) -> Option<f64> {
    let from = ray.origin - center;
    let (a, b, c) = (ray.direction.dot(ray.direction), from.dot(ray.direction), from.dot(from) - radius * radius);
    first_root(a, b, c)
}

/// The smallest root of `a t^2 + 2 b t + c` above [`START`].
fn first_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 {
        return None;
    }
    let root = discriminant.sqrt();
    [(-b - root) / a, (-b + root) / a].into_iter().find(|&t| t > START)
}

fn block(ray: &Ray, half: Vec3) -> Option<(f64, Vec3)> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut entry, mut exit) = (Vec3::ZERO, Vec3::ZERO);
    let sides = [
        (ray.origin.x, ray.direction.x, half.x, Vec3::X),
        (ray.origin.y, ray.direction.y, half.y, Vec3::Y),
        (ray.origin.z, ray.direction.z, half.z, Vec3::Z),
    ];
    for (origin, direction, half, axis) in sides {
        let outward = axis * if direction > 0.0 { 1.0 } else { -1.0 };
        let near = (-half * direction.signum() - origin) / direction;
        let far = (half * direction.signum() - origin) / direction;
        if near > enter {
            (enter, entry) = (near, -outward);
        }
        if far < leave {
            (leave, exit) = (far, outward);
        }
    }
    if enter > leave {
        None
    } else if enter > START {
        Some((enter, entry))
    } else if leave > START {
        Some((leave, exit))
    } else {
        None
    }
}

fn rod(ray: &Ray, half_length: f64, radius: f64) -> Option<(f64, Vec3)> {
    let (o, d) = (ray.origin, ray.direction);
    let side = first_root(d.x * d.x + d.z * d.z, o.x * d.x + o.z * d.z, o.x * o.x + o.z * o.z - radius * radius)
        .filter(|&t| ray.at(t).y.abs() <= half_length);
    let end = |y: f64| sphere(ray, Vec3::new(0.0, y, 0.0), radius).filter(|&t| ray.at(t).y.abs() > half_length);
    let t = [side, end(half_length), end(-half_length)].into_iter().flatten().min_by(f64::total_cmp)?;
    let p = ray.at(t);
    let axis = Vec3::new(0.0, p.y.clamp(-half_length, half_length), 0.0);
    Some((t, (p - axis) * (1.0 / radius)))
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

    fn towards_z(x: f64, y: f64) -> Ray {
        Ray { origin: Vec3::new(x, y, -10.0), direction: Vec3::Z }
    }

    #[test]
    fn rays_meet_shapes_where_they_are() {
        let cases = [
            (Shape::Sphere { radius: 5.0 }, 3.0, 0.0, Some((6.0, Vec3::new(0.6, 0.0, -0.8)))),
            (Shape::Sphere { radius: 5.0 }, 3.0, 4.1, None),
            (Shape::Panel { half_width: 2.0, half_height: 1.0 }, 1.9, -0.9, Some((10.0, Vec3::Z))),
            (Shape::Panel { half_width: 2.0, half_height: 1.0 }, 1.9, 1.1, None),
            (Shape::Block { half: Vec3::new(1.0, 2.0, 3.0) }, 0.9, 1.9, Some((7.0, -Vec3::Z))),
            (Shape::Block { half: Vec3::new(1.0, 2.0, 3.0) }, 1.1, 0.0, None),
            (Shape::Rod { half_length: 4.0, radius: 5.0 }, 3.0, 3.9, Some((6.0, Vec3::new(0.6, 0.0, -0.8)))),
            (Shape::Rod { half_length: 4.0, radius: 5.0 }, 0.0, 7.0, Some((6.0, Vec3::new(0.0, 0.6, -0.8)))),
            (Shape::Rod { half_length: 4.0, radius: 5.0 }, 3.0, 8.1, None),
        ];
        for (shape, x, y, expected) in cases {
            let hit = shape.hit(&towards_z(x, y));
            assert_eq!(hit.is_some(), expected.is_some(), "{shape:?} at {x}, {y}");
            if let (Some((t, normal)), Some((expected_t, expected_normal))) = (hit, expected) {
                assert!((t - expected_t).abs() < 1e-12, "{shape:?} at {x}, {y}: {t}");
                assert!((normal - expected_normal).length() < 1e-12, "{shape:?} at {x}, {y}: {normal:?}");
            }
        }
    }

    #[test]
    fn a_ray_from_inside_meets_the_far_side() {
        let ray = Ray { origin: Vec3::ZERO, direction: Vec3::Z };
        let block = Shape::Block { half: Vec3::splat(2.0) };
        assert_eq!(block.hit(&ray), Some((2.0, Vec3::Z)));
        assert_eq!(Shape::Sphere { radius: 2.0 }.hit(&ray), Some((2.0, Vec3::Z)));
    }
}
