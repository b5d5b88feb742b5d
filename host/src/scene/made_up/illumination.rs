//! Random light.

use super::{dice::Dice, viewport::Viewport};
use crate::scene::{description::Lamp, object::Object, ray::Ray, vec3::Vec3};

/// A lamp beside, above or behind the camera, and the ambient light from above and below.
pub fn illumination(dice: &mut Dice, viewport: &Viewport, backdrop: &[Object]) -> (Lamp, [Vec3; 2]) {
    let depth = viewport.depth(dice.between(viewport.far, viewport.near));
    let mut center = Vec3::new(dice.between(-1.5, 1.5), dice.between(-0.5, 1.5), dice.between(-2.5, 0.1)) * depth;
    // A lamp behind a wall lights nothing. The camera sees all walls, so one near it lights them.
    while is_hidden(center, backdrop) {
        center = center * 0.6;
    }
    let target = viewport.point(viewport.half.map(|half| dice.around_zero(half)), depth);
    let towards = (target - center).normalized();
    let u = Vec3::Y.cross(towards).normalized();
    let size = depth * dice.mostly_low(0.02, 0.25);
    let distance = (target - center).length();
    let strength = dice.between(0.5, 1.0) * distance * distance / 1e6;
    // The lamp shines towards `u x v`.
    let lamp = Lamp { center, half_u: u * size, half_v: towards.cross(u) * size, light: tinted(dice, strength) };
    let ambient = dice.mostly_low(0.2, 1.2);
    let sky = tinted(dice, ambient);
    let below = ambient * dice.between(0.3, 0.9);
    (lamp, [sky, tinted(dice, below)])
}

/// Whether the camera could not see a point for the backdrop.
fn is_hidden(point: Vec3, backdrop: &[Object]) -> bool {
    let blocks = |Object { shape, pose, .. }: &Object| {
        let ray = Ray { origin: pose.local_point(Vec3::ZERO), direction: pose.local_direction(point) };
        shape.hit(&ray).is_some_and(|(t, _)| t < 1.1)
    };
    backdrop.iter().any(blocks)
}

fn tinted(dice: &mut Dice, light: f64) -> Vec3 {
    [(); 3].map(|()| light * dice.between(0.85, 1.0)).into()
}
