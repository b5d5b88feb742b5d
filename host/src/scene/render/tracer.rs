//! Finding the object that a ray meets.

use super::quality::Quality;
use crate::scene::{description::Scene, object::Object, ray::Ray, vec3::Vec3};

/// A bounding sphere.
#[derive(Clone, Copy)]
struct Bound {
    center: Vec3,
    radius: f64,
}

/// Where a ray meets an object.
#[derive(Clone, Copy)]
pub struct Hit<'a> {
    /// The object that was hit.
    pub object: &'a Object,
    /// The object's index in the scene.
    pub index: usize,
    /// The distance along the ray, in units of its direction.
    pub t: f64,
    /// Unit normal on the side that the ray comes from.
    pub normal: Vec3,
}

impl Hit<'_> {
    /// Whether both hits are on the same smooth surface.
    pub fn is_same_surface(&self, other: &Hit) -> bool {
        self.index == other.index && self.normal.dot(other.normal) > 0.97
    }
}

/// A scene prepared for ray queries.
pub struct Tracer<'a> {
    pub scene: &'a Scene,
    pub quality: Quality,
    bounds: Vec<Bound>,
    /// The lamp's unit normal, on the side to which it shines.
    pub lamp_normal: Vec3,
    lamp_radius: f64,
}

impl<'a> Tracer<'a> {
    pub fn new(scene: &'a Scene, quality: Quality) -> Tracer<'a> {
        let lamp = &scene.lamp;
        Tracer {
            scene,
            quality,
            bounds: scene
                .objects
                .iter()
                .map(|object| Bound { center: object.pose.origin, radius: object.shape.bounding_radius() })
                .collect(),
            lamp_normal: lamp.half_u.cross(lamp.half_v).normalized(),
            lamp_radius: (lamp.half_u.dot(lamp.half_u) + lamp.half_v.dot(lamp.half_v)).sqrt(),
        }
    }

    /// The indices of all objects.
    pub fn all(&self) -> impl Iterator<Item = usize> + use<> {
        0..self.bounds.len()
    }

    /// The objects that a cone of rays may meet. The rays start at `axis.origin`, and at `t = 1` they are
    /// within `spread` of the axis.
    pub fn in_cone(&self, axis: Ray, spread: f64) -> impl Iterator<Item = usize> {
        let inverse = 1.0 / axis.direction.dot(axis.direction);
        self.all().filter(move |&index| {
            let Bound { center, radius } = self.bounds[index];
            let to = center - axis.origin;
            let t = (to.dot(axis.direction) * inverse).max(0.0);
            // The factor allows for the slope of the cone's side, which is small for a narrow cone.
            let reach = 1.1 * (radius + t * spread);
            let aside = to - axis.direction * t;
            aside.dot(aside) <= reach * reach
        })
    }

    /// The objects that may cast a shadow on a point of object `index`. This leaves out the object itself, as
    /// all shapes are convex, objects entirely behind the surface, and objects outside the cone towards the
    /// lamp.
    pub fn occluders(&self, index: usize, point: Vec3, normal: Vec3) -> impl Iterator<Item = usize> {
        let axis = Ray { origin: point, direction: self.scene.lamp.center - point };
        self.in_cone(axis, self.lamp_radius).filter(move |&other| {
            let Bound { center, radius } = self.bounds[other];
            other != index && normal.dot(center - point) > -radius
        })
    }

    /// The nearest of `objects` that a ray meets.
    pub fn nearest(&self, ray: &Ray, objects: impl IntoIterator<Item = usize>) -> Option<Hit<'a>> {
        let (mut nearest, mut limit) = (None, f64::INFINITY);
        for index in objects {
            if let Some((t, normal)) = self.hit(ray, index)
                && t < limit
            {
                limit = t;
                nearest = Some((index, normal));
            }
        }
        nearest.map(|(index, normal)| {
            let object = &self.scene.objects[index];
            let normal = object.pose.world_direction(normal);
            let normal = if normal.dot(ray.direction) > 0.0 { -normal } else { normal };
            Hit { object, index, t: limit, normal }
        })
    }

    /// Whether the object lies between the ray's origin and the point at `t = 1`.
    pub fn blocks(&self, ray: &Ray, index: usize) -> bool {
        self.hit(ray, index).is_some_and(|(t, _)| t < 1.0)
    }

    /// The distance at which the ray meets the object, and the outward normal there in the object's
    /// coordinates.
    fn hit(&self, ray: &Ray, index: usize) -> Option<(f64, Vec3)> {
        let Bound { center, radius } = self.bounds[index];
        let to = center - ray.origin;
        let (along, outside) = (to.dot(ray.direction), to.dot(to) - radius * radius);
        if outside > 0.0 && (along < 0.0 || outside * ray.direction.dot(ray.direction) > along * along) {
            return None;
        }
        let object = &self.scene.objects[index];
        let local = Ray { origin: -object.pose.local_direction(to), direction: object.pose.local_direction(ray.direction) };
        object.shape.hit(&local)
    }
}
