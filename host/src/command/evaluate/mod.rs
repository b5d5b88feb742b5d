//! `multiscopic evaluate`: the accuracy of methods on data sets with ground truth, and of rigs.

mod comparison;
mod method_table;
mod rig_metrics;
mod rig_options;
mod rigs;

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    Dataset, Error, Result,
    evaluation::{CameraSteps, DatasetScene, ResultRow, results},
    files::output,
    report::{Chart, Report, ViewedMap, ViewedScene},
};
use multiscopic_core::Views;
use serde::Serialize;

use self::{comparison::Comparison, method_table::MethodTable, rig_options::RigOptions};
use super::{
    charts::{self, Errors},
    options::{BaselineOptions, EngineOptions, GeometryOptions, MethodOptions, SearchOptions, named, output_file},
    preparation::PreparationOptions,
    terminal,
    variant::{Measured, Subject},
    view::{command_line, matched_map},
};

/// What the scenes of a page take at most, unless their disparities alone take more.
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
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Write a page with the tables and pictures, and for data sets with charts of the error over the number of views and over
    /// the baseline
    #[arg(long, value_name = "FILE.html", value_parser = output_file::html)]
    report: Option<PathBuf>,

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
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        match (self.dataset, &self.directories[..]) {
            (None, _) => {
                let scenes = (!self.scenes.is_empty()).then_some("--scenes");
                if let Some(option) = scenes.or(self.comparison.dataset_option()) {
                    return Err(Error::Usage(format!("{option} is for data sets: give --dataset as well")));
                }
                self.run_rigs()?;
            }
            (Some(dataset), [directory]) => self.run_dataset(dataset, directory)?,
            (Some(dataset), directories) => {
                let count = directories.len();
                return Err(Error::Usage(format!(
                    "--dataset {dataset} takes one folder, not {count}: choose scenes by --scenes"
                )));
            }
        }
        Ok(ExitCode::SUCCESS)
    }

    fn run_dataset(&self, dataset: Dataset, directory: &Path) -> Result<()> {
        let dataset = self.comparison.dataset(dataset)?;
        let variants = self.comparison.variants(dataset, &self.long_baselines)?;
        let options = self.options.clone().for_dataset(dataset);
        let methods = MethodTable::new(&variants, &options, self.search.block_size, &self.long_baselines)?;
        let scenes = self.selected_scenes(dataset, directory)?;
        let views = || variants.iter().map(|variant| variant.views);
        let files = |scene: &DatasetScene| -> Vec<PathBuf> {
            let images = views().flat_map(|views| scene.images(views).paths().map(PathBuf::from).collect::<Vec<_>>());
            images.chain([scene.truth()]).collect()
        };
        let inputs: Vec<PathBuf> = scenes.iter().flat_map(files).collect();
        output::check(&self.outputs(), &inputs.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
        let engine = self.engine.engine()?;

        // As many as fit a set, which is all but for large arrays at several baselines.
        let most: Views = views().flat_map(Views::iter).collect();
        let bar = terminal::progress((scenes.len() * variants.len()) as u64, "maps");
        let (mut records, mut curves) = (Vec::new(), Vec::new());
        let mut viewed = Vec::new();
        for scene in &scenes {
            bar.set_message(scene.name.clone());
            let (mut frames, center, truth) = scene.load(most)?;
            let mut seen = self.report.as_ref().map(|_| {
                ViewedScene::new(&*scene.name, frames.size())
                    .with_frames(&frames, Some(&center.to_rgb()))
                    .with_truth(Some(&truth))
            });
            let first = records.len();
            for variant in &variants {
                if !variant.views.iter().all(|view| frames.views().contains(view)) {
                    (frames, ..) = scene.load(variant.views)?;
                }
                let subject = Subject {
                    dataset: dataset.name(),
                    scene: &scene.name,
                    camera_steps: dataset.camera_steps(),
                    frames: &frames,
                    truth: &truth,
                };
                let search = self.search.search(frames.size(), variant.views, Some(variant.fusion), dataset.range())?;
                let method = methods.get(variant);
                let Measured { disparities, confidences, curve, record } = variant.measure(method, &engine, &subject, &search)?;
                curves.push(curve);
                records.push(record);
                let record = records.last().expect("it has just been added");
                if let Some(seen) = &mut seen {
                    let results = (&disparities, Some(&confidences));
                    let map = matched_map(record.variant(), (variant.method.name(), method), &search, results, record.seconds);
                    let costs = map.costs.filter(|_| dataset.camera_steps().is_none());
                    let (metrics, reduction) = (Some(record.metrics), record.reduction(&records[first..]));
                    seen.add(ViewedMap { metrics, reduction, costs, ..map });
                }
                bar.inc(1);
            }
            viewed.extend(seen);
        }
        bar.finish_and_clear();
        ViewedScene::fit(&mut viewed, PAGE_BYTES);

        let (rows, confidences) = (results::rows(&records), results::confidence_rows(&records));
        let report = self.report.as_ref().map(|_| {
            let baselines = match dataset.camera_steps() {
                None => "baselines".to_owned(),
                Some(CameraSteps::One) => "camera steps".into(),
                Some(steps) => format!("baselines of {steps} camera steps"),
            };
            let has_default_fusion = self.comparison.has_default_fusion();
            let errors = Errors { variants: &variants, records: &records, has_default_fusion, baselines: &baselines };
            let curves = charts::sparsification(&variants, &records, &curves);
            let charts: Vec<Chart> = errors.charts().into_iter().chain([curves]).collect();
            Self::page(dataset, &rows, &confidences, &charts, &viewed)
        });
        self.write(&records, report)?;
        let limit = terminal::columns();
        terminal::print(&format!("{}\n{}", results::to_text(&rows, limit), results::confidences_to_text(&confidences, limit)))
    }

    /// The files that are written.
    fn outputs(&self) -> Vec<&Path> {
        self.json.iter().chain(&self.report).map(PathBuf::as_path).collect()
    }

    /// Writes the results as JSON and the report, if they are asked for.
    fn write(&self, records: &[impl Serialize], report: Option<Report>) -> Result<()> {
        output::write_together(|| {
            if let Some(path) = &self.json {
                let json = serde_json::to_string_pretty(&records).expect("numbers and strings");
                output::write(path, |writer| writeln!(writer, "{json}"))?;
            }
            if let (Some(path), Some(report)) = (&self.report, report) {
                output::write(path, |writer| writer.write_all(report.to_html().as_bytes()))?;
            }
            Ok(())
        })
    }

    fn page(
        dataset: Dataset,
        rows: &[ResultRow],
        confidences: &[[String; 9]],
        charts: &[Chart],
        scenes: &[ViewedScene],
    ) -> Report {
        let page = Report::new(format!("Errors on {dataset}"))
            .viewer(&command_line(), scenes)
            .paragraph(
                "RMS and AvgErr are in pixels, with the change from stereo in brackets; the other columns are percentages.",
            )
            .table(ResultRow::HEADINGS, rows.iter().map(ResultRow::cells))
            .paragraph(
                "Confidences: AUC is the mean share of wrong pixels, those with an error above 1 pixel, as the least sure are taken \
                 away, and the optimum what is possible; ECE is by how much confidences differ from the share that is right; Bad1 is in \
                 percent of the surest.",
            )
            .table(results::CONFIDENCE_HEADINGS, confidences.iter().cloned());
        charts.iter().fold(page, Report::chart)
    }

    /// The scenes that `--scenes` selects.
    fn selected_scenes(&self, dataset: Dataset, directory: &Path) -> Result<Vec<DatasetScene>> {
        let mut scenes = dataset.scenes(directory)?;
        let names: Vec<&str> = scenes.iter().map(|scene| scene.name.as_str()).collect();
        if let Some(unknown) = self.scenes.iter().find(|name| !names.contains(&name.as_str())) {
            let (directory, names) = (directory.display(), names.join(", "));
            return Err(Error::Usage(format!("--scenes includes {unknown}, which is not in {directory}: choose from {names}")));
        }
        scenes.retain(|scene| self.scenes.is_empty() || self.scenes.contains(&scene.name));
        Ok(scenes)
    }
}
