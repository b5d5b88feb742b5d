//! Matches of many rigs.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use multiscopic::{Error, Result, files::ListedRig};

use super::Match;
use crate::command::{
    batch::{Done, RunSettings},
    terminal,
};

impl Match {
    /// Matches the rigs of a list that belong to the share of this machine.
    pub(super) fn run_list(&self, list: &Path, settings: &RunSettings) -> Result<ExitCode> {
        if self.outputs.within(Path::new(""))?.paths().is_empty() {
            let message = "there is nothing to write: give -o disparity.pfm, or another output such as --png disparity.png";
            return Err(Error::Usage(message.into()));
        }
        let rigs = ListedRig::read_all(list)?;
        let engine = self.engine.engine()?;
        let Some(batch) = self.batch.batch(settings, rigs.iter().map(|rig| rig.name.clone()))? else {
            return Err(Error::Usage("--list needs a folder for the results: give --results DIR".into()));
        };
        let inputs = |index: usize| {
            let source = self.source.source_of(&rigs[index].directory)?;
            Ok(source.paths().map(PathBuf::from).chain(self.truth_file(&source)).collect())
        };
        let work = |index: usize, folder: &Path| {
            let ListedRig { name, directory } = &rigs[index];
            let outputs = self.outputs.within(folder)?;
            let (summary, _) = self.matched(self.source.source_of(directory)?, &outputs, &engine)?;
            terminal::say(&format!("{name}: {summary}"));
            summary.warnings().iter().for_each(|warning| terminal::warn(&format!("{name}: {warning}")));
            Ok(Done { results: summary.without_time(), outputs: outputs.paths().into_iter().map(PathBuf::from).collect() })
        };
        Ok(batch.run(inputs, work))
    }
}
