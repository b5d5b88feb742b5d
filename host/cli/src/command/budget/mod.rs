//! `multiscopic budget`: the memory, instructions and time that matching takes on a microcontroller.

mod prediction;
mod target_options;

use std::process::ExitCode;

use clap::Args;
use multiscopic::{
    Error, Result,
    target::{Ram, ram::widest_tile},
};
use multiscopic_core::{Fusion, SemiGlobalCost, SemiGlobalParams};
use multiscopic_edge::{Matching, Profile, profile};

use super::{
    options::{SearchOptions, named, views_of_count},
    terminal,
};

pub use self::{prediction::Prediction, target_options::TargetOptions};

/// Predicts what matching takes on a microcontroller: RAM by buffer, instructions, time
///
/// Buffer sizes are exact: the firmware allocates exactly these statics. The other statics and the maximum stack
/// depth were measured.
///
/// Instructions come from a cost model fitted to measurements, within 10 % of the firmware in each profile. They
/// include sending packets, but not fetching lines. With --fusion mean and blocks of 13 or 15, high-contrast images
/// take up to a third more. They are not predicted for confidences (qvga-confidence), for --fusion half with three or
/// four views, and for --fusion mean with more than four.
///
/// Time depends on the average cycles per instruction. They come from Arm's manual (M4) and LLVM's models of the
/// processors (M7, M55), with memory that never waits: pass --cpi if you have measured your part. Arm publishes none for
/// the M33, which is taken to be as slow as an M4. There are no prices for RISC-V.
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

    /// Method: block matching, or semi-global matching with sums of absolute differences
    #[arg(long, value_name = "METHOD", value_parser = ["bm", "sgm"], default_value = "bm")]
    method: String,

    /// Fusion rule for the views' costs [default: min with one or two neighbours, heuristic with three or four, half with more]
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
const SET_BY_PROFILE: [&str; 8] =
    ["width", "height", "views", "tile_width", "method", "min_disparity", "num_disparities", "block_size"];

impl Budget {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let profile = profile::ALL.into_iter().find(|profile| Some(profile.name) == self.profile.as_deref());
        let matching = match profile {
            Some(profile) => self.profile_matching(&profile),
            None => self.custom_matching()?,
        };
        if self.target.fps.is_some() && self.target.core.instructions(&matching).is_none() {
            let message =
                "--fps cannot be checked: the instructions are not predicted for this match, see `multiscopic budget --help`";
            return Err(Error::Usage(message.into()));
        }
        let prediction = Prediction::new(&self.target, &matching, &Ram::new(&matching, self.target.core));
        terminal::print_report(&prediction, self.json)?;
        let failures = self.failures(&prediction, &matching);
        failures.iter().for_each(|failure| terminal::complain(failure));
        Ok(ExitCode::from(if failures.is_empty() { 0 } else { 1 }))
    }

    fn profile_matching(&self, profile: &Profile) -> Matching {
        let views = profile.matching(Fusion::Min).search().views().len();
        profile.matching(self.fusion.unwrap_or(Fusion::default_for(views)))
    }

    /// Returns the matching that is computed without a profile.
    fn custom_matching(&self) -> Result<Matching> {
        let size = [self.width, self.height].map(|side| usize::from(side.unwrap_or_default()));
        let views = views_of_count(self.views.unwrap_or(4))?;
        let params = self.search.params(self.search.search(size, views, self.fusion, SearchOptions::DEFAULT_RANGE)?)?;
        if self.method == "sgm" {
            if self.tile_width.is_some() {
                return Err(Error::Usage("--tile-width is for block matching: paths lead through the whole line".into()));
            }
            let cost = SemiGlobalCost::Sad { block_size: self.search.block_size.unwrap_or(SemiGlobalCost::DEFAULT_BLOCK_SIZE) };
            return Ok(Matching::SemiGlobal(SemiGlobalParams::new(*params.search(), cost)?));
        }
        let tile_width = self.tile_width.unwrap_or(params.width());
        if !(1..=params.width()).contains(&tile_width) {
            let message = format!("--tile-width is {tile_width}, it must be from 1 to the frame's width, {}", params.width());
            return Err(Error::Usage(message));
        }
        Ok(Matching::Blocks { params, tile_width })
    }

    /// A message for each requirement that is not met.
    fn failures(&self, prediction: &Prediction, matching: &Matching) -> Vec<String> {
        let mut failures = Vec::new();
        if let Some(limit) = self.target.ram.filter(|limit| prediction.ram_total > *limit) {
            let tile = match matching {
                Matching::Blocks { params, .. } => widest_tile(params, self.target.core, limit),
                Matching::SemiGlobal(_) | Matching::AroundPrior { .. } | Matching::WithConfidences(_) | Matching::Network(_) => {
                    None
                }
            };
            let tile = tile.filter(|&width| width < prediction.tile_width);
            let hint = tile.map(|width| format!("; narrower column tiles would fit: --tile-width {width}")).unwrap_or_default();
            let (total, excess) = (prediction.ram_total, prediction.ram_total - limit);
            failures.push(format!("RAM: {total} bytes exceed --ram {limit} by {excess}{hint}"));
        }
        if let (Some(limit), Some(fps)) = (self.target.fps, prediction.fps)
            && fps < limit
        {
            let factor = limit / fps;
            failures.push(format!(
                "time: {fps:.3} frames per second fall short of --fps {limit}; it must be {factor:.2} times as fast"
            ));
        }
        failures
    }
}
