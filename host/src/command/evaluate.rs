//! `multiscopic evaluate`: the accuracy of methods on data sets with ground truth.

use std::{
    iter,
    ops::RangeInclusive,
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    Dataset, DisparityMap, Error, FloatImage, Method, Picture, Result,
    evaluation::{DatasetScene, ResultRow, results},
    files::output,
    report::{Figure, Report, error_map},
};
use multiscopic_core::{Fusion, Views};

use super::{
    options::{BaselineOptions, EngineOptions, MethodName, MethodOptions, SearchOptions, named, views_of_count},
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

    /// Numbers of neighbours: 1 (stereo), 2, 4, or 8 for all of a 3x3 array [default: 1 and 2 or 4, as the data set has]
    #[arg(long, value_name = "1,2,4,8", value_delimiter = ',')]
    views: Vec<usize>,

    /// Baselines that are matched from short to long besides, such as 3,5: for each number of neighbours also with the views
    /// in the centre's row and column that the data set has at these multiples
    #[arg(long, value_name = "3,5", value_delimiter = ',')]
    baselines: Vec<u8>,

    /// Write the results as a JSON list
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Write a page with the table and with pictures of every scene
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,

    /// Methods
    #[arg(long, value_parser = named::<MethodName>(), value_delimiter = ',', default_value = "bm", help_heading = "Matching")]
    methods: Vec<MethodName>,

    /// Fusion rules for the views' costs [default: min with one or two neighbours, heuristic with three or four, half with more]
    #[arg(long, value_parser = named::<Fusion>(), value_delimiter = ',', help_heading = "Matching")]
    fusion: Vec<Fusion>,

    #[command(flatten)]
    search: SearchOptions,

    #[command(flatten)]
    options: MethodOptions,

    #[command(flatten)]
    long_baselines: BaselineOptions,

    #[command(flatten)]
    engine: EngineOptions,
}

/// The pictures of a scene on the page.
struct Gallery<'a> {
    truth: &'a FloatImage,
    /// All maps of a scene share the colour scale of its truth.
    range: Option<RangeInclusive<f32>>,
    figures: Vec<Figure>,
}

impl Gallery<'_> {
    fn new<'a>(center: &Picture, truth: &'a FloatImage) -> Gallery<'a> {
        let map = DisparityMap::from_float(truth);
        let range = map.range();
        let figures =
            vec![Figure::embedded("centre", center.to_rgb()), Figure::embedded("true disparities", map.to_color(range.clone()))];
        Gallery { truth, range, figures }
    }

    /// Adds the disparities and the error map of a variant.
    fn add(&mut self, variant: &str, disparities: &DisparityMap) {
        let estimates = disparities.pixels().iter().map(|d| d.map(f32::from));
        let errors = error_map::draw(estimates, self.truth);
        self.figures.push(Figure::embedded(variant, disparities.to_color(self.range.clone())));
        self.figures.push(Figure::embedded(format!("errors of {variant}"), errors));
    }
}

impl Evaluate {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let variants = self.variants()?;
        let options = self.options.clone().for_dataset(self.dataset);
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
        let scenes = self.selected_scenes()?;
        let outputs: Vec<&Path> = self.json.iter().chain(&self.report).map(PathBuf::as_path).collect();
        let inputs: Vec<&Path> = scenes.iter().flat_map(|scene| scene.images.paths().chain([scene.truth.as_path()])).collect();
        output::check(&outputs, &inputs)?;
        let engine = self.engine.engine()?;

        let most = variants.iter().flat_map(|variant| variant.views.iter()).collect();
        let bar = terminal::progress((scenes.len() * variants.len()) as u64, "maps");
        let mut records = Vec::new();
        let mut galleries = Vec::new();
        for scene in &scenes {
            bar.set_message(scene.name.clone());
            let (frames, center, truth) = scene.load(most)?;
            let mut gallery = self.report.as_ref().map(|_| Gallery::new(&center, &truth));
            let subject = Subject { dataset: scene.dataset.name(), scene: &scene.name, frames: &frames, truth: &truth };
            for variant in &variants {
                let search = self.search.search(frames.size(), variant.views, Some(variant.fusion), self.dataset.range())?;
                let (_, method) = methods.iter().find(|(other, _)| *other == key(variant)).expect("every variant has its method");
                let (disparities, record) = variant.measure(method, &engine, &subject, &search)?;
                if let Some(gallery) = &mut gallery {
                    gallery.add(&record.variant(), &disparities);
                }
                records.push(record);
                bar.inc(1);
            }
            galleries.extend(gallery.map(|gallery| (scene.name.as_str(), gallery.figures)));
        }
        bar.finish_and_clear();

