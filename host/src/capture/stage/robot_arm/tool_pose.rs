//! The pose of an arm's tool.

/// Position and orientation of the tool, as the arm reports them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolPose {
    /// Position in metres.
    pub position: [f64; 3],
    /// Rotation vector: the axis times the angle in radians.
    pub rotation: [f64; 3],
}

impl ToolPose {
    /// The position of `other` in this pose's frame, in metres.
    pub fn offset_of(&self, other: &ToolPose) -> [f64; 3] {
        let [x, y, z] = self.position;
        let [other_x, other_y, other_z] = other.position;
        rotate([other_x - x, other_y - y, other_z - z], self.rotation.map(|component| -component))
    }

    /// The angle between both orientations, in radians from 0 to pi.
    pub fn angle_to(&self, other: &ToolPose) -> f64 {
        const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let trace: f64 = AXES.map(|axis| dot(rotate(axis, self.rotation), rotate(axis, other.rotation))).iter().sum();
        ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos()
    }
}

/// Rotates `vector` by a rotation vector, after Rodrigues' formula.
fn rotate(vector: [f64; 3], rotation: [f64; 3]) -> [f64; 3] {
    let angle = dot(rotation, rotation).sqrt();
    if angle == 0.0 {
        return vector;
    }
    let axis = rotation.map(|component| component / angle);
    let (sin, cos) = angle.sin_cos();
    let (across, along) = (cross(axis, vector), dot(axis, vector) * (1.0 - cos));
    std::array::from_fn(|i| vector[i] * cos + across[i] * sin + axis[i] * along)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn is_near(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn offsets_after_quarter_turns_about_each_axis() {
        let from = |rotation| ToolPose { position: [1.0, 2.0, 3.0], rotation };
        let to = ToolPose { position: [1.1, 2.2, 3.3], rotation: [0.0; 3] };
        assert!(is_near(from([0.0; 3]).offset_of(&to), [0.1, 0.2, 0.3]));
        assert!(is_near(from([FRAC_PI_2, 0.0, 0.0]).offset_of(&to), [0.1, 0.3, -0.2]));
        assert!(is_near(from([0.0, FRAC_PI_2, 0.0]).offset_of(&to), [-0.3, 0.2, 0.1]));
        assert!(is_near(from([0.0, 0.0, FRAC_PI_2]).offset_of(&to), [0.2, -0.1, 0.3]));
        // The usual orientation of a tool that looks down.
        assert!(is_near(from([PI, 0.0, 0.0]).offset_of(&to), [0.1, -0.2, -0.3]));
    }

    #[test]
    fn angles_between_orientations() {
        let pose = |rotation| ToolPose { position: [0.0; 3], rotation };
        let angle = |a, b| pose(a).angle_to(&pose(b));
        assert_eq!(angle([0.0; 3], [0.0; 3]), 0.0);
        assert!((angle([0.0, 0.3, 0.0], [0.0, -0.2, 0.0]) - 0.5).abs() < 1e-12);
        // Two vectors of the same rotation.
        assert!(angle([PI, 0.0, 0.0], [-PI, 0.0, 0.0]) < 1e-7);
    }
}
