//! The records of all items.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use multiscopic::{Error, Result};
use serde::{Serialize, de::DeserializeOwned};

use crate::{
    command::{
        batch::{Fingerprint, ItemRecord, OutputRecord, RunFile, names},
        r#match::Summary,
        terminal,
    },
    results::text_table,
};

/// The records of all items of a run, in their order.
pub struct MergedRecords<R> {
    pub records: Vec<ItemRecord<R>>,
}

impl<R: DeserializeOwned> MergedRecords<R> {
    /// Reads the records of a run, and checks the outputs that they tell of.
    ///
    /// # Errors
    /// [`Error::Usage`] if an item has no record or several, or one of another run; and those of reading.
    pub fn read(directories: &[PathBuf], run: &RunFile) -> Result<MergedRecords<R>> {
        check_folders(directories)?;
        let (mut records, mut missing) = (Vec::with_capacity(run.items.len()), Vec::new());
        for item in &run.items {
            let mut place: Option<&Path> = None;
            for directory in directories {
                let folder = ItemRecord::<R>::folder(directory, item);
                let Some(record) = ItemRecord::<R>::read(&folder)? else { continue };
                if let Some(place) = place.replace(directory) {
                    let [first, second] = [place, directory].map(Path::display);
                    return Err(Error::Usage(format!(
                        "{item} is in both {first} and {second}: remove one of them, and give the folders of one run"
                    )));
                }
                if let Some(difference) = run.run.difference(&record.run) {
                    return Err(mixed(&folder, &directories[0], &difference));
                }
                record.check_outputs(&folder)?;
                records.push(record);
            }
            if place.is_none() {
                missing.push(item.as_str());
            }
        }
        match missing.len() {
            0 => Ok(MergedRecords { records }),
            count => Err(Error::Usage(format!(
                "{count} of {} items are missing: {}: run their shards again, which do only what is not done",
                run.items.len(),
                names(&missing)
            ))),
        }
    }
}

/// An error about a folder that has something else than another one.
pub fn mixed(directory: &Path, first: &Path, difference: &str) -> Error {
    let [directory, first] = [directory, first].map(Path::display);
    Error::Usage(format!("{directory} has {difference} as in {first}: give the folders of one run"))
}

/// Refuses a folder that is given twice.
fn check_folders(directories: &[PathBuf]) -> Result<()> {
    let mut seen = BTreeSet::new();
    match directories.iter().find(|directory| !seen.insert(directory.canonicalize().unwrap_or_else(|_| directory.to_path_buf())))
    {
        Some(twice) => Err(Error::Usage(format!("{} is given twice", twice.display()))),
        None => Ok(()),
    }
}

/// What came of a rig.
#[derive(Serialize)]
pub struct MergedRig {
    rig: String,
    #[serde(flatten)]
    summary: Summary,
    inputs: Fingerprint,
    outputs: Vec<OutputRecord>,
}

impl MergedRig {
    /// Those of the records.
    pub fn all(merged: MergedRecords<Summary>) -> Vec<MergedRig> {
        let rig = |record: ItemRecord<Summary>| {
            let ItemRecord { item, inputs, outputs, results, .. } = record;
            MergedRig { rig: item, summary: results, inputs, outputs }
        };
        merged.records.into_iter().map(rig).collect()
    }

    /// A table of them, which fits the terminal.
    pub fn to_text(rigs: &[MergedRig]) -> String {
        let rows: Vec<Vec<String>> = rigs.iter().map(|rig| rig.summary.cells(&rig.rig).into()).collect();
        text_table(&Summary::HEADINGS, &rows, 2, terminal::columns())
    }
}
