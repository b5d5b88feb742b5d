//! `multiscopic evaluate`: the accuracy of methods on data sets with ground truth.

mod comparison;
mod gallery;

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    Dataset, Error, Method, Result,
    evaluation::{CameraSteps, DatasetScene, ResultRow, results},
    files::output,
    report::{Chart, Figure, Report, error_map},
};
use multiscopic_core::Views;

use self::{comparison::Comparison, gallery::Gallery};
use super::{
    charts::Errors,
    options::{BaselineOptions, EngineOptions, MethodOptions, SearchOptions, named},
    terminal,
    variant::{Subject, Variant},
};

/// Measures the errors of stereo and multiscopic matching on a data set with ground truth
#[derive(Debug, Args)]
pub struct Evaluate {
    /// Folder of the data set, of one of its scenes, or the parent of the data set's folder
    #[arg(value_name = "DIR")]
    directory: PathBuf,

    /// Data set
    #[arg(long, value_name = "NAME", value_parser = named::<Dataset>())]
    dataset: Dataset,

    /// Scenes [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    scenes: Vec<String>,

    #[command(flatten)]
    comparison: Comparison,

    /// Write the results as a JSON list
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Write a page with the table, charts of the error over the number of views and over the baseline, and pictures of every scene
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,

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
        let dataset = self.comparison.dataset(self.dataset)?;
        let variants = self.comparison.variants(dataset, &self.long_baselines)?;
        let options = self.options.clone().for_dataset(dataset);
        let long_baselines = self.long_baselines.long_baselines()?;
        // Penalties depend on the number of views.
        let key = |variant: &Variant| (variant.method, self.long_baselines.first(variant.views).len());
        let mut methods = Vec::new();
        for variant in &variants {
            if !methods.iter().any(|(other, _)| *other == key(variant)) {
                let (name, views) = key(variant);
                let method = options.method(name, self.search.block_size, views)?;
                methods.push(((name, views), Method { long_baselines, ..method }));
            }
        }
        let scenes = self.selected_scenes(dataset)?;
        let outputs: Vec<&Path> = self.json.iter().chain(&self.report).map(PathBuf::as_path).collect();
        let views = || variants.iter().map(|variant| variant.views);
        let files = |scene: &DatasetScene| -> Vec<PathBuf> {
            let images = views().flat_map(|views| scene.images(views).paths().map(PathBuf::from).collect::<Vec<_>>());
            images.chain([scene.truth()]).collect()
        };
        let inputs: Vec<PathBuf> = scenes.iter().flat_map(files).collect();
        output::check(&outputs, &inputs.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
        let engine = self.engine.engine()?;

        // As many as fit a set, which is all but for large arrays at several baselines.
        let most: Views = views().flat_map(Views::iter).collect();
        let bar = terminal::progress((scenes.len() * variants.len()) as u64, "maps");
        let mut records = Vec::new();
        let mut galleries = Vec::new();
        for scene in &scenes {
            bar.set_message(scene.name.clone());
            let (mut frames, center, truth) = scene.load(most)?;
            let mut gallery = self.report.as_ref().map(|_| Gallery::new(&center, truth.clone()));
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
                let (_, method) = methods.iter().find(|(other, _)| *other == key(variant)).expect("every variant has its method");
                let (disparities, record) = variant.measure(method, &engine, &subject, &search)?;
                if let Some(gallery) = &mut gallery {
                    gallery.add(&record.variant(), &disparities);
                }
                records.push(record);
                bar.inc(1);
            }
            galleries.extend(gallery.map(|gallery| (scene.name.as_str(), gallery.into_figures())));
        }
        bar.finish_and_clear();

        let rows = results::rows(&records);
        if let Some(path) = &self.json {
            let json = serde_json::to_string_pretty(&records).expect("numbers and strings");
            output::write(path, |writer| writeln!(writer, "{json}"))?;
        }
        if let Some(path) = &self.report {
            let baselines = match dataset.camera_steps() {
                None => "baselines".to_owned(),
                Some(CameraSteps::One) => "camera steps".into(),
                Some(steps) => format!("baselines of {steps} camera steps"),
            };
            let has_default_fusion = self.comparison.has_default_fusion();
            let errors = Errors { variants: &variants, records: &records, has_default_fusion, baselines: &baselines };
            let html = self.page(&rows, &errors.charts(), galleries).to_html();
            output::write(path, |writer| writer.write_all(html.as_bytes()))?;
        }
        terminal::print(&results::to_text(&rows))?;
        Ok(ExitCode::SUCCESS)
    }

    fn page<'a>(
        &self,
        rows: &[ResultRow],
        charts: &[Chart],
        galleries: impl IntoIterator<Item = (&'a str, Vec<Figure>)>,
    ) -> Report {
        let page = Report::new(format!("Errors on {}", self.dataset))
            .paragraph(
                "RMS and AvgErr are in pixels, with the change from stereo in brackets; the other columns are percentages.",
            )
            .table(ResultRow::HEADINGS, rows.iter().map(ResultRow::cells));
        let page = charts
            .iter()
            .fold(page, Report::chart)
            .paragraph(&format!("Disparities: red is near, blue is far, black is invalid. Errors: {}.", error_map::LEGEND));
        galleries.into_iter().fold(page, |page, (scene, figures)| page.gallery(scene, figures))
    }

    /// The scenes that `--scenes` selects.
    fn selected_scenes(&self, dataset: Dataset) -> Result<Vec<DatasetScene>> {
        let mut scenes = dataset.scenes(&self.directory)?;
        let names: Vec<&str> = scenes.iter().map(|scene| scene.name.as_str()).collect();
        if let Some(unknown) = self.scenes.iter().find(|name| !names.contains(&name.as_str())) {
            let (directory, names) = (self.directory.display(), names.join(", "));
            return Err(Error::Usage(format!("--scenes includes {unknown}, which is not in {directory}: choose from {names}")));
        }
        scenes.retain(|scene| self.scenes.is_empty() || self.scenes.contains(&scene.name));
        Ok(scenes)
    }
}
