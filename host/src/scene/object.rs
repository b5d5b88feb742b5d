//! A body in a scene.

use super::{
    pose::Pose,
    shape::Shape,
    texture::{Placement, Texture},
    vec3::Vec3,
};

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
    /// Its colours.
    pub texture: Texture,
    /// Where its texture lies in its own coordinates.
    pub placement: Placement,
    /// How its surface reflects light.
    pub finish: Finish,
}

impl Object {
    /// The point of the texture that lies at a point of the world.
    pub(super) fn texture_point(&self, world: Vec3) -> Vec3 {
        self.placement.texture_point(self.pose.local_point(world))
    }
}