        let rows = results::rows(&records);
        if let Some(path) = &self.json {
            let json = serde_json::to_string_pretty(&records).expect("numbers and strings");
            output::write(path, |writer| writeln!(writer, "{json}"))?;
        }
        if let Some(path) = &self.report {
            let html = self.page(&rows, galleries).to_html();
            output::write(path, |writer| writer.write_all(html.as_bytes()))?;
        }
        terminal::print(&results::to_text(&rows))?;
        Ok(ExitCode::SUCCESS)
    }

    fn page<'a>(&self, rows: &[ResultRow], galleries: impl IntoIterator<Item = (&'a str, Vec<Figure>)>) -> Report {
        let page = Report::new(format!("Errors on {}", self.dataset))
            .paragraph(
                "RMS and AvgErr are in pixels, with the change from stereo in brackets; the other columns are percentages.",
            )
            .table(ResultRow::HEADINGS, rows.iter().map(ResultRow::cells))
            .paragraph(&format!("Disparities: red is near, blue is far, black is invalid. Errors: {}.", error_map::LEGEND));
        galleries.into_iter().fold(page, |page, (scene, figures)| page.gallery(scene, figures))
    }

    /// Every method with every number of views, stereo first, and every fusion rule where there are several views.
    fn variants(&self) -> Result<Vec<Variant>> {
        let available = self.dataset.all_views();
        let nearest = self.dataset.views().len();
        let mut counts = if self.views.is_empty() { vec![1, nearest] } else { self.views.clone() };
        counts.sort_unstable();
        let mut variants = Vec::new();
        for &method in &self.methods {
            for &count in &counts {
                let views = views_of_count(count)?;
                if !is_available(views, available) {
                    let dataset = self.dataset;
                    let has = |count: &usize| views_of_count(*count).is_ok_and(|views| is_available(views, available));
                    let most = [8, 4, 2, 1].into_iter().find(has).unwrap_or_default();
                    return Err(Error::Usage(format!(
                        "--views includes {count}, but {dataset} has only {most} neighbours: use 1 or {most}"
                    )));
                }
                let fusions = match (&self.fusion[..], count) {
                    ([], _) => vec![Fusion::default_for(count)],
                    // All rules agree on a single cost.
                    ([first, ..], 1) => vec![*first],
                    (fusions, _) => fusions.to_vec(),
                };
                let at_baselines = |multiples: &[u8]| {
                    let longer = available.iter().filter(|view| view.is_horizontal() || view.is_vertical());
                    views.iter().chain(longer.filter(|view| multiples.contains(&view.multiple()))).collect::<Views>()
                };
                let longer = (1..=self.baselines.len()).map(|count| at_baselines(&self.baselines[..count]));
                for views in iter::once(views).chain(longer) {
                    for &fusion in &fusions {
                        let variant = Variant { method, views, fusion };
                        if !variants.contains(&variant) {
                            variants.push(variant);
                        }
                    }
                }
            }
        }
        Ok(variants)
    }

    /// The scenes that `--scenes` selects.
    fn selected_scenes(&self) -> Result<Vec<DatasetScene>> {
        let mut scenes = self.dataset.scenes(&self.directory)?;
        let names: Vec<&str> = scenes.iter().map(|scene| scene.name.as_str()).collect();
        if let Some(unknown) = self.scenes.iter().find(|name| !names.contains(&name.as_str())) {
            let (directory, names) = (self.directory.display(), names.join(", "));
            return Err(Error::Usage(format!("--scenes includes {unknown}, which is not in {directory}: choose from {names}")));
        }
        scenes.retain(|scene| self.scenes.is_empty() || self.scenes.contains(&scene.name));
        Ok(scenes)
    }
}

/// Whether a data set with the views `available` has `views`.
fn is_available(views: Views, available: Views) -> bool {
    views.iter().all(|view| available.contains(view))
}
