//! `multiscopic merge`: the results of all machines as those of one.

mod merged_records;

use std::{collections::BTreeSet, path::PathBuf, process::ExitCode};

use clap::Args;
use multiscopic::{Result, files::output};

use self::merged_records::{MergedRecords, MergedRig, mixed};
use super::{
    batch::RunFile,
    evaluate::{SceneRecord, print_tables, write_json},
    r#match::Summary,
    terminal,
};
use crate::results::Record;

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

/// How the items of another run differ.
fn items(first: &RunFile, other: &RunFile) -> String {
    let known: BTreeSet<&String> = first.items.iter().collect();
    let new = other.items.iter().find(|item| !known.contains(item));
    match new {
        Some(new) => format!("{new} among its {} items, not the {}", other.items.len(), first.items.len()),
        None => format!("{} items, not the {} in the same order", other.items.len(), first.items.len()),
    }
}
