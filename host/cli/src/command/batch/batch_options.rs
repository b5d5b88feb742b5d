//! The items that a machine does, one after the other.

use std::{
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use clap::Args;
use multiscopic::{Error, Result};
use serde::{Serialize, de::IgnoredAny};

use super::{
    fingerprint::Fingerprint,
    item_record::{ItemRecord, OutputRecord},
    run_file::RunFile,
    run_settings::RunSettings,
    shard::Shard,
};
use crate::command::{advice, terminal};

/// The most names in a summary.
const MOST_NAMES: usize = 5;

/// Where results go, and which of them are made here.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Many items, on many machines")]
pub struct BatchOptions {
    /// Folder of the results: each item has a folder of its name there, with its record.json. Items whose record is there and
    /// fits are not done again. `multiscopic merge DIR` reads the records
    #[arg(long, value_name = "DIR")]
    results: Option<PathBuf>,

    /// Do the I-th of N shares alone, which are the items I, I + N, I + 2 N, ...: 1/8 to 8/8 are all items, on eight machines
    #[arg(long, value_name = "I/N", requires = "results")]
    shard: Option<Shard>,
}

/// The share of this machine.
pub struct Batch<'a> {
    results: &'a Path,
    shard: Shard,
    run: RunFile,
}

/// What was done to an item.
pub struct Done<R> {
    /// The results.
    pub results: R,
    /// The files that were written.
    pub outputs: Vec<PathBuf>,
}

impl BatchOptions {
    /// The share of this machine in items with unique names. `None` if the results go elsewhere.
    pub fn batch(&self, run: &RunSettings, items: impl IntoIterator<Item = String>) -> Result<Option<Batch<'_>>> {
        let Some(results) = &self.results else { return Ok(None) };
        let run = RunFile { run: run.clone(), items: items.into_iter().collect() };
        run.write(results)?;
        Ok(Some(Batch { results, shard: self.shard.unwrap_or(Shard::WHOLE), run }))
    }

    /// Whether the results go to a folder.
    pub fn is_given(&self) -> bool {
        self.results.is_some()
    }
}

impl Batch<'_> {
    /// Does every item of the share that is not done. An item is given by its index; `inputs` returns the files that are read,
    /// and `work` does it, with the outputs in a folder that is there. An item that fails is reported, and the others are done
    /// all the same. The exit code is then 1.
    pub fn run<R: Serialize>(
        &self,
        mut inputs: impl FnMut(usize) -> Result<Vec<PathBuf>>,
        mut work: impl FnMut(usize, &Path) -> Result<Done<R>>,
    ) -> ExitCode {
        let (mut done, mut skipped, mut failed) = (0, 0, Vec::new());
        for (index, item) in self.run.items.iter().enumerate().filter(|(index, _)| self.shard.has(*index)) {
            let was_done = inputs(index).and_then(|inputs| {
                let inputs = Fingerprint::of_files(inputs.iter().map(PathBuf::as_path))?;
                if self.is_done(item, &inputs) {
                    return Ok(true);
                }
                self.work(item, inputs, |folder| work(index, folder)).map(|()| false)
            });
            match was_done {
                Ok(true) => skipped += 1,
                Ok(false) => done += 1,
                Err(error) => {
                    terminal::complain(&format!("{item}: {}", advice::error(&error)));
                    failed.push(item.as_str());
                }
            }
        }
        let all = done + skipped + failed.len();
        let failures = match failed.len() {
            0 => String::new(),
            count => format!(", {count} failed: {}", names(&failed)),
        };
        let summary = format!(
            "{all} of {} items in shard {}: {done} done, {skipped} done before{failures}",
            self.run.items.len(),
            self.shard
        );
        match failed.is_empty() {
            true => terminal::say(&summary),
            false => terminal::complain(&summary),
        }
        if failed.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
    }

    /// Whether an item has a record of the same inputs and settings, and the outputs that it tells of.
    fn is_done(&self, item: &str, inputs: &Fingerprint) -> bool {
        let folder = ItemRecord::<IgnoredAny>::folder(self.results, item);
        // One that is no record was not written to its end, by the disk if not by us.
        let record = ItemRecord::<IgnoredAny>::read(&folder).ok().flatten();
        record.is_some_and(|record| {
            record.item == item && record.run == self.run.run && record.inputs == *inputs && record.has_outputs(&folder)
        })
    }

    fn work<R: Serialize>(&self, item: &str, inputs: Fingerprint, work: impl FnOnce(&Path) -> Result<Done<R>>) -> Result<()> {
        let folder = ItemRecord::<R>::folder(self.results, item);
        let failed = |source| Error::Write { path: folder.clone(), source };
        fs::create_dir_all(&folder).map_err(failed)?;
        // There must be no record while its outputs are replaced.
        let record = ItemRecord::<R>::path(&folder);
        if record.exists() {
            fs::remove_file(&record).map_err(failed)?;
        }
        let start = Instant::now();
        let done = work(&folder);
        let seconds = start.elapsed().as_secs_f64();
        if done.is_err() {
            // It stays if anything is in it.
            let _ = fs::remove_dir(&folder);
        }
        let Done { results, outputs } = done?;
        let outputs = outputs.iter().map(|output| OutputRecord::of(output)).collect::<Result<_>>()?;
        ItemRecord { item: item.into(), run: self.run.run.clone(), inputs, outputs, results, seconds }.write(&folder)
    }
}

/// Names for a message, not too many.
pub fn names(names: &[&str]) -> String {
    match names.len() {
        count if count > MOST_NAMES => format!("{} and {} more", names[..MOST_NAMES].join(", "), count - MOST_NAMES),
        _ => names.join(", "),
    }
}
