//! Replies of machines with Grbl or Marlin.

use std::{
    io::{self, Read, Write},
    time::Duration,
};

use multiscopic::capture::stage::{Limits, gcode};
use multiscopic_core::capture::{Position, Stage};

/// A port that brings the input, in pieces of a few bytes, and is then unplugged.
struct Port(Vec<u8>);

impl Read for Port {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // A zero is a pause.
        if self.0.first() == Some(&0) {
            self.0.remove(0);
            return Err(io::ErrorKind::TimedOut.into());
        }
        let piece = self.0.iter().position(|&byte| byte == 0).unwrap_or(self.0.len()).min(buffer.len());
        buffer[..piece].copy_from_slice(&self.0[..piece]);
        self.0.drain(..piece);
        Ok(piece)
    }
}

impl Write for Port {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Tries an input.
pub fn run(bytes: &[u8]) -> bool {
    let timeout = Duration::from_millis(20);
    let limits = Limits { connect_timeout: timeout, silence_timeout: timeout, stall_timeout: timeout, ..Limits::default() };
    let Ok(mut stage) = gcode::connect(Port(bytes.to_vec()), "port", &limits) else { return true };
    if stage.move_to(Position { x_um: 20_000, y_um: -10_000 }).is_ok() {
        let _ = stage.has_arrived();
    }
    if let Ok(Some(position)) = stage.position() {
        let _ = stage.move_to(position);
    }
    let _ = stage.stop();
    true
}
