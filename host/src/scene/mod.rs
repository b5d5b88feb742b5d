//! Made-up scenes with known depth: a small ray tracer, and the camera and stage that "capture" with it.
//!
//! Everything is the same on every machine: only the operations that IEEE 754 rounds exactly are used (`+ - * /` and square
//! root; no powers, logarithms or angles), every random number is a hash of its place and the seed, and no sum depends on the
//! order of threads.
//!
//! ```
//! use multiscopic::scene::{Camera, Scene, capture};
//! let camera = Camera::new(64, 48);
//! let shot = capture(&Scene::demo(), &camera, 1);
//! assert_eq!(shot.center.dimensions(), (64, 48));
//! assert!(shot.truth.pixels().iter().all(|d| (0.5..5.5).contains(d)));
//! ```

mod camera;
mod demo;
mod noise;
mod shade;
mod shape;
mod texture;
mod trace;
mod vector;

pub use camera::{Camera, Shot, capture};
pub use shape::Shape;
pub use texture::Texture;
pub use vector::{Pose, Ray, Vec3};

/// How a surface treats light beyond its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Finish {
    /// Lambert's law: the same from everywhere.
    Matte,
    /// Matte with a soft highlight.
    Satin,
    /// Matte under a clear coat, which mirrors a little, and more at grazing angles.
    Glazed,
    /// A brushed metal panel: its reflections move with the camera, its scratches do not.
    Brushed,
}

/// A body with its place and its looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Object {
    /// Its form.
    pub shape: Shape,
    /// Where it is.
    pub pose: Pose,
    /// Its colours, fixed to its own space.
    pub texture: Texture,
    /// How it treats light.
    pub finish: Finish,
}

/// A rectangular lamp that shines to the side of `half_u x half_v`, and is seen in reflections only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Its middle.
    pub center: Vec3,
    /// From the middle to one side.
    pub half_u: Vec3,
    /// From the middle to a side next to that one.
    pub half_v: Vec3,
    /// Its light, as the brightness it gives to a white surface that faces it from a metre away.
    pub light: Vec3,
}

/// Objects, the light on them, and the place they are seen from.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// What there is to see.
    pub objects: Vec<Object>,
    /// The main light.
    pub lamp: Lamp,
    /// The light from above, where nothing is in the way.
    pub sky: Vec3,
    /// The light from below.
    pub ground: Vec3,
    /// The centre camera: its axes are `u`, `v` and the optical axis.
    pub viewpoint: Pose,
}

impl Scene {
    /// The scene of `multiscopic demo`: a still life on a brushed metal table, from 0.4 m to 2.1 m.
    pub fn demo() -> Scene {
        demo::still_life()
    }
}
