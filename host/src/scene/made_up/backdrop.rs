//! What fills the image behind everything else.

use super::{coatings::Coatings, dice::Dice, viewport::Viewport};
use crate::scene::{object::Object, pose::Pose, shape::Shape, vec3::Vec3};

/// Wide enough for any image, in millimetres.
const WIDE: f64 = 1e6;

/// How much wider than the centre the views see, together.
const MARGIN: f64 = 1.3;

/// A wall, of which every ray meets one, and perhaps more surfaces before it.
pub fn backdrop(dice: &mut Dice, viewport: &Viewport, coatings: &Coatings) -> Vec<Object> {
    let mut objects = vec![wall(dice, viewport, coatings)];
    match dice.count(0, 9) {
        0..=2 => objects.push(floor(dice, viewport, coatings)),
        3 => {
            objects.push(floor(dice, viewport, coatings));
            objects.push(side_wall(dice, viewport, coatings));
        }
        4 => objects.push(side_wall(dice, viewport, coatings)),
        5 => objects.push(niche(dice, viewport, coatings)),
        6 => objects.push(bulge(dice, viewport, coatings)),
        _ => {}
    }
    objects
}

/// A plane whose least disparity in the image is `far`.
fn wall(dice: &mut Dice, viewport: &Viewport, coatings: &Coatings) -> Object {
    let [x, y] = viewport.half;
    // From one edge of the image to the other.
    let most = (3.0 * viewport.far).min(0.8 * (viewport.near - viewport.far));
    let changes = [dice.around_zero(most), dice.around_zero(most)];
    let slope = [changes[0] / (2.0 * MARGIN * x), changes[1] / (2.0 * MARGIN * y)];
    let disparity = viewport.far + slope[0].abs() * x + slope[1].abs() * y;
    plane(dice, viewport, coatings, [0.0, 0.0], disparity, slope)
}

/// A plane that comes closer towards the bottom.
fn floor(dice: &mut Dice, viewport: &Viewport, coatings: &Coatings) -> Object {
    let edge = viewport.half[1];
    let disparity = dice.between(0.3, 0.95) * viewport.near;
    // Its disparity is 0 at the horizon.
    let horizon = dice.between(-1.0, 0.5) * edge;
    let slope = [dice.around_zero(0.1) * disparity / edge, disparity / (edge - horizon)];
    plane(dice, viewport, coatings, [0.0, edge], disparity, slope)
}

/// A plane that comes closer towards the left or right.
fn side_wall(dice: &mut Dice, viewport: &Viewport, coatings: &Coatings) -> Object {
    let side = dice.pick([-1.0, 1.0]);
    let edge = viewport.half[0];
    let disparity = dice.between(0.3, 0.95) * viewport.near;
    let vanishing = dice.between(-0.6, 0.6) * edge;
    plane(dice, viewport, coatings, [side * edge, 0.0], disparity, [side * disparity / (edge - vanishing), 0.0])
}

fn plane(dice: &mut Dice, viewport: &Viewport, coatings: &Coatings, place: [f64; 2], disparity: f64, slope: [f64; 2]) -> Object {
    let pose = viewport.plane(place, disparity, slope);
    // Textures become finer towards what is far: in the middle, they are as fine as those of other objects.
    let footprint = viewport.footprint(viewport.depth((disparity * viewport.far).sqrt()));
    coatings.backdrop(dice, true).object(Shape::Panel { half_width: WIDE, half_height: WIDE }, pose, footprint)
}

/// The inside of an upright or lying cylinder, or of a sphere.
fn niche(dice: &mut Dice, viewport: &Viewport, coatings: &Coatings) -> Object {
    let depth = viewport.depth(viewport.far * dice.between(1.1, 1.5));
    // The camera is inside.
    let radius = depth * dice.between(0.6, 1.2);
    let center = Pose::at(Vec3::new(0.0, 0.0, depth - radius));
    let (shape, pose) = match dice.count(0, 2) {
        0 => (Shape::Sphere { radius: radius.max(0.7 * depth) }, center),
        1 => (Shape::Rod { half_length: 20.0 * depth, radius }, center),
        _ => (Shape::Rod { half_length: 20.0 * depth, radius }, center.turned(2, 1.0)),
    };
    coatings.backdrop(dice, false).object(shape, pose, viewport.footprint(depth))
}

/// A large ball or cylinder that curves towards the camera.
fn bulge(dice: &mut Dice, viewport: &Viewport, coatings: &Coatings) -> Object {
    let depth = viewport.depth(dice.between(1.2 * viewport.far, 0.7 * viewport.near));
    let radius = depth * dice.between(0.3, 2.0);
    let [x, y] = viewport.half.map(|half| dice.around_zero(half));
    let pose = Pose::at(viewport.point([x, y], depth + radius));
    let shape = match dice.happens(0.5) {
        true => Shape::Sphere { radius },
        false => Shape::Rod { half_length: 20.0 * depth, radius },
    };
    coatings.backdrop(dice, false).object(shape, pose.turned(2, dice.between(-1.0, 1.0)), viewport.footprint(depth))
}
