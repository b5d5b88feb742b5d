//! Finding the object that a ray meets.

use super::rays::Quality;
use crate::scene::{
    description::{Finish, Object, Scene},
    even_square,
    geometry::{Ray, Shape, Vec3},
    texture::patterns::{along_and_across_strokes, value_flat},
};

/// A bounding sphere.
#[derive(Clone, Copy)]
struct Bound {
    center: Vec3,
    radius: f64,
}

/// The place where a ray meets an object.
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
    /// Returns true if both hits are on the same smooth surface.
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

    /// Returns true if the object lies between the ray's origin and the point at `t = 1`.
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

/// The brightness of the lamp's mirror image. More would be white as well, but would give highlights hard
/// edges.
const LAMP_IN_MIRRORS: f64 = 5.0;

/// The light that falls on a point of a surface.
#[derive(Clone, Copy)]
pub struct Illumination {
    /// The light that a matte surface scatters.
    diffuse: Vec3,
    /// The soft highlight of the lamp.
    highlight: Vec3,
}

impl Tracer<'_> {
    /// The colour of the surface that `ray` meets at `hit`, lit by `light`. `sample` numbers the rays of a
    /// pixel.
    pub fn shade(&self, ray: &Ray, hit: &Hit, light: &Illumination, sample: u32) -> Vec3 {
        let object = hit.object;
        let (point, view) = (ray.at(hit.t), ray.direction.normalized());
        let place = object.texture_point(point);
        let diffuse = object.texture.color(place).filter(light.diffuse);
        let facing = -view.dot(hit.normal);
        let (share, normal) = match object.finish {
            Finish::Matte => return diffuse,
            Finish::Satin => return diffuse + light.highlight * 0.25,
            Finish::Glazed => (fresnel(0.045, facing), hit.normal),
            Finish::Polished => (fresnel(0.35, facing), hit.normal),
            Finish::Brushed => (0.42 * fresnel(0.75, facing), brushed_normal(object, place, hit.normal, sample)),
        };
        let scattered = diffuse * (1.0 - share);
        let weight = match object.finish {
            Finish::Brushed if !self.quality.traces_blurred_reflection(sample) => return scattered,
            Finish::Brushed => 2.0 * share,
            _ => share,
        };
        scattered + self.mirrored(&Ray { origin: point, direction: view.reflect(normal) }, hit.index) * weight
    }

    /// The reflection that object `mirror` shows along a ray from it. It is faint, so it has no shadows or
    /// reflections of its own.
    fn mirrored(&self, ray: &Ray, mirror: usize) -> Vec3 {
        let Scene { lamp, .. } = self.scene;
        let Some(hit) = self.nearest(ray, self.all().filter(|&index| index != mirror)) else {
            return if self.sees_lamp(ray) { lamp.light * LAMP_IN_MIRRORS } else { self.ambient(ray.direction) };
        };
        let point = ray.at(hit.t);
        let direct = lamp.light * self.lamp_strength(hit.normal, lamp.center - point);
        hit.object.texture.color(hit.object.texture_point(point)).filter(direct + self.ambient(hit.normal))
    }

    /// The ambient light from a direction.
    pub fn ambient(&self, direction: Vec3) -> Vec3 {
        self.scene.ground.lerp(self.scene.sky, 0.5 + 0.5 * direction.y / direction.length())
    }

    /// The light that falls on the point where `ray` meets a surface.
    pub fn illumination(&self, ray: &Ray, hit: &Hit) -> Illumination {
        let Scene { lamp, .. } = self.scene;
        // Slightly off the surface, so that rounding does not let touching objects cast shadows on it.
        let (point, view) = (ray.at(hit.t) + hit.normal * 1e-4, ray.direction.normalized());
        let occluders: Vec<usize> = self.occluders(hit.index, point, hit.normal).collect();
        let blocked = |ray: &Ray| occluders.iter().any(|&index| self.blocks(ray, index));
        let (mut diffuse, mut highlight, mut lit, mut points) = (0.0, 0.0, 0, 0);
        let [few, many] = self.quality.lamp_points();
        while points < few || (points < many && lit != points && lit != 0) {
            let [a, b] = even_square(points).map(|x| 2.0 * x - 1.0);
            points += 1;
            let to = lamp.center + lamp.half_u * a + lamp.half_v * b - point;
            let strength = self.lamp_strength(hit.normal, to);
            if strength > 0.0 && !blocked(&Ray { origin: point, direction: to }) {
                lit += 1;
                diffuse += strength;
                highlight += strength * highlight_profile(hit.normal.dot((to.normalized() - view).normalized()));
            }
        }
        let lamp = lamp.light * (1.0 / f64::from(points));
        let others = self.scene.objects.iter().enumerate().filter(|&(index, _)| index != hit.index);
        let open = others.map(|(_, object)| openness(object, point, hit.normal)).product::<f64>();
        Illumination { diffuse: lamp * diffuse + self.ambient(hit.normal) * open, highlight: lamp * highlight }
    }

    /// The light that a surface gets from the lamp's point at offset `to`, or 0 if either faces away.
    fn lamp_strength(&self, normal: Vec3, to: Vec3) -> f64 {
        let (squared, rise, away) = (to.dot(to), normal.dot(to), -self.lamp_normal.dot(to));
        rise.max(0.0) * away.max(0.0) * 1e6 / (squared * squared)
    }

    fn sees_lamp(&self, ray: &Ray) -> bool {
        let lamp = &self.scene.lamp;
        let t = self.lamp_normal.dot(lamp.center - ray.origin) / self.lamp_normal.dot(ray.direction);
        let from_center = ray.at(t) - lamp.center;
        let within = |half: Vec3| from_center.dot(half).abs() <= half.dot(half);
        t > 0.0 && within(lamp.half_u) && within(lamp.half_v)
    }
}

/// The share of the ambient light that a sphere leaves to a nearby surface. Other shapes are assumed to block
/// none.
fn openness(object: &Object, point: Vec3, normal: Vec3) -> f64 {
    let Shape::Sphere { radius } = object.shape else { return 1.0 };
    let to = object.pose.origin - point;
    let (rise, squared) = (normal.dot(to), to.dot(to));
    if rise <= 0.0 { 1.0 } else { (1.0 - rise * radius * radius / (squared * squared.sqrt())).max(0.0) }
}

/// Schlick's approximation of the share of reflected light, from `head_on` at normal incidence to 1 at
/// grazing incidence.
fn fresnel(head_on: f64, facing: f64) -> f64 {
    let x = (1.0 - facing).clamp(0.0, 1.0);
    head_on + (1.0 - head_on) * (x * x) * (x * x) * x
}

/// The profile of a soft highlight: the 32nd power of the cosine.
fn highlight_profile(cosine: f64) -> f64 {
    (0..5).fold(cosine.max(0.0), |x, _| x * x)
}

/// The normal of the groove that a ray hits at a point of the texture. Grooves blur reflections mainly along the panel's `y`
/// axis.
fn brushed_normal(object: &Object, place: Vec3, normal: Vec3, sample: u32) -> Vec3 {
    let [a, b] = even_square(sample).map(|x| x - 0.5);
    let [along, across] = along_and_across_strokes(place);
    let groove = value_flat(along / 14.0, across / 1.4, 5) - 0.5;
    (normal + object.pose.axes[1] * (0.04 * groove + 0.07 * a) + object.pose.axes[0] * (0.015 * b)).normalized()
}
