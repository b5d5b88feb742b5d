//! Shading: the light that returns along a ray.

use super::tracer::{Hit, Tracer};
use crate::scene::{
    description::Scene,
    object::{Finish, Object},
    random::even_square,
    ray::Ray,
    shape::Shape,
    texture::{noise::value_flat, patterns::along_and_across_strokes},
    vec3::Vec3,
};

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
