//! `multiscopic merge`: the results of all machines as those of one.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{Error, Result, files::output};
use serde::{Serialize, de::DeserializeOwned};

use crate::{
    command::{
        batch::{Fingerprint, ItemRecord, OutputRecord, RunFile, names},
        evaluate::{SceneRecord, print_tables, write_json},
        r#match::Summary,
        terminal,
    },
    results::{Record, text_table},
};

/// Joins the results of several machines, and prints the table that one machine would print
///
/// The folders are the --results of `match --list` or `evaluate`. They must have been made by the same version with the same
/// options, and have every item once in all: gaps and duplicates are refused by name. Results have the same bits however the
/// items were shared. Times are left out, since they are never the same twice.
#[derive(Clone, Debug, Args)]
pub struct Merge {
    /// Folders of results: one that all machines shared, or one of each
    #[arg(value_name = "DIR", required = true)]
    directories: Vec<PathBuf>,

    /// Write the results as a JSON list: of `evaluate`, that of its --json without times; of `match`, the summary of each rig,
    /// with the size and the SHA-256 of each output
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl Merge {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        output::check(&self.json.iter().map(PathBuf::as_path).collect::<Vec<_>>(), &[])?;
        let run = self.run_file()?;
        if run.run.command == "match" {
            let rigs = MergedRig::all(MergedRecords::<Summary>::read(&self.directories, &run)?);
            self.json.as_ref().map_or(Ok(()), |path| write_json(&rigs, path))?;
            terminal::print(&MergedRig::to_text(&rigs))?;
        } else {
            let scenes = MergedRecords::<Vec<SceneRecord>>::read(&self.directories, &run)?;
            let records: Vec<Record> = scenes.records.into_iter().flat_map(|scene| scene.results).map(Record::from).collect();
            self.json.as_ref().map_or(Ok(()), |path| write_json(&records, path))?;
            print_tables(&records)?;
        }
        Ok(ExitCode::SUCCESS)
    }

    /// The run of all folders, which must be the same.
    fn run_file(&self) -> Result<RunFile> {
        let first = RunFile::read(&self.directories[0])?;
        for directory in &self.directories[1..] {
            let other = RunFile::read(directory)?;
            let difference = first.run.difference(&other.run).or((first.items != other.items).then(|| items(&first, &other)));
            if let Some(difference) = difference {
                return Err(mixed(directory, &self.directories[0], &difference));
            }
        }
        Ok(first)
    }
}

/// Describes how the items of another run differ.
fn items(first: &RunFile, other: &RunFile) -> String {
    let known: BTreeSet<&String> = first.items.iter().collect();
    let new = other.items.iter().find(|item| !known.contains(item));
    match new {
        Some(new) => format!("{new} among its {} items, not the {}", other.items.len(), first.items.len()),
        None => format!("{} items, not the {} in the same order", other.items.len(), first.items.len()),
    }
}

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

/// The outcome of a rig.
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
