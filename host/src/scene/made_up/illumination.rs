//! Random light.

use super::{dice::Dice, viewport::Viewport};
use crate::scene::{description::Lamp, vec3::Vec3};

/// A lamp beside or above the camera, and the ambient light from above and below.
pub fn illumination(dice: &mut Dice, viewport: &Viewport) -> (Lamp, [Vec3; 2]) {
    let depth = viewport.depth(dice.between(viewport.far, viewport.near));
    // The camera sees all surfaces, so a lamp near it lights them.
    let aside = [dice.between(-0.8, 0.8), dice.between(-0.3, 0.9), dice.between(-1.0, 0.2)];
    let center = Vec3::from(aside) * depth;
    let target = viewport.point(viewport.half.map(|half| dice.around_zero(half)), depth);
    let towards = (target - center).normalized();
    let u = Vec3::Y.cross(towards).normalized();
    let size = depth * dice.mostly_low(0.02, 0.25);
    let distance = (target - center).length();
    let strength = dice.between(0.5, 1.0) * distance * distance / 1e6;
    // The lamp shines towards `u x v`.
    let lamp = Lamp { center, half_u: u * size, half_v: towards.cross(u) * size, light: tinted(dice, strength) };
    let ambient = dice.mostly_low(0.15, 1.0);
    let sky = tinted(dice, ambient);
    let below = ambient * dice.between(0.3, 0.9);
    (lamp, [sky, tinted(dice, below)])
}

fn tinted(dice: &mut Dice, light: f64) -> Vec3 {
    [(); 3].map(|()| light * dice.between(0.85, 1.0)).into()
}
