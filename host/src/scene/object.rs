//! A body in a scene.

use super::{pose::Pose, shape::Shape, texture::Texture};

/// How a surface reflects light, apart from its colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Finish {
    /// Lambert's law: equally bright from every direction.
    Matte,
    /// Matte with a soft highlight.
    Satin,
    /// Matte under a clear coat that mirrors a little, and more at grazing angles.
    Glazed,
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
    /// Its colours, in its own coordinates.
    pub texture: Texture,
    /// How its surface reflects light.
    pub finish: Finish,
}
