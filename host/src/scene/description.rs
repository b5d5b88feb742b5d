//! The description of a scene: its objects, its light, and where it is seen from.

use super::{object::Object, pose::Pose, vec3::Vec3};

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
