//! What the centre camera sees, addressed by pixels and disparities.

use super::NOMINAL_WIDTH;
use crate::scene::{pose::Pose, vec3::Vec3};

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

    /// The pose of the plane with this disparity at a place, which grows by `slope` with each pixel to the right and down. Its z
    /// axis is the plane's normal, and its x axis lies in the image plane.
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
