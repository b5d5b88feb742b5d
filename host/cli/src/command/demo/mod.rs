//! `multiscopic demo`: what additional views are good for, in pictures.

mod results_folder;
mod variants;

use std::{path::PathBuf, process::ExitCode};

use clap::{Args, value_parser};
use multiscopic::{
    Frames, Method, Result,
    images::Layout,
    scene::{PinholeCamera, Scene, Shot, render_views},
};
use multiscopic_core::{BlockMatchingParams, SearchSpace, Views};

use self::{
    results_folder::{Outcome, ResultsFolder, ResultsPage},
    variants::variants,
};
use super::{
    options::{EngineOptions, SearchOptions},
    terminal,
    variant::{Errors, Measured, Subject, Variant},
    view::matched_map,
};
use crate::{
    report::{ViewedMap, ViewedScene},
    results::{self, Record},
};

/// Renders views of a scene with known depth, matches and evaluates them, and writes pictures and a page with the results
#[derive(Debug, Args)]
pub struct Demo {
    /// Folder for the results, created if missing
    #[arg(short, long, value_name = "DIR", default_value = "out/demo")]
    output: PathBuf,

    /// Layout of the neighbours: cross, or rows and columns of an array such as 3x3
    #[arg(long, value_name = "cross|RxC", default_value_t = Layout::CROSS)]
    layout: Layout,

    /// Longer baselines at which the layout is rendered besides, such as 1,3,5; a cross or a row is matched from short to long
    #[arg(long, value_name = "1,3,5", value_delimiter = ',')]
    baselines: Vec<u8>,

    /// Width of the views in pixels
    #[arg(long, value_name = "N", default_value_t = DEFAULT_WIDTH, value_parser = value_parser!(u32).range(16..=4096))]
    width: u32,

    /// Height of the views in pixels
    #[arg(long, value_name = "N", default_value_t = 480, value_parser = value_parser!(u32).range(16..=4096))]
    height: u32,

    /// Seed of the sensor noise and of the stage's position errors
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    #[command(flatten)]
    search: SearchOptions,

    #[command(flatten)]
    engine: EngineOptions,
}

/// Returns the maps and pictures to look at: the variants with their default rule, the capture and the truth.
fn scene(shot: &Shot, camera: &PinholeCamera, frames: &Frames, outcomes: &[Outcome]) -> ViewedScene {
    let size = frames.size();
    let records: Vec<Record> = outcomes.iter().map(|outcome| outcome.record.clone()).collect();
    let geometry = super::scene::rig(camera, frames.views(), String::new()).geometry(size);
    let mut scene = ViewedScene::new("demo", size)
        .with_geometry(geometry.as_ref())
        .with_frames(frames, Some(&shot.center))
        .with_truth(Some(&shot.truth));
    for Outcome { variant, method, search, disparities, confidences, record } in outcomes {
        if variants::is_default(variant) {
            let results = (disparities, Some(confidences));
            let map = matched_map(variants::label(variant), (variant.method.name(), method), search, results, record.seconds);
            let (metrics, reduction) = (Some(record.metrics), record.reduction(&records));
            scene.add(ViewedMap { metrics, reduction, file: Some(results_folder::map_pfm(&variants::stem(variant))), ..map });
        }
    }
    scene
}

/// The width to which the default number of disparities applies.
const DEFAULT_WIDTH: u32 = 640;

impl Demo {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let variants = variants(self.layout, &self.baselines)?;
        let searches = self.searches(&variants)?;
        let params = self.search.params(searches[0])?;
        let engine = self.engine.engine()?;
        let views: Views = variants.iter().flat_map(|variant| variant.views.iter()).collect();
        let others = variants::other_methods(self.layout);
        let all: Vec<Variant> = variants.iter().chain(&others).copied().collect();
        let folder = ResultsFolder::check(&self.output, views, &all)?;

