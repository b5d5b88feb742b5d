//! The file that tells what a folder of results is about.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use multiscopic::{
    Error, Result,
    files::{input, output},
};
use serde::{Deserialize, Serialize};

use super::run_settings::RunSettings;

/// The largest file in bytes. The longest list of rigs needs less, with quotes and a line for each.
const MAX_BYTES: u64 = 1 << 25;

/// The settings and all items of a run, those of other shares too.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunFile {
    /// The settings that decide the results of all items.
    pub run: RunSettings,
    /// The names of the items in their order.
    pub items: Vec<String>,
}

impl RunFile {
    /// Reads that of a folder of results.
    ///
    /// # Errors
    /// [`Error::Read`], and [`Error::Format`] if it is something else.
    pub fn read(results: &Path) -> Result<RunFile> {
        let path = path(results);
        let bytes = input::read_at_most(&path, MAX_BYTES).map_err(|error| match error {
            Error::Read { source, .. } if source.kind() == io::ErrorKind::NotFound && results.is_dir() => Error::Format {
                path: results.into(),
                found: "a folder without run.json".into(),
                expected: "the --results of `match --list` or `evaluate`".into(),
            },
            error => error,
        })?;
        serde_json::from_slice(&bytes).map_err(|error| Error::Format {
            path,
            found: format!("something else ({error})"),
            expected: "what `match --list` and `evaluate --results` write".into(),
        })
    }

    /// Writes it to a folder of results, which is made if need be, unless it is there. Replaces that of a run with other settings
    /// or items.
    ///
    /// # Errors
    /// [`Error::Write`], and [`Error::Usage`] if the results there are those of another command.
    pub fn write(&self, results: &Path) -> Result<()> {
        fs::create_dir_all(results).map_err(|source| Error::Write { path: results.into(), source })?;
        // What cannot be read is replaced.
        if let Ok(before) = RunFile::read(results) {
            if before.run.command != self.run.command {
                let (results, other) = (results.display(), &before.run.command);
                return Err(Error::Usage(format!("{results} has the results of `{other}`: give another folder")));
            }
            if before == *self {
                return Ok(());
            }
        }
        let json = serde_json::to_string_pretty(self).expect("strings");
        output::write(&path(results), |writer| writeln!(writer, "{json}"))
    }
}

fn path(results: &Path) -> PathBuf {
    results.join("run.json")
}
