//! `multiscopic evaluate`: how accurate methods are on data sets with ground truth.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use clap::{
    Args,
    builder::{PossibleValuesParser, TypedValueParser},
};
use multiscopic::{
    Dataset, Error, Metrics, Result,
    dataset::Scene,
    evaluation::{self, Record},
    output,
};
use multiscopic_core::{Fusion, Views};

use super::{
    options::{EngineOptions, FusionName, MethodName, SearchOptions, views_of_count},
    terminal,
};

/// Measures the errors of stereo and multiscopic matching on a data set with ground truth
#[derive(Debug, Args)]
pub struct Evaluate {
    /// Folder of the data set, of one of its scenes, or the one that the data set's folder is in
    #[arg(value_name = "DIR")]
    directory: PathBuf,

    /// Data set
    #[arg(long, value_name = "NAME",
        value_parser = PossibleValuesParser::new(Dataset::ALL.map(Dataset::name)).try_map(|name| name.parse::<Dataset>()))]
    dataset: Dataset,

    /// Scenes [default: all]
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    scenes: Vec<String>,

    /// Numbers of neighbours: 1 (stereo), 2 or 4 [default: 1 and the most that the data set has]
    #[arg(long, value_name = "1,2,4", value_delimiter = ',')]
    views: Vec<usize>,

    /// List of the results in JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Methods
    #[arg(long, value_enum, value_delimiter = ',', default_value = "bm", help_heading = "Matching")]
    methods: Vec<MethodName>,

    /// Fusions of the views' costs [default: min with one or two neighbours, heuristic with more]
    #[arg(long, value_enum, value_delimiter = ',', help_heading = "Matching")]
    fusion: Vec<FusionName>,

    #[command(flatten)]
    search: SearchOptions,

    #[command(flatten)]
    engine: EngineOptions,
}

/// A variant of matching.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Variant {
    method: MethodName,
    views: Views,
    fusion: FusionName,
}

impl Evaluate {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let variants = self.variants()?;
        let scenes = self.chosen_scenes()?;
        let outputs: Vec<&Path> = self.json.iter().map(PathBuf::as_path).collect();
        let inputs: Vec<&Path> = scenes.iter().flat_map(|scene| scene.images.paths().chain([scene.truth.as_path()])).collect();
        output::check(&outputs, &inputs)?;
        let engine = self.engine.engine()?;

        let bar = terminal::progress((scenes.len() * variants.len()) as u64, "maps");
        let mut records = Vec::new();
        for scene in &scenes {
            bar.set_message(scene.name.clone());
            let (frames, _, truth) = scene.load()?;
            for &Variant { method, views, fusion } in &variants {
                let params = self.search.params(&frames, views, Some(fusion), self.dataset.range())?;
                let start = Instant::now();
                let disparities = method.disparities(&engine, &frames, &params, || ());
                let seconds = start.elapsed().as_secs_f64();
                records.push(Record {
                    dataset: self.dataset.to_string(),
                    scene: scene.name.clone(),
                    method: method.name(),
                    views: views.len(),
                    fusion: fusion.name(),
                    metrics: Metrics::new(&disparities, &truth).expect("a scene that is loaded has some truth"),
                    seconds,
                });
                bar.inc(1);
            }
        }
        bar.finish_and_clear();

        if let Some(path) = &self.json {
            let json = serde_json::to_string_pretty(&records).expect("numbers and strings");
            output::write(path, |writer| writeln!(writer, "{json}"))?;
        }
        terminal::print(&evaluation::text(&evaluation::rows(&records)))?;
        Ok(ExitCode::SUCCESS)
    }

    /// Every method with every number of views, stereo first, and every fusion of several views.
    fn variants(&self) -> Result<Vec<Variant>> {
        let available = self.dataset.views();
        let mut counts = if self.views.is_empty() { vec![1, available.len()] } else { self.views.clone() };
        counts.sort_unstable();
        let mut variants = Vec::new();
        for &method in &self.methods {
            for &count in &counts {
                let views = views_of_count(count)?;
                if views.len() > available.len() {
                    let (dataset, most) = (self.dataset, available.len());
                    return Err(Error::Usage(format!("--views is {count}, a scene of {dataset} has {most} neighbours at most")));
                }
                let fusions = match (&self.fusion[..], count) {
                    ([], _) => vec![Fusion::default_for(count).into()],
                    // One cost is the same by every rule.
                    ([first, ..], 1) => vec![*first],
                    (fusions, _) => fusions.to_vec(),
                };
                for fusion in fusions {
                    let variant = Variant { method, views, fusion };
                    if !variants.contains(&variant) {
                        variants.push(variant);
                    }
                }
            }
        }
        Ok(variants)
    }

    /// The scenes that were asked for.
    fn chosen_scenes(&self) -> Result<Vec<Scene>> {
        let mut scenes = self.dataset.scenes(&self.directory)?;
        let names: Vec<&str> = scenes.iter().map(|scene| scene.name.as_str()).collect();
        if let Some(unknown) = self.scenes.iter().find(|name| !names.contains(&name.as_str())) {
            let (directory, names) = (self.directory.display(), names.join(", "));
            return Err(Error::Usage(format!("--scenes has {unknown}, {directory} has {names}")));
        }
        scenes.retain(|scene| self.scenes.is_empty() || self.scenes.contains(&scene.name));
        Ok(scenes)
    }
}