        let bar = terminal::progress(1 + all.len() as u64, "steps");
        bar.set_message("rendering");
        let camera = PinholeCamera::new(self.width, self.height);
        let shot = render_views(&Scene::demo(), &camera, views, self.seed);
        bar.inc(1);
        let frames = shot.color_frames();
        let subject = Subject { dataset: "demo", scene: "demo", camera_steps: None, frames: &frames, truth: &shot.truth };
        bar.set_message("matching");
        let mut outcomes = Vec::new();
        for (variant, search) in all.into_iter().zip(searches.into_iter().chain(self.searches(&others)?)) {
            let method = self.method(&variant)?;
            let gray = (!method.needs_color()).then(|| frames.clone().without_color());
            let subject = Subject { frames: gray.as_ref().unwrap_or(&frames), ..subject };
            let Measured { disparities, confidences, record, .. } = variant.measure(&method, &engine, &subject, &search)?;
            outcomes.push(Outcome { variant, method, search, disparities, confidences, record });
            bar.inc(1);
        }
        bar.set_message("writing");
        let records: Vec<Record> = outcomes.iter().map(|outcome| outcome.record.clone()).collect();
        let rows = results::rows(&records);
        let errors = Errors {
            variants: &variants,
            records: &records[..variants.len()],
            has_default_fusion: false,
            baselines: "baselines",
        };
        let scene = scene(&shot, &camera, &frames, &outcomes);
        let commands = self.commands(&params);
        let page = ResultsPage {
            commands: &commands,
            views,
            errors: &errors,
            params: &params,
            rows: &rows,
            scene: &scene,
            best: records.iter().min_by(|a, b| a.metrics.avg_err.total_cmp(&b.metrics.avg_err)).expect("several variants"),
            others: &others,
        };
        let page_path = folder.write(|folder| {
            folder.write_capture(&shot, &camera, self.seed)?;
            folder.write_maps(&shot, &camera, &outcomes, variants.len())?;
            folder.write_charts(&errors)?;
            folder.write_page(&page.to_html())
        })?;
        bar.finish_and_clear();

        terminal::print(&results::to_text(&rows, terminal::columns()))?;
        terminal::say(&format!("open {}", page_path.display()));
        Ok(ExitCode::SUCCESS)
    }

    /// The method of a variant, with its default parameters.
    fn method(&self, variant: &Variant) -> Result<Method> {
        variant.method.method(self.search.block_size, variant.views.len())
    }

    /// The search of each variant.
    fn searches(&self, variants: &[Variant]) -> Result<Vec<SearchSpace>> {
        let (min_disparity, num_disparities) = SearchOptions::DEFAULT_RANGE;
        // Disparities are proportional to the width.
        let num_disparities = (u32::from(num_disparities) * self.width).div_ceil(DEFAULT_WIDTH) as u16;
        let size = [self.width as usize, self.height as usize];
        let range = (min_disparity, num_disparities);
        variants.iter().map(|variant| self.search.search(size, variant.views, Some(variant.fusion), range)).collect()
    }

    /// The commands that make the results again.
    fn commands(&self, params: &BlockMatchingParams) -> String {
        let Demo { output, width, height, seed, .. } = self;
        let output = output.display();
        let mut layout = String::new();
        if self.layout != Layout::CROSS {
            layout = format!(" --layout {}", self.layout);
        }
        if !self.baselines.is_empty() {
            let baselines: Vec<String> = self.baselines.iter().map(u8::to_string).collect();
            layout += &format!(" --baselines {}", baselines.join(","));
        }
        let search = format!(
            "--min-disparity {} --num-disparities {} --block-size {}",
            params.min_disparity(),
            params.num_disparities(),
            params.block_size()
        );
        format!(
            "multiscopic demo{layout} --width {width} --height {height} --seed {seed} {search} -o {output}\n\
             multiscopic match {output} {search} -o disparities.pfm --png disparities.png"
        )
    }
}
