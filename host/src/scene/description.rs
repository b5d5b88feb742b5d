//! Scenes: their objects, the lamp and the sky, and the frames that a camera takes of them.

use std::collections::BTreeMap;

use image::RgbImage;
use multiscopic_core::{Frame, View, Views};

use super::{
    geometry::{Pose, Shape, Vec3},
    texture::{Placement, Texture},
};
use crate::images::{FloatImage, Frames, Picture};

/// A rectangular lamp. It shines towards `half_u x half_v` (the vector product), and only reflections show
/// the lamp itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// The centre of the rectangle.
    pub center: Vec3,
    /// From the centre to the middle of one side.
    pub half_u: Vec3,
    /// From the centre to the middle of an adjacent side.
    pub half_v: Vec3,
    /// The brightness that the lamp gives to a white surface facing it from a metre away.
    pub light: Vec3,
}

/// Objects, the light on them, and the viewpoint. Lengths are in millimetres, light is in linear red, green
/// and blue.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Everything that can be seen.
    pub objects: Vec<Object>,
    /// The main light.
    pub lamp: Lamp,
    /// The ambient light from above.
    pub sky: Vec3,
    /// The ambient light from below.
    pub ground: Vec3,
    /// The pose of the centre camera. Its axes are `u`, `v` and the optical axis.
    pub viewpoint: Pose,
}

/// The reflection of light by a surface, apart from its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Finish {
    /// Lambert's law: equally bright from every direction.
    Matte,
    /// Matte with a soft highlight.
    Satin,
    /// Matte under a clear coat that mirrors a little, and more at grazing angles.
    Glazed,
    /// Matte under what mirrors a third: wet or polished.
    Polished,
    /// Brushed metal: its reflections move with the camera, its scratches do not.
    Brushed,
}

/// A body, where it is, and what it looks like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Object {
    /// Its form.
    pub shape: Shape,
    /// Its position and orientation.
    pub pose: Pose,
    /// Its colours.
    pub texture: Texture,
    /// The place of its texture in its own coordinates.
    pub placement: Placement,
    /// The reflection of light by its surface.
    pub finish: Finish,
}

impl Object {
    /// The point of the texture that lies at a point of the world.
    pub(super) fn texture_point(&self, world: Vec3) -> Vec3 {
        self.placement.texture_point(self.pose.local_point(world))
    }
}

/// Rendered frames and the true disparities of the centre.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// The centre frame, which is the reference.
    pub center: RgbImage,
    /// The neighbours.
    pub neighbors: BTreeMap<View, RgbImage>,
    /// The true disparity of every centre pixel, in pixels at the nominal baseline. It is that of the point
    /// which the ray through the pixel's centre meets, and infinite if there is none.
    pub truth: FloatImage,
}

impl Shot {
    /// One of the frames.
    ///
    /// # Panics
    /// If it was not rendered.
    pub fn frame(&self, frame: Frame) -> &RgbImage {
        match frame {
            Frame::Center => &self.center,
            Frame::View(view) => &self.neighbors[&view],
        }
    }

    /// The centre and all neighbours with their colours, ready for matching.
    pub fn color_frames(&self) -> Frames {
        let picture = |image: &RgbImage| Picture::Rgb(image.clone());
        let center = Frames::of_picture(picture(&self.center));
        self.neighbors.iter().fold(center, |frames, (view, image)| frames.with_picture(*view, picture(image)))
    }

    /// The centre and the neighbours `views`, in grey, ready for matching.
    ///
    /// # Panics
    /// If a view was not rendered.
    pub fn frames(&self, views: Views) -> Frames {
        let gray = |frame| Picture::Rgb(self.frame(frame).clone()).to_gray();
        views.iter().fold(Frames::new(gray(Frame::Center)), |frames, view| frames.with(view, gray(Frame::View(view))))
    }
}

/// The tangent of half the angle by which the camera looks down: 10.4 degrees, with `sin = 11/61`.
const PITCH: f64 = 1.0 / 11.0;

const CREAM: Vec3 = Vec3::srgb(0xEADDC4);
const TEAL: Vec3 = Vec3::srgb(0x2F6F73);
const DEEP_TEAL: Vec3 = Vec3::srgb(0x174A52);
const CORAL: Vec3 = Vec3::srgb(0xE2725B);
const MUSTARD: Vec3 = Vec3::srgb(0xE0A526);
const NAVY: Vec3 = Vec3::srgb(0x22304F);

impl Scene {
    /// The scene of `multiscopic demo`: a still life on a table of brushed metal, from 0.4 m to 2.1 m away.
    pub fn demo() -> Scene {
        let mut objects = room();
        objects.extend(table_objects());
        objects.extend(flowers());
        // The image's v axis points down, the world's y axis up.
        let level = Pose { origin: Vec3::new(0.0, 220.0, 0.0), axes: [Vec3::X, -Vec3::Y, Vec3::Z] };
        Scene {
            objects,
            lamp: Lamp {
                center: Vec3::new(-520.0, 860.0, 260.0),
                half_u: Vec3::new(120.0, 0.0, -90.0),
                half_v: Vec3::new(53.0, 94.0, 71.0),
                light: Vec3::new(1.0, 0.93, 0.82) * 1.2,
            },
            sky: Vec3::new(0.42, 0.47, 0.55) * 0.62,
            ground: Vec3::new(0.30, 0.25, 0.22) * 0.5,
            viewpoint: level.turned(0, -PITCH),
        }
    }
}

