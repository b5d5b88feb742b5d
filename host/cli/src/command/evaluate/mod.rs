//! `multiscopic evaluate`: the accuracy of methods on data sets with ground truth, and of rigs.

mod comparison;
mod data_set;
mod rig_metrics;
mod rig_options;
mod rigs;

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{Dataset, Error, Result, files::output};
use serde::Serialize;

pub use self::data_set::SceneRecord;
use self::{comparison::Comparison, rig_options::RigOptions};
use super::{
    batch::{BatchOptions, RunSettings},
    options::{
        BaselineOptions, EngineOptions, GeometryOptions, MethodOptions, PreparationOptions, SearchOptions, named, output_file,
    },
    terminal,
};
use crate::{
    report::Report,
    results::{self, Record},
};

/// The most bytes that the scenes of a page take, unless their disparities alone take more.
const PAGE_BYTES: usize = 16_000_000;

/// Measures how good matching is on a data set with ground truth, or how good a rig is
///
/// A captured folder is compared with the truth, if it is known, and with a plane, if the scene is a flat wall (--plane). Several
/// captures of the same scene by the same rig show its noise.
#[derive(Debug, Args)]
pub struct Evaluate {
    /// Captured folder with a rig.toml, or several of the same scene; with --dataset, the folder of the data set, of one of its
    /// scenes, or the parent of the data set's folder
    #[arg(value_name = "DIR", required = true)]
    directories: Vec<PathBuf>,

    /// Data set
    #[arg(
        long,
        value_name = "NAME",
        value_parser = named::<Dataset>(),
        conflicts_with_all = ["PreparationOptions", "GeometryOptions"]
    )]
    dataset: Option<Dataset>,

    /// Scenes of the data set [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    scenes: Vec<String>,

    #[command(flatten)]
    comparison: Comparison,

    /// Write the results as a JSON list
    #[arg(long, value_name = "FILE", conflicts_with = "results")]
    json: Option<PathBuf>,

    /// Write a page with the tables and pictures, and for data sets with charts of the error over the number of views and over
    /// the baseline
    #[arg(long, value_name = "FILE.html", value_parser = output_file::html, conflicts_with = "results")]
    report: Option<PathBuf>,

    #[command(flatten)]
    batch: BatchOptions,

    #[command(flatten)]
    rig: RigOptions,

    #[command(flatten)]
    geometry: GeometryOptions,

    #[command(flatten)]
    preparation: PreparationOptions,

    #[command(flatten)]
    search: SearchOptions,

    #[command(flatten)]
    options: MethodOptions,

    #[command(flatten)]
    long_baselines: BaselineOptions,

    #[command(flatten)]
    engine: EngineOptions,
}

impl Evaluate {
    /// Runs the command, with these settings for the scenes of a data set.
    pub fn run(&self, settings: &RunSettings) -> Result<ExitCode> {
        match (self.dataset, &self.directories[..]) {
            (None, _) => {
                let scenes = (!self.scenes.is_empty()).then_some("--scenes");
                // Captures of one scene are compared with each other, which one machine does.
                let results = self.batch.is_given().then_some("--results");
                if let Some(option) = scenes.or(results).or(self.comparison.dataset_option()) {
                    return Err(Error::Usage(format!("{option} is for data sets: give --dataset as well")));
                }
                self.run_rigs()?;
                Ok(ExitCode::SUCCESS)
            }
            (Some(dataset), [directory]) => self.run_dataset(dataset, directory, settings),
            (Some(dataset), directories) => {
                let count = directories.len();
                Err(Error::Usage(format!("--dataset {dataset} takes one folder, not {count}: choose scenes by --scenes")))
            }
        }
    }

    /// The files that are written.
    fn outputs(&self) -> Vec<&Path> {
        self.json.iter().chain(&self.report).map(PathBuf::as_path).collect()
    }

    /// Writes the results as JSON and the report, if they are asked for.
    fn write(&self, records: &[impl Serialize], report: Option<Report>) -> Result<()> {
        output::write_together(|| {
            if let Some(path) = &self.json {
                write_json(records, path)?;
            }
            if let (Some(path), Some(report)) = (&self.report, report) {
                output::write(path, |writer| writer.write_all(report.to_html().as_bytes()))?;
            }
            Ok(())
        })
    }
}

/// Writes results as a JSON list.
pub fn write_json(records: &[impl Serialize], path: &Path) -> Result<()> {
    let json = serde_json::to_string_pretty(records).expect("numbers and strings");
    output::write(path, |writer| writeln!(writer, "{json}"))
}

/// Prints the tables of results on a data set.
pub fn print_tables(records: &[Record]) -> Result<()> {
    let (rows, confidences) = (results::rows(records), results::confidence_rows(records));
    let limit = terminal::columns();
    terminal::print(&format!("{}\n{}", results::to_text(&rows, limit), results::confidences_to_text(&confidences, limit)))
}
