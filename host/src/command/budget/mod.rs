//! `multiscopic budget`: the memory, instructions and time that matching takes on a microcontroller.

mod prediction;
mod target_options;

use std::process::ExitCode;

use clap::Args;
use multiscopic::{
    Error, Result,
    target::{Ram, ram::widest_tile},
};
use multiscopic_core::{Fusion, Params};
use multiscopic_edge::{Profile, profile};

use self::{prediction::Prediction, target_options::TargetOptions};
use super::{
    options::{SearchOptions, named, views_of_count},
    terminal,
};

/// Predicts what matching takes on a microcontroller: RAM by buffer, instructions, time
///
/// Buffer sizes are exact: the firmware allocates exactly these statics. The other statics and the maximum stack
/// depth were measured.
///
/// Instructions come from a cost model fitted to measurements, within 10 % of the firmware in each profile. They
/// include sending packets, but not fetching lines. With --fusion mean and blocks of 13 or 15, high-contrast images
/// take up to a third more.
///
/// Time depends on the average cycles per instruction, which are assumed: pass --cpi if you have measured them.
///
/// Exit code 1 if --ram or --fps is not met.
#[derive(Clone, Debug, Args)]
pub struct Budget {
    /// Firmware profile
    #[arg(long, value_name = "NAME", conflicts_with_all = SET_BY_PROFILE,
        value_parser = profile::ALL.map(|profile| profile.name))]
    profile: Option<String>,

    /// Frame width in pixels
    #[arg(long, value_name = "N", required_unless_present = "profile")]
    width: Option<u16>,

    /// Frame height in pixels
    #[arg(long, value_name = "N", required_unless_present = "profile")]
    height: Option<u16>,

    /// Neighbours: right (1), left and right (2), top as well (3), or all (4) [default: 4]
    #[arg(long, value_name = "1|2|3|4")]
    views: Option<usize>,

    /// Width of column tiles in pixels; narrower tiles take less RAM and more time [default: the frame's width]
    #[arg(long, value_name = "N")]
    tile_width: Option<usize>,

    /// Fusion rule for the views' costs [default: min with one or two neighbours, heuristic with more]
    #[arg(long, value_parser = named::<Fusion>())]
    fusion: Option<Fusion>,

    #[command(flatten)]
    search: SearchOptions,

    #[command(flatten)]
    target: TargetOptions,

    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// The options that a profile sets.
const SET_BY_PROFILE: [&str; 7] = ["width", "height", "views", "tile_width", "min_disparity", "num_disparities", "block_size"];

impl Budget {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let profile = profile::ALL.into_iter().find(|profile| Some(profile.name) == self.profile.as_deref());
        let (params, tile_width) = match profile {
            Some(profile) => (self.profile_params(&profile), profile.tile_width()),
            None => self.custom_params()?,
        };
        let processor = self.target.core;
        let ram = Ram::new(&params, tile_width, processor);
        let prediction = Prediction::new(&self.target, &params, tile_width, &ram);
        terminal::print_report(&prediction, self.json)?;
        let failures = self.failures(&prediction, &params);
        failures.iter().for_each(|failure| terminal::say(failure));
        Ok(ExitCode::from(if failures.is_empty() { 0 } else { 1 }))
    }

    fn profile_params(&self, profile: &Profile) -> Params {
        let views = profile.params(Fusion::Min).views().len();
        profile.params(self.fusion.unwrap_or(Fusion::default_for(views)))
    }

    /// The parameters without a profile, and the tile width.
    fn custom_params(&self) -> Result<(Params, usize)> {
        let size = [self.width, self.height].map(|side| usize::from(side.unwrap_or_default()));
        let views = views_of_count(self.views.unwrap_or(4))?;
        let params = self.search.params(size, views, self.fusion, SearchOptions::DEFAULT_RANGE)?;
        let tile_width = self.tile_width.unwrap_or(params.width());
        if !(1..=params.width()).contains(&tile_width) {
            let message = format!("--tile-width is {tile_width}, it must be from 1 to the frame's width, {}", params.width());
            return Err(Error::Usage(message));
        }
        Ok((params, tile_width))
    }

    /// A message for each requirement that is not met.
    fn failures(&self, prediction: &Prediction, params: &Params) -> Vec<String> {
        let mut failures = Vec::new();
        if let Some(limit) = self.target.ram.filter(|limit| prediction.ram_total > *limit) {
            let hint = match widest_tile(params, self.target.core, limit) {
                Some(width) if width < prediction.tile_width => {
                    format!("; narrower column tiles would fit: --tile-width {width}")
                }
                _ => String::new(),
            };
            let (total, excess) = (prediction.ram_total, prediction.ram_total - limit);
            failures.push(format!("RAM: {total} bytes exceed --ram {limit} by {excess}{hint}"));
        }
        if let Some(limit) = self.target.fps.filter(|limit| prediction.fps < *limit) {
            let (fps, factor) = (prediction.fps, limit / prediction.fps);
            failures.push(format!(
                "time: {fps:.3} frames per second fall short of --fps {limit}; it must be {factor:.2} times as fast"
            ));
        }
        failures
    }
}
