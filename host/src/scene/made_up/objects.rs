//! The objects of a made-up scene: the backdrop, which fills the image behind everything else, and those before it.

use super::{
    coatings::{Coating, Coatings, ObjectKind},
    flaws::Dice,
};
use crate::scene::{
    description::{Lamp, Object},
    geometry::{Pose, Ray, Shape, Vec3},
};

/// The width of an image in nominal pixels.
pub const NOMINAL_WIDTH: f64 = 256.0;

/// Wide enough for any image, in millimetres.
const WIDE: f64 = 1e6;

/// The width that all views see together, in widths of what the centre sees.
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

/// Returns true if the backdrop hides a point from the camera.
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

/// The centre camera in nominal pixels. Places are given from the image's middle, to the right and down.
#[derive(Clone, Copy, Debug)]
pub struct Viewport {
    /// The focal length.
    pub focal: f64,
    /// From the middle of the image to its right and bottom edge.
    pub half: [f64; 2],
    /// The distance between cameras in millimetres.
    pub baseline_mm: f64,
    /// The disparity of what is farthest in the image, and of what is nearest.
    pub far: f64,
    pub near: f64,
}

impl Viewport {
    /// A camera that sees images of a size: its height follows from [`NOMINAL_WIDTH`].
    pub fn half_of([width, height]: [u32; 2]) -> [f64; 2] {
        let half = NOMINAL_WIDTH / 2.0;
        [half, half * f64::from(height) / f64::from(width)]
    }

    /// The camera: at the origin, level. The image's v axis points down, the world's y axis up.
    pub fn pose() -> Pose {
        Pose { origin: Vec3::ZERO, axes: [Vec3::X, -Vec3::Y, Vec3::Z] }
    }

    /// The depth of a disparity in millimetres.
    pub fn depth(&self, disparity: f64) -> f64 {
        self.focal * self.baseline_mm / disparity
    }

    /// The millimetres that a pixel shows at a depth.
    pub fn footprint(&self, depth: f64) -> f64 {
        depth / self.focal
    }

    /// The point that is seen at a place at a depth.
    pub fn point(&self, [x, y]: [f64; 2], depth: f64) -> Vec3 {
        let footprint = self.footprint(depth);
        Vec3::new(x * footprint, -y * footprint, depth)
    }

    /// The pose of the plane with this disparity at a place, which grows by `slope` with each pixel to the right and down. Its
    /// z axis is the plane's normal, and its x axis lies in the image plane.
    pub fn plane(&self, [x, y]: [f64; 2], disparity: f64, slope: [f64; 2]) -> Pose {
        // On the plane `normal . p = 1`, the disparity at (u, v) is proportional to `normal . (u / focal, v / focal, 1)`.
        let middle = disparity - slope[0] * x - slope[1] * y;
        let normal = Vec3::new(slope[0] * self.focal, -slope[1] * self.focal, middle).normalized();
        let right = Vec3::Y.cross(normal).normalized();
        Pose { origin: self.point([x, y], self.depth(disparity)), axes: [right, normal.cross(right), normal] }
    }

    /// `slope` made flatter, if a plane would otherwise leave the range of disparities within `reach` pixels of where it has
    /// `disparity`.
    pub fn limited(&self, slope: [f64; 2], disparity: f64, [x, y]: [f64; 2]) -> [f64; 2] {
        let change = slope[0].abs() * x + slope[1].abs() * y;
        let most = (self.near - disparity).min(0.6 * disparity).max(0.0);
        if change > most { slope.map(|slope| slope * most / change) } else { slope }
    }
}

