//! Work on many items, which several machines may share, and the records of what is done.

mod records;

use std::{
    fmt::{self, Display},
    fs,
    path::{Path, PathBuf},
    process::ExitCode,
    str::FromStr,
    time::Instant,
};

use clap::Args;
use multiscopic::{Error, Result};
use serde::{Serialize, de::IgnoredAny};

use crate::command::{advice, terminal};
pub use records::{Fingerprint, ItemRecord, OutputRecord, RunFile, RunSettings};

/// The most names in a summary.
const MOST_NAMES: usize = 5;

/// The folder of the results, and the share of them that is made here.
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

/// The work on an item.
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

    /// Returns true if the results go to a folder.
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

    /// Returns true if an item has a record of the same inputs and settings, and the outputs that it tells of.
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

/// Every N-th item from the I-th on, counted from 1: `I/N`, as in Jest, Playwright and cargo-nextest.
///
/// The order of the items alone decides which these are. Items that are appended move none to another share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    number: usize,
    count: usize,
}

impl Shard {
    /// All items.
    pub const WHOLE: Shard = Shard { number: 1, count: 1 };

    /// Returns true if the item at an index, from 0, belongs to it.
    pub fn has(self, index: usize) -> bool {
        index % self.count == self.number - 1
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Shard, String> {
        let parts = text.split_once('/').and_then(|(number, count)| Some((number.parse().ok()?, count.parse().ok()?)));
        match parts {
            Some((number, count)) if (1..=count).contains(&number) => Ok(Shard { number, count }),
            _ => Err("it must be I/N, with I from 1 to N: 2/8 is the second of eight shares".into()),
        }
    }
}

impl Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_in_one_shard() {
        for count in 1..6 {
            let shards: Vec<Shard> = (1..=count).map(|number| format!("{number}/{count}").parse().unwrap()).collect();
            for index in 0..13 {
                assert_eq!(shards.iter().filter(|shard| shard.has(index)).count(), 1, "{index} of {count}");
            }
            let sizes: Vec<usize> = shards.iter().map(|shard| (0..13).filter(|&index| shard.has(index)).count()).collect();
            assert!(sizes.iter().all(|&size| size == 13 / count || size == 13 / count + 1), "{sizes:?}");
        }
        assert!((0..9).all(|index| Shard::WHOLE.has(index)));
    }

    #[test]
    fn shards_are_counted_from_one() {
        for text in ["0/2", "3/2", "1/0", "1", "/", "1/2/3", "-1/2", "a/b", " 1/2"] {
            assert!(text.parse::<Shard>().unwrap_err().contains("with I from 1 to N"), "{text}");
        }
        assert_eq!("2/8".parse::<Shard>().unwrap().to_string(), "2/8");
    }
}
