//! Files for Rerun. Its own program makes them of recordings, so that they have the format of the installed version.

use std::{
    fs::File,
    io::{self, Write},
    path::Path,
    process::{Command, Stdio},
    time::Duration,
};

use super::{RosRecording, RosStream};
use crate::{
    error::{Error, Result},
    files::output,
};

/// Rerun's program.
const PROGRAM: &str = "rerun";

impl RosRecording<'_> {
    /// Writes a file for Rerun with one message on each topic, all from a `time` since 1970.
    ///
    /// # Errors
    /// [`Error::Usage`] if the centre and the disparities differ in size, and [`Error::Write`], also if Rerun
    /// is not installed or fails. Any previous version of the file is unchanged.
    ///
    /// # Panics
    /// If the confidences and the disparities differ in size.
    pub fn write_rerun(&self, path: &Path, time: Duration) -> Result<()> {
        self.check()?;
        output::write(path, |file| {
            let folder = tempfile::tempdir()?;
            let [recording, converted] = ["recording.mcap", "recording.rrd"].map(|name| folder.path().join(name));
            let mut stream = RosStream::new(File::create(&recording)?)?;
            stream.send(self, time)?;
            stream.finish()?;
            let convert = ["mcap", "convert", "--application-id", "multiscopic", "-o"];
            run(Command::new(PROGRAM).args(convert).arg(&converted).arg(&recording))?;
            io::copy(&mut File::open(&converted)?, file).map(drop)
        })
    }
}

/// Checks that Rerun is installed.
///
/// # Errors
/// [`Error::Usage`] if its program cannot be run.
pub fn check_rerun() -> Result<()> {
    run(Command::new(PROGRAM).arg("--version")).map_err(|error| Error::Usage(error.to_string()))
}

/// Runs Rerun's program. What it says is shown if it fails.
fn run(command: &mut Command) -> io::Result<()> {
    let missing = |error| io::Error::other(format!("`{PROGRAM}` cannot be run, which `pip install rerun-sdk` brings: {error}"));
    let output = command.stdin(Stdio::null()).output().map_err(missing)?;
    if output.status.success() {
        return Ok(());
    }
    io::stderr().write_all(&output.stderr)?;
    Err(io::Error::other(format!("`{PROGRAM}` failed ({})", output.status)))
}