/// Groups of objects at random places: of each of these kinds in turn, or of any kind if there are none.
pub fn foreground(dice: &mut Dice, viewport: &Viewport, coatings: &Coatings, kinds: &[ObjectKind]) -> Vec<Object> {
    let (mut objects, mut kinds) = (Vec::new(), kinds.iter().cycle());
    for _ in 0..dice.count(4, 16) {
        let kind = kinds.next();
        let of_kind = kind.map(|kind| coatings.of_kind(*kind));
        let mut group = Group::new(dice, viewport, of_kind.as_ref().unwrap_or(coatings));
        match kind {
            Some(ObjectKind::Thin) => group.twigs(),
            Some(ObjectKind::Repeating) => group.board(),
            Some(ObjectKind::Shiny) => group.shape(6, 14),
            Some(ObjectKind::Blank) => group.shape(0, 14),
            Some(ObjectKind::Slits) => group.slits(),
            None => group.shape(0, 19),
        }
        objects.append(&mut group.objects);
    }
    objects
}

/// Objects that are beside each other.
struct Group<'a> {
    dice: &'a mut Dice,
    viewport: &'a Viewport,
    coatings: &'a Coatings,
    /// The place of its middle in the image, and its disparity.
    place: [f64; 2],
    disparity: f64,
    objects: Vec<Object>,
}