fn object(shape: Shape, pose: Pose, texture: Texture, finish: Finish) -> Object {
    Object { shape, pose, texture, placement: Placement::IDENTITY, finish }
}

fn sphere(radius: f64, pose: Pose, texture: Texture, finish: Finish) -> Object {
    object(Shape::Sphere { radius }, pose, texture, finish)
}

fn block(half: Vec3, pose: Pose, texture: Texture, finish: Finish) -> Object {
    object(Shape::Block { half }, pose, texture, finish)
}

fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose::at(Vec3::new(x, y, z))
}

fn room() -> Vec<Object> {
    let wall = Texture::Plaster { low: DEEP_TEAL, high: TEAL * 1.3, grain: 3.2, octaves: 5 };
    let oak = Texture::Wood { light: Vec3::srgb(0xC99A62), dark: Vec3::srgb(0x7A4B25), ring: 7.0 };
    vec![
        object(Shape::Panel { half_width: 1500.0, half_height: 1200.0 }, at(0.0, 500.0, 2100.0), wall, Finish::Matte),
        object(
            Shape::Panel { half_width: 900.0, half_height: 530.0 },
            at(0.0, 0.0, 680.0).turned(0, 1.0),
            Texture::Brushed(Vec3::srgb(0xABB0BA)),
            Finish::Brushed,
        ),
        // Turned so that the grain runs along the frame's long side.
        block(Vec3::new(118.0, 158.0, 14.0), at(400.0, 196.0, 2086.0).turned(2, 1.0), oak, Finish::Satin),
        object(
            Shape::Panel { half_width: 140.0, half_height: 100.0 },
            at(400.0, 196.0, 2070.0),
            Texture::Plain(CREAM),
            Finish::Matte,
        ),
    ]
}

fn table_objects() -> Vec<Object> {
    let board = Texture::Dots { paper: CREAM, inks: [CORAL, MUSTARD, TEAL, NAVY], pitch: 26.0 };
    let marble = Texture::Marble { base: Vec3::srgb(0xE9E6E1), vein: Vec3::srgb(0x4A4E5A), size: 80.0 };
    let walnut = Texture::Wood { light: Vec3::srgb(0xB9793F), dark: Vec3::srgb(0x4A2814), ring: 6.5 };
    let terrazzo =
        Texture::Terrazzo { cement: Vec3::srgb(0xE8D9CC), chips: [CORAL, NAVY, MUSTARD, Vec3::srgb(0x7E9A8C)], pitch: 15.0 };
    let checker = Texture::Checker { even: NAVY, odd: CREAM, side: 13.0 };
    vec![
        block(Vec3::new(135.0, 145.0, 5.0), at(-290.0, 142.0, 1075.0).turned(1, 0.14).turned(0, 0.12), board, Finish::Matte),
        sphere(92.0, at(-75.0, 92.0, 870.0).turned(0, 0.3).turned(1, 0.4), marble, Finish::Glazed),
        block(
            Vec3::new(118.0, 21.0, 84.0),
            at(215.0, 21.0, 905.0).turned(1, 0.16),
            Texture::Cloth { ground: CORAL, stripe: CREAM, pitch: 118.0 },
            Finish::Matte,
        ),
        block(
            Vec3::new(104.0, 17.0, 74.0),
            at(208.0, 59.0, 908.0).turned(1, -0.1),
            Texture::Cloth { ground: NAVY, stripe: MUSTARD, pitch: 90.0 },
            Finish::Matte,
        ),
        sphere(50.0, at(222.0, 126.0, 905.0).turned(0, 0.5), terrazzo, Finish::Satin),
        sphere(36.0, at(-165.0, 36.0, 660.0).turned(2, 0.45).turned(0, -0.3), walnut, Finish::Satin),
        block(Vec3::splat(26.0), at(-25.0, 26.0, 640.0).turned(1, 0.27), checker, Finish::Matte),
    ]
}

fn flowers() -> Vec<Object> {
    let clay = Texture::Clouds { low: Vec3::srgb(0x8E3B26), high: Vec3::srgb(0xD9825F), grain: 0.9, octaves: 5 };
    let green = Texture::Clouds { low: Vec3::srgb(0x3F5A2A), high: Vec3::srgb(0x9DB36A), grain: 1.2, octaves: 3 };
    let yellow = Texture::Clouds { low: Vec3::srgb(0x9A6510), high: Vec3::srgb(0xFFD84A), grain: 1.5, octaves: 3 };
    let foot = Vec3::new(118.0, 62.0, 570.0);
    let mut flowers = vec![sphere(40.0, Pose::at(Vec3::new(118.0, 39.0, 570.0)), clay, Finish::Glazed)];
    for (head, radius) in
        [(Vec3::new(62.0, 188.0, 520.0), 14.0), (Vec3::new(112.0, 214.0, 440.0), 14.0), (Vec3::new(158.0, 158.0, 540.0), 12.0)]
    {
        flowers.push(sphere(radius, Pose::at(head), yellow, Finish::Matte));
        flowers.push(object(stem(foot, head), between(foot, head), green, Finish::Matte));
    }
    flowers
}

fn stem(from: Vec3, to: Vec3) -> Shape {
    Shape::Rod { half_length: (to - from).length() / 2.0, radius: 2.2 }
}

/// The pose halfway between two points, with `y` along the line from one to the other.
fn between(from: Vec3, to: Vec3) -> Pose {
    let y = (to - from).normalized();
    let x = y.cross(Vec3::Z).normalized();
    Pose { origin: from.lerp(to, 0.5), axes: [x, y, x.cross(y)] }
}
