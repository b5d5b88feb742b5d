//! The port that takes scripts.

use std::{
    fmt::Write as _,
    io::{self, Read, Write as _},
    net::{Shutdown, TcpStream},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use multiscopic_core::capture::Position;

use super::Pose;
use crate::capture::stage::{Limits, StageError};

/// How fast the arm is told to stop, in metres per second squared: from the highest speed within a quarter of a second.
const STOP_M_S2: f64 = 1.0;

/// A line of URScript that moves the tool straight to `position`, in the plane of its pose `start`.
///
/// The start is sent in numbers, so that a line that is sent twice moves once.
pub fn move_to(start: &Pose, position: Position, limits: &Limits) -> String {
    let [x, y] = [position.x_um, position.y_um].map(|um| f64::from(um) * 1e-6);
    let [start, offset] = [start.position.into_iter().chain(start.rotation).collect(), vec![x, y, 0.0, 0.0, 0.0, 0.0]].map(pose);
    let (a, v) = (limits.acceleration_mm_s2 * 1e-3, limits.speed_mm_s * 1e-3);
    format!("movel(pose_trans({start}, {offset}), a={a:.6}, v={v:.6})\n")
}

/// A line of URScript that stops a straight motion.
pub fn stop() -> String {
    format!("stopl({STOP_M_S2:.1})\n")
}

fn pose(numbers: Vec<f64>) -> String {
    let mut text = String::new();
    for (i, number) in numbers.iter().enumerate() {
        // Nanometres and nanoradians.
        let _ = write!(text, "{}{number:.9}", if i == 0 { "p[" } else { ", " });
    }
    text + "]"
}

/// A connection that scripts are sent over.
pub struct ScriptPort {
    stream: TcpStream,
    name: String,
    is_open: Arc<AtomicBool>,
    drain: Option<JoinHandle<()>>,
}

impl ScriptPort {
    /// Takes over a connection to what is called `name`. A send may take as long as `limit`.
    pub fn new(stream: TcpStream, name: String, limit: Duration) -> io::Result<ScriptPort> {
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(limit))?;
        stream.set_read_timeout(None)?;
        let (mut incoming, is_open) = (stream.try_clone()?, Arc::new(AtomicBool::new(true)));
        let still_open = is_open.clone();
        // The arm sends its state here too, and gives up on who does not read it.
        let drain = thread::spawn(move || {
            let mut ignored = [0; 4096];
            loop {
                match incoming.read(&mut ignored) {
                    Ok(1..) => {}
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    _ => break,
                }
            }
            still_open.store(false, Ordering::Relaxed);
        });
        Ok(ScriptPort { stream, name, is_open, drain: Some(drain) })
    }

    /// Whether the arm has not closed it.
    pub fn is_open(&self) -> bool {
        self.is_open.load(Ordering::Relaxed)
    }

    /// Sends a line.
    pub fn send(&mut self, line: &str) -> Result<(), StageError> {
        match self.is_open() {
            true => self.stream.write_all(line.as_bytes()).map_err(|source| self.broken(source)),
            false => Err(self.broken(io::ErrorKind::ConnectionReset.into())),
        }
    }

    /// Fails if the arm has closed it.
    pub fn check(&self) -> Result<(), StageError> {
        if self.is_open() { Ok(()) } else { Err(self.broken(io::ErrorKind::ConnectionReset.into())) }
    }

    fn broken(&self, source: io::Error) -> StageError {
        StageError::Disconnected {
            from: self.name.clone(),
            source,
            advice: "check the network, and set the arm to remote control",
        }
    }
}

impl Drop for ScriptPort {
    fn drop(&mut self) {
        let _ = self.stream.shutdown(Shutdown::Both);
        if let Some(drain) = self.drain.take() {
            let _ = drain.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines() {
        let start = Pose { position: [-0.4, 0.1, 1e-12], rotation: [3.1, 0.0, -0.5] };
        assert_eq!(
            move_to(&start, Position { x_um: -20_000, y_um: 1 }, &Limits::default()),
            "movel(pose_trans(p[-0.400000000, 0.100000000, 0.000000000, 3.100000000, 0.000000000, -0.500000000], \
             p[-0.020000000, 0.000001000, 0.000000000, 0.000000000, 0.000000000, 0.000000000]), a=0.100000, v=0.050000)\n"
        );
        assert_eq!(stop(), "stopl(1.0)\n");
    }
}
