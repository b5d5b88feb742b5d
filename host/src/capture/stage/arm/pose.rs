//! Where a tool is.

/// A pose as the arm gives it: a position in metres and a rotation vector, which is the axis times the angle in radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// In metres.
    pub position: [f64; 3],
    /// Axis times angle, in radians.
    pub rotation: [f64; 3],
}

impl Pose {
    /// The position of `other` in this pose's frame, in metres.
    pub fn offset_of(&self, other: &Pose) -> [f64; 3] {
        let [x, y, z] = self.position;
        let [other_x, other_y, other_z] = other.position;
        rotate([other_x - x, other_y - y, other_z - z], self.rotation.map(|component| -component))
    }

    /// How far `other` is turned against it, in radians from 0 to pi.
    pub fn angle_to(&self, other: &Pose) -> f64 {
        const AXES: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let trace: f64 = AXES.map(|axis| dot(rotate(axis, self.rotation), rotate(axis, other.rotation))).iter().sum();
        ((trace - 1.0) / 2.0).clamp(-1.0, 1.0).acos()
    }
}

/// Turns `vector` about a rotation vector, by Rodrigues' formula.
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
    fn a_quarter_turn_about_each_axis() {
        let from = |rotation| Pose { position: [1.0, 2.0, 3.0], rotation };
        let to = Pose { position: [1.1, 2.2, 3.3], rotation: [0.0; 3] };
        assert!(is_near(from([0.0; 3]).offset_of(&to), [0.1, 0.2, 0.3]));
        assert!(is_near(from([FRAC_PI_2, 0.0, 0.0]).offset_of(&to), [0.1, 0.3, -0.2]));
        assert!(is_near(from([0.0, FRAC_PI_2, 0.0]).offset_of(&to), [-0.3, 0.2, 0.1]));
        assert!(is_near(from([0.0, 0.0, FRAC_PI_2]).offset_of(&to), [0.2, -0.1, 0.3]));
        // The usual pose of a tool that looks down.
        assert!(is_near(from([PI, 0.0, 0.0]).offset_of(&to), [0.1, -0.2, -0.3]));
    }

    #[test]
    fn angles() {
        let turned = |rotation| Pose { position: [0.0; 3], rotation };
        let angle = |a, b| turned(a).angle_to(&turned(b));
        assert_eq!(angle([0.0; 3], [0.0; 3]), 0.0);
        assert!((angle([0.0, 0.3, 0.0], [0.0, -0.2, 0.0]) - 0.5).abs() < 1e-12);
        // The same rotation, said twice.
        assert!(angle([PI, 0.0, 0.0], [-PI, 0.0, 0.0]) < 1e-7);
    }
}
