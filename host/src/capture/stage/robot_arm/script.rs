//! Sending URScript to an arm, and the pose of its tool.

use std::{
    fmt::Write as _,
    io,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use multiscopic_core::capture::Position;

use super::network::Connection;
use crate::{
    capture::stage::{error::StageError, limits::Limits},
    images::Transform,
};

/// Deceleration of a stop in metres per second squared: the highest speed ends within a quarter of a second.
const STOP_M_S2: f64 = 1.0;

/// The line of URScript that moves the tool straight to `position`, in the plane of the pose `start`.
///
/// The target is absolute, so that sending the line twice moves once.
pub fn move_line(start: &ToolPose, position: Position, limits: &Limits) -> String {
    let [x, y] = [position.x_um, position.y_um].map(|um| f64::from(um) * 1e-6);
    let [start, offset] =
        [start.position.into_iter().chain(start.rotation).collect(), vec![x, y, 0.0, 0.0, 0.0, 0.0]].map(pose_literal);
    let (a, v) = (limits.acceleration_mm_s2 * 1e-3, limits.speed_mm_s * 1e-3);
    format!("movel(pose_trans({start}, {offset}), a={a:.6}, v={v:.6})\n")
}

/// The line of URScript that stops a straight move.
pub fn stop_line() -> String {
    format!("stopl({STOP_M_S2:.1})\n")
}

fn pose_literal(numbers: Vec<f64>) -> String {
    let mut text = String::new();
    for (i, number) in numbers.iter().enumerate() {
        // To the nanometre and nanoradian.
        let _ = write!(text, "{}{number:.9}", if i == 0 { "p[" } else { ", " });
    }
    text + "]"
}

/// The connection over which scripts are sent.
pub struct ScriptPort {
    stream: Box<dyn Connection>,
    name: String,
    is_open: Arc<AtomicBool>,
    drain: Option<JoinHandle<()>>,
}

impl ScriptPort {
    /// Sends over `stream`, called `name` in messages. Sending a line may take as long as `limit`.
    pub fn new(stream: Box<dyn Connection>, name: String, limit: Duration) -> io::Result<ScriptPort> {
        stream.set_write_timeout(limit)?;
        stream.set_read_timeout(None)?;
        let (mut incoming, is_open) = (stream.try_clone()?, Arc::new(AtomicBool::new(true)));
        let reader_open = is_open.clone();
        // The arm sends its state here too, and disconnects clients that do not read it.
        let drain = thread::spawn(move || {
            let mut discarded = [0; 4096];
            loop {
                match incoming.read(&mut discarded) {
                    Ok(1..) => {}
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    _ => break,
                }
            }
            reader_open.store(false, Ordering::Relaxed);
        });
        Ok(ScriptPort { stream, name, is_open, drain: Some(drain) })
    }

    /// Returns true if the arm has not closed the connection.
    pub fn is_open(&self) -> bool {
        self.is_open.load(Ordering::Relaxed)
    }

    /// Sends a line of URScript.
    pub fn send(&mut self, line: &str) -> Result<(), StageError> {
        match self.is_open() {
            true => self.stream.write_all(line.as_bytes()).map_err(|source| self.disconnected(source)),
            false => Err(self.disconnected(io::ErrorKind::ConnectionReset.into())),
        }
    }

    /// Fails if the arm has closed the connection.
    pub fn check_open(&self) -> Result<(), StageError> {
        if self.is_open() { Ok(()) } else { Err(self.disconnected(io::ErrorKind::ConnectionReset.into())) }
    }

    fn disconnected(&self, source: io::Error) -> StageError {
        StageError::Disconnected {
            from: self.name.clone(),
            source,
            advice: "check the network, and set the arm to remote control",
        }
    }
}

impl Drop for ScriptPort {
    fn drop(&mut self) {
        self.stream.shutdown();
        if let Some(drain) = self.drain.take() {
            let _ = drain.join();
        }
    }
}

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

    /// The same in millimetres and degrees.
    pub fn transform(&self) -> Transform {
        Transform { translation_mm: self.position.map(|metres| 1e3 * metres), rotation_deg: self.rotation.map(f64::to_degrees) }
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
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;

    #[test]
    fn moves_and_stops_in_urscript() {
        let start = ToolPose { position: [-0.4, 0.1, 1e-12], rotation: [3.1, 0.0, -0.5] };
        assert_eq!(
            move_line(&start, Position { x_um: -20_000, y_um: 1 }, &Limits::default()),
            "movel(pose_trans(p[-0.400000000, 0.100000000, 0.000000000, 3.100000000, 0.000000000, -0.500000000], \
             p[-0.020000000, 0.000001000, 0.000000000, 0.000000000, 0.000000000, 0.000000000]), a=0.100000, v=0.050000)\n"
        );
        assert_eq!(stop_line(), "stopl(1.0)\n");
    }

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
