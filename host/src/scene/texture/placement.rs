//! Where a texture lies on an object.

use crate::scene::{pose::Pose, vec3::Vec3};

/// Where a texture lies in the coordinates of an object, and how large it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The origin and the axes of the texture.
    pub pose: Pose,
    /// How many times as large as it is by itself.
    pub scale: f64,
}

impl Placement {
    /// The texture as it is: its coordinates are those of the object.
    pub const IDENTITY: Placement = Placement { pose: Pose::at(Vec3::ZERO), scale: 1.0 };

    /// The point of the texture that lies at a point of the object.
    pub fn texture_point(&self, local: Vec3) -> Vec3 {
        self.pose.local_point(local) * (1.0 / self.scale)
    }
}
