//! Serial ports that pass bytes on as they are.

use std::{
    fs::File,
    io::{self, Read},
    path::Path,
};

use multiscopic::{Error, Result};
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};

/// A file, or a serial port that passes bytes on as they are while it is open.
pub struct RawPort {
    file: File,
    /// The settings that the port had, if they were others.
    before: Option<Termios>,
}

impl RawPort {
    /// Opens the file at `path`. If it is a terminal, which a serial port is as well, it is set raw: it echoes and changes
    /// nothing.
    ///
    /// # Errors
    /// [`Error::Read`], and [`Error::Usage`] if a terminal cannot be set raw.
    pub fn open(path: &Path) -> Result<RawPort> {
        let file = File::open(path).map_err(|source| Error::Read { path: path.into(), source })?;
        let Ok(before) = tcgetattr(&file) else { return Ok(RawPort { file, before: None }) };
        if is_raw(&before) {
            return Ok(RawPort { file, before: None });
        }
        let mut settings = before.clone();
        settings.make_raw();
        // The system may succeed with a part of the settings.
        let set = tcsetattr(&file, OptionalActions::Now, &settings).and_then(|()| tcgetattr(&file));
        match set {
            Ok(settings) if is_raw(&settings) => Ok(RawPort { file, before: Some(before) }),
            _ => Err(Error::Usage(format!(
                "the port {0} changes bytes, and cannot be set raw: run `stty -F {0} raw -echo 115200` first",
                path.display()
            ))),
        }
    }
}

/// Checks that standard input passes bytes on as they are, if it is a terminal.
///
/// # Errors
/// [`Error::Usage`].
pub fn check_standard_input() -> Result<()> {
    match tcgetattr(io::stdin()) {
        Ok(settings) if !is_raw(&settings) => {
            let message =
                "standard input is a terminal, which changes bytes: give the serial port, such as /dev/ttyACM0, or a file";
            Err(Error::Usage(message.into()))
        }
        _ => Ok(()),
    }
}

/// Returns true if making the settings raw changes nothing.
fn is_raw(settings: &Termios) -> bool {
    let mut raw = settings.clone();
    raw.make_raw();
    let modes = |termios: &Termios| (termios.input_modes, termios.output_modes, termios.control_modes, termios.local_modes);
    modes(&raw) == modes(settings)
}

impl Read for RawPort {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.file.read(buffer)
    }
}

impl Drop for RawPort {
    fn drop(&mut self) {
        if let Some(before) = &self.before {
            // If the port is gone, there is nothing to restore.
            let _ = tcsetattr(&self.file, OptionalActions::Now, before);
        }
    }
}
