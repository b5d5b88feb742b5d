//! The shapes of objects, and where rays meet them.

use super::vec3::{Ray, Vec3};

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
