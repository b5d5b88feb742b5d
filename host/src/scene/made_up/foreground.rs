//! The objects before the backdrop.

use super::{
    backdrop::Viewport,
    coatings::{Coating, Coatings},
    flaws::Dice,
};
use crate::scene::{
    description::Object,
    shape::Shape,
    vec3::{Pose, Vec3},
};

/// Groups of objects at random places.
pub fn foreground(dice: &mut Dice, viewport: &Viewport, coatings: &Coatings) -> Vec<Object> {
    let mut objects = Vec::new();
    for _ in 0..dice.count(4, 16) {
        let mut group = Group::new(dice, viewport, coatings);
        match group.dice.count(0, 19) {
            0..=5 => group.panel(),
            6..=9 => group.block(),
            10..=12 => group.ball(),
            13 | 14 => group.column(),
            15 | 16 => group.twigs(),
            17 => group.fence(),
            18 => group.leaves(),
            _ => group.frame(),
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
