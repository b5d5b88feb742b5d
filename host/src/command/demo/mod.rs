//! `multiscopic demo`: what additional views are good for, in pictures.

mod outcome;
mod results_folder;
mod results_page;
mod variants;

use std::{path::PathBuf, process::ExitCode};

use clap::{Args, value_parser};
use multiscopic::{
    Method, Result,
    evaluation::{Record, results},
    scene::{PinholeCamera, Scene, render},
    stereo::{CostFunction, Optimizer},
};
use multiscopic_core::{Params, Views};

use self::{outcome::Outcome, results_folder::ResultsFolder, results_page::ResultsPage, variants::VARIANTS};
use super::{
    options::{EngineOptions, SearchOptions},
    terminal,
    variant::Subject,
};

/// Renders five views of a scene with known depth, matches and evaluates them, and writes pictures and a page with the results
#[derive(Debug, Args)]
pub struct Demo {
    /// Folder for the results, created if missing
    #[arg(short, long, value_name = "DIR", default_value = "out/demo")]
    output: PathBuf,

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

/// The width to which the default number of disparities applies.
const DEFAULT_WIDTH: u32 = 640;

impl Demo {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let params = self.params()?;
        let engine = self.engine.engine()?;
        let folder = ResultsFolder::create(&self.output)?;

        let bar = terminal::progress(1 + VARIANTS.len() as u64, "steps");
        bar.set_message("rendering");
        let camera = PinholeCamera::new(self.width, self.height);
        let shot = render(&Scene::demo(), &camera, self.seed);
        bar.inc(1);
        let frames = shot.frames(Views::CROSS);
        let subject = Subject { dataset: "demo", scene: "demo", frames: &frames, truth: &shot.truth };
        bar.set_message("matching");
        let cost = CostFunction::Sad { block_size: self.search.block_size.unwrap_or(SearchOptions::DEFAULT_BLOCK_SIZE) };
        let method = Method::new(cost, None, Optimizer::WinnerTakesAll);
        let mut outcomes = Vec::new();
        for (variant, params) in VARIANTS.iter().zip(&params) {
            let (disparities, record) = variant.measure(&method, &engine, &subject, params.search())?;
            outcomes.push(Outcome { stem: variants::stem(variant), disparities, record });
            bar.inc(1);
        }
        bar.set_message("writing");
        let records: Vec<Record> = outcomes.iter().map(|outcome| outcome.record.clone()).collect();
        let rows = results::rows(&records);
        folder.write_capture(&shot, &camera, self.seed)?;
        folder.write_maps(&shot, &camera, &outcomes)?;
        let page = ResultsPage { commands: &self.commands(&params[0]), params: &params[0], records: &records, rows: &rows };
        let page_path = folder.write_page(&page.to_html())?;
        bar.finish_and_clear();

        terminal::print(&results::to_text(&rows))?;
        terminal::say(&format!("open {}", page_path.display()));
        Ok(ExitCode::SUCCESS)
    }

    /// The parameters of each variant.
    fn params(&self) -> Result<Vec<Params>> {
        let (min_disparity, num_disparities) = SearchOptions::DEFAULT_RANGE;
        // Disparities are proportional to the width.
        let num_disparities = (u32::from(num_disparities) * self.width).div_ceil(DEFAULT_WIDTH) as u16;
        let size = [self.width as usize, self.height as usize];
        VARIANTS
            .iter()
            .map(|variant| {
                let range = (min_disparity, num_disparities);
                self.search.params(self.search.search(size, variant.views, Some(variant.fusion), range)?)
            })
            .collect()
    }

    /// The commands that make the results again.
    fn commands(&self, params: &Params) -> String {
        let Demo { output, width, height, seed, .. } = self;
        let output = output.display();
        let search = format!(
            "--min-disparity {} --num-disparities {} --block-size {}",
            params.min_disparity(),
            params.num_disparities(),
            params.block_size()
        );
        format!(
            "multiscopic demo --width {width} --height {height} --seed {seed} {search} -o {output}\n\
             multiscopic match {output} {search} -o disparities.pfm --png disparities.png"
        )
    }
}