impl<'a> Group<'a> {
    fn new(dice: &'a mut Dice, viewport: &'a Viewport, coatings: &'a Coatings) -> Group<'a> {
        let place = viewport.half.map(|half| dice.between(-1.1, 1.1) * half);
        let disparity = dice.between(viewport.far + 0.5, viewport.near);
        Group { dice, viewport, coatings, place, disparity, objects: Vec::new() }
    }

    /// Shapes by their number of twenty.
    fn shape(&mut self, first: u32, last: u32) {
        match self.dice.count(first, last) {
            0..=5 => self.panel(),
            6..=9 => self.block(),
            10..=12 => self.ball(),
            13 | 14 => self.column(),
            15 | 16 => self.twigs(),
            17 => self.fence(),
            18 => self.leaves(),
            _ => self.frame(),
        }
    }

    /// An upright board that faces the camera.
    fn board(&mut self) {
        let half = [0; 2].map(|_| self.dice.between(25.0, 90.0));
        let coating = self.coatings.next(self.dice, true);
        let footprint = self.viewport.footprint(self.viewport.depth(self.disparity));
        let shape = Shape::Panel { half_width: half[0] * footprint, half_height: half[1] * footprint };
        self.objects.push(coating.object(shape, self.viewport.plane(self.place, self.disparity, [0.0; 2]), footprint));
    }

    /// A board at any angle.
    fn panel(&mut self) {
        let half = [0; 2].map(|_| self.dice.mostly_low(5.0, 90.0));
        let coating = self.coatings.next(self.dice, true);
        let steepness = self.dice.pick([0.0, 0.0, 0.03, 0.15]);
        self.add_panel(self.place, half, steepness, &coating);
    }

    fn add_panel(&mut self, place: [f64; 2], [half_width, half_height]: [f64; 2], steepness: f64, coating: &Coating) {
        let slope = [0; 2].map(|_| self.dice.around_zero(steepness));
        let reach = (half_width * half_width + half_height * half_height).sqrt();
        let pose = self.viewport.plane(place, self.disparity, self.viewport.limited(slope, self.disparity, [reach; 2]));
        let footprint = self.viewport.footprint(self.viewport.depth(self.disparity));
        let shape = Shape::Panel { half_width: half_width * footprint, half_height: half_height * footprint };
        let tilt = if self.dice.happens(0.5) { 0.0 } else { self.dice.between(-1.0, 1.0) };
        self.objects.push(coating.object(shape, pose.turned(2, tilt), footprint));
    }

    /// A box.
    fn block(&mut self) {
        let half = [0; 3].map(|_| self.dice.mostly_low(5.0, 50.0));
        let upright = self.dice.happens(0.4);
        let pose = Pose::at(Vec3::ZERO);
        let pose = if upright { pose.turned(1, self.dice.between(-1.0, 1.0)) } else { self.dice.turned(pose) };
        let coating = self.coatings.next(self.dice, false);
        self.add_solid(pose, &coating, |pixel| Shape::Block { half: Vec3::from(half) * pixel });
    }

    fn ball(&mut self) {
        let (radius, pose) = (self.dice.mostly_low(5.0, 60.0), Pose::at(Vec3::ZERO));
        let coating = self.coatings.next(self.dice, false);
        self.add_solid(pose, &coating, |pixel| Shape::Sphere { radius: radius * pixel });
    }

    /// A thick rod.
    fn column(&mut self) {
        let (radius, half_length) = (self.dice.mostly_low(3.0, 36.0), self.dice.between(8.0, 90.0));
        let pose = self.in_image(0.3);
        let coating = self.coatings.next(self.dice, false);
        self.add_solid(pose, &coating, |pixel| Shape::Rod { half_length: half_length * pixel, radius: radius * pixel });
    }

    /// An orientation whose y axis is turned by any angle in the image, and out of it by a tangent of at most about twice
    /// `lean`.
    fn in_image(&mut self, lean: f64) -> Pose {
        Pose::at(Vec3::ZERO).turned(2, self.dice.between(-1.0, 1.0)).turned(0, self.dice.around_zero(lean))
    }

    /// Thin rods.
    fn twigs(&mut self) {
        let mut coating = self.coatings.next(self.dice, false);
        for _ in 0..self.dice.count(1, 6) {
            if self.dice.happens(0.3) {
                coating = self.coatings.next(self.dice, false);
            }
            let (radius, half_length) = (self.dice.mostly_low(0.4, 2.2), self.dice.between(12.0, 110.0));
            let pose = self.in_image(0.15);
            let place = self.place;
            self.place = place.map(|at| at + self.dice.around_zero(40.0));
            self.add_solid(pose, &coating, |pixel| Shape::Rod { half_length: half_length * pixel, radius: radius * pixel });
            self.place = place;
        }
    }

    /// Rods that are alike, at equal distances.
    fn fence(&mut self) {
        let coating = self.coatings.next(self.dice, false);
        let (radius, distance) = (self.dice.mostly_low(0.5, 3.0), self.dice.between(6.0, 25.0));
        let (count, half_length) = (self.dice.count(3, 8), self.dice.between(20.0, 120.0));
        let pose = if self.dice.happens(0.5) { Pose::at(Vec3::ZERO) } else { self.in_image(0.1) };
        let [x, y] = self.place;
        for k in 0..count {
            let along = distance * (f64::from(k) - 0.5 * f64::from(count));
            self.place = [x + pose.axes[0].x * along, y - pose.axes[0].y * along];
            self.add_solid(pose, &coating, |pixel| Shape::Rod { half_length: half_length * pixel, radius: radius * pixel });
        }
    }

    /// Small panels at similar disparities.
    fn leaves(&mut self) {
        let (coating, disparity) = (self.coatings.next(self.dice, true), self.disparity);
        for _ in 0..self.dice.count(4, 10) {
            let place = self.place.map(|at| at + self.dice.around_zero(45.0));
            let half = [self.dice.between(5.0, 22.0), self.dice.between(1.5, 7.0)];
            self.disparity = (disparity + self.dice.between(-1.5, 1.5)).clamp(self.viewport.far, self.viewport.near);
            let other = coating.moved(self.dice);
            self.add_panel(place, half, 0.2, &other);
        }
    }

    /// Four bars around an opening.
    fn frame(&mut self) {
        let coating = self.coatings.next(self.dice, false);
        let [half_width, half_height, bar] =
            [(20.0, 90.0), (15.0, 70.0), (1.0, 8.0)].map(|(low, high)| self.dice.between(low, high));
        let pose = if self.dice.happens(0.5) { Pose::at(Vec3::ZERO) } else { self.in_image(0.1) };
        let [x, y] = self.place;
        for (side, half) in [
            ([half_width, 0.0], [bar, half_height + bar]),
            ([-half_width, 0.0], [bar, half_height + bar]),
            ([0.0, half_height], [half_width, bar]),
            ([0.0, -half_height], [half_width, bar]),
        ] {
            let aside = pose.axes[0] * side[0] + pose.axes[1] * side[1];
            self.place = [x + aside.x, y - aside.y];
            let part = coating.moved(self.dice);
            self.add_solid(pose, &part, |pixel| Shape::Block { half: Vec3::new(half[0], half[1], bar) * pixel });
        }
    }

    /// Thick bars side by side in front of a board: deep slits between them, into which only views along the slits see.
    fn slits(&mut self) {
        let (front, half_length) = (self.disparity, self.dice.between(20.0, 80.0));
        let (bar, slit, count) = (self.dice.between(3.0, 14.0), self.dice.between(2.0, 9.0), self.dice.count(3, 7));
        let pose = Pose::at(Vec3::ZERO).turned(2, self.dice.pick([0.0, 1.0]));
        let pose = if self.dice.happens(0.6) { pose } else { pose.turned(2, self.dice.around_zero(0.1)) };
        let [x, y] = self.place;
        let footprint = self.viewport.footprint(self.viewport.depth(front));
        let back = self.viewport.far.max(front * self.dice.between(0.4, 0.85));
        let deep = self.viewport.depth(back) - self.viewport.depth(front);
        let coating = self.coatings.next(self.dice, false);
        for k in 0..count {
            let along = (bar + slit) * (f64::from(k) - 0.5 * f64::from(count - 1));
            let place = [x + pose.axes[1].x * along, y - pose.axes[1].y * along];
            let origin = self.viewport.point(place, self.viewport.depth(front)) + Vec3::Z * (0.5 * deep);
            let half = Vec3::new(half_length * footprint, 0.5 * bar * footprint, 0.5 * deep);
            let part = coating.moved(self.dice);
            self.objects.push(part.object(Shape::Block { half }, Pose { origin, ..pose }, footprint));
        }
        let half_height = 0.5 * f64::from(count) * (bar + slit);
        let board = Shape::Panel { half_width: half_length * footprint, half_height: half_height * footprint };
        let origin = self.viewport.point(self.place, self.viewport.depth(front)) + Vec3::Z * deep;
        self.objects.push(self.coatings.next(self.dice, true).object(board, Pose { origin, ..pose }, footprint));
    }

    /// Adds a solid in an orientation, no nearer than the nearest disparity. `shape` makes it from the millimetres that a pixel
    /// shows.
    fn add_solid(&mut self, orientation: Pose, coating: &Coating, shape: impl Fn(f64) -> Shape) {
        let nominal = self.viewport.depth(self.disparity);
        let footprint = self.viewport.footprint(nominal);
        let shape = shape(footprint);
        let ahead = match shape {
            Shape::Rod { half_length, radius } => half_length * orientation.axes[1].z.abs() + radius,
            _ => shape.bounding_radius(),
        };
        let depth = nominal.max(self.viewport.depth(self.viewport.near) + ahead);
        let pose = Pose { origin: self.viewport.point(self.place, depth), ..orientation };
        self.objects.push(coating.object(shape, pose, footprint));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_has_the_disparities_that_it_was_made_for() {
        let viewport = Viewport { focal: 300.0, half: [128.0, 96.0], baseline_mm: 20.0, far: 2.0, near: 20.0 };
        let (place, disparity, slope) = ([30.0, -40.0], 7.0, [0.02, -0.03]);
        let pose = viewport.plane(place, disparity, slope);
        for (x, y) in [(30.0, -40.0), (0.0, 0.0), (-100.0, 80.0), (120.0, -90.0)] {
            let direction = viewport.point([x, y], 1.0);
            let depth = pose.axes[2].dot(pose.origin) / pose.axes[2].dot(direction);
            let expected = disparity + slope[0] * (x - place[0]) + slope[1] * (y - place[1]);
            assert!((viewport.depth(expected) - depth).abs() < 1e-9 * depth, "({x}, {y})");
        }
        assert!(pose.axes[0].cross(pose.axes[1]).dot(pose.axes[2]) > 0.999_999);
    }
}
