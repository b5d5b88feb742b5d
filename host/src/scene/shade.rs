//! The light that comes back along a ray.

use super::{
    Finish, Object, Scene, Shape,
    noise::{even_square, value_flat},
    texture::brush,
    trace::{Hit, Tracer},
    vector::{Ray, Vec3},
};

/// Points of the lamp that a surface looks for.
const FEW_LAMP_POINTS: u32 = 4;

/// Points of the lamp that it looks for where it sees some and others not.
const LAMP_POINTS: u32 = 16;

/// How bright the lamp is where it is mirrored: brighter is white anyway, but would make edges of highlights hard.
const LAMP_IN_MIRRORS: f64 = 5.0;

/// The light that falls on a point of a surface.
#[derive(Clone, Copy)]
pub(super) struct Illumination {
    /// On a surface that scatters it to all sides.
    diffuse: Vec3,
    /// The lamp's soft mirror image.
    highlight: Vec3,
}

impl Tracer<'_> {
    /// The colour of the surface that `ray` meets at `hit`, lit by `light`. `sample` numbers the rays of a pixel.
    pub fn shade(&self, ray: &Ray, hit: &Hit, light: &Illumination, sample: u32) -> Vec3 {
        let object = hit.object;
        let (point, view) = (ray.at(hit.t), ray.direction.normalized());
        let local = object.pose.local_point(point);
        let diffuse = object.texture.color(local).filter(light.diffuse);
        let facing = -view.dot(hit.normal);
        let (share, normal) = match object.finish {
            Finish::Matte => return diffuse,
            Finish::Satin => return diffuse + light.highlight * 0.25,
            Finish::Glazed => (fresnel(0.045, facing), hit.normal),
            Finish::Brushed => (0.42 * fresnel(0.75, facing), brushed_normal(object, local, hit.normal, sample)),
        };
        let scattered = diffuse * (1.0 - share);
        let weight = match object.finish {
            // Its mirror image is blurred and dear: half of a pixel's rays take it, twice.
            Finish::Brushed if sample & 2 == 0 => return scattered,
            Finish::Brushed => 2.0 * share,
            _ => share,
        };
        scattered + self.mirrored(&Ray { origin: point, direction: view.reflect(normal) }, hit.index) * weight
    }

    /// What object `mirror` shows along a ray from it. It is faint, so shadows and mirrors in it are left out.
    fn mirrored(&self, ray: &Ray, mirror: usize) -> Vec3 {
        let Scene { lamp, .. } = self.scene;
        let Some(hit) = self.nearest(ray, self.all().filter(|&index| index != mirror)) else {
            return if self.sees_lamp(ray) { lamp.light * LAMP_IN_MIRRORS } else { self.surroundings(ray.direction) };
        };
        let point = ray.at(hit.t);
        let direct = lamp.light * self.lamp_strength(hit.normal, lamp.center - point);
        hit.object.texture.color(hit.object.pose.local_point(point)).filter(direct + self.surroundings(hit.normal))
    }

    /// The light of the room from a direction.
    pub fn surroundings(&self, direction: Vec3) -> Vec3 {
        self.scene.ground.lerp(self.scene.sky, 0.5 + 0.5 * direction.y / direction.length())
    }

    /// The light that falls on the point where `ray` meets a surface.
    pub fn illumination(&self, ray: &Ray, hit: &Hit) -> Illumination {
        let Scene { lamp, .. } = self.scene;
        // Off the surface, so that neighbours that touch it do not shade it by rounding.
        let (point, view) = (ray.at(hit.t) + hit.normal * 1e-4, ray.direction.normalized());
        let shaders: Vec<usize> = self.shaders(hit.index, point, hit.normal).collect();
        let blocked = |ray: &Ray| shaders.iter().any(|&index| self.blocks(ray, index));
        let (mut diffuse, mut highlight, mut lit, mut points) = (0.0, 0.0, 0, 0);
        while points < FEW_LAMP_POINTS || (points < LAMP_POINTS && lit != points && lit != 0) {
            let [a, b] = even_square(points).map(|x| 2.0 * x - 1.0);
            points += 1;
            let to = lamp.center + lamp.half_u * a + lamp.half_v * b - point;
            let strength = self.lamp_strength(hit.normal, to);
            if strength > 0.0 && !blocked(&Ray { origin: point, direction: to }) {
                lit += 1;
                diffuse += strength;
                highlight += strength * shine(hit.normal.dot((to.normalized() - view).normalized()));
            }
        }
        let lamp = lamp.light * (1.0 / f64::from(points));
        let others = self.scene.objects.iter().enumerate().filter(|&(index, _)| index != hit.index);
        let open = others.map(|(_, object)| openness(object, point, hit.normal)).product::<f64>();
        Illumination { diffuse: lamp * diffuse + self.surroundings(hit.normal) * open, highlight: lamp * highlight }
    }

    /// What a point of the lamp, `to` away, gives to a surface; 0 where one is behind the other.
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

/// The share of the room's light that a ball lets through to a surface. Other shapes keep off none.
fn openness(object: &Object, point: Vec3, normal: Vec3) -> f64 {
    let Shape::Sphere { radius } = object.shape else { return 1.0 };
    let to = object.pose.origin - point;
    let (rise, squared) = (normal.dot(to), to.dot(to));
    if rise <= 0.0 { 1.0 } else { (1.0 - rise * radius * radius / (squared * squared.sqrt())).max(0.0) }
}

/// Schlick's share of mirrored light, from `head_on` at a right angle to 1 at a grazing one.
fn fresnel(head_on: f64, facing: f64) -> f64 {
    let x = (1.0 - facing).clamp(0.0, 1.0);
    head_on + (1.0 - head_on) * (x * x) * (x * x) * x
}

/// The 32nd power: a soft highlight.
fn shine(cosine: f64) -> f64 {
    (0..5).fold(cosine.max(0.0), |x, _| x * x)
}

/// The normal of the groove a ray falls into. Grooves spread reflections along `y` of their panel: most of what the camera sees
/// of a table is spread towards and away from it.
fn brushed_normal(object: &Object, local: Vec3, normal: Vec3, sample: u32) -> Vec3 {
    let [a, b] = even_square(sample).map(|x| x - 0.5);
    let [along, across] = brush(local);
    let groove = value_flat(along / 14.0, across / 1.4, 5) - 0.5;
    (normal + object.pose.axes[1] * (0.04 * groove + 0.07 * a) + object.pose.axes[0] * (0.015 * b)).normalized()
}
