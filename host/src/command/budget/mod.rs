//! `multiscopic budget`: what a match takes on a microcontroller.

use std::{collections::BTreeMap, fmt, process::ExitCode};

use clap::Args;
use multiscopic::{
    Error, Processor, Result,
    target::{Buffer, Ram, ram::widest_tile},
};
use multiscopic_core::{Fusion, Params, Region};
use multiscopic_edge::{Profile, profile};
use serde::Serialize;

use super::{
    options::{SearchOptions, named, value::positive, views_of_count},
    terminal,
};

/// Says what a match takes on a microcontroller: RAM by buffer, instructions, time
///
/// RAM of the buffers is exact: the firmware's statics have these sizes. The rest of the statics and the greatest stack were
/// measured. Instructions are those of a cost model that was fitted to measurements, within 10 % of the firmware of each profile; they include
/// sending packets, but not fetching lines; with the mean of blocks of 13 and 15, images of great contrast take up to a third more. Time takes an assumption, the cycles per instruction: give --cpi if you have measured them.
///
/// Exit code 1 if --ram or --fps is not met.
#[derive(Clone, Debug, Args)]
pub struct Budget {
    /// Profile of the firmware
    #[arg(long, value_name = "NAME", value_parser = profile::ALL.map(|profile| profile.name), conflicts_with_all = OWN)]
    profile: Option<String>,

    /// Frame width in pixels
    #[arg(long, value_name = "N", required_unless_present = "profile")]
    width: Option<u16>,

    /// Frame height in pixels
    #[arg(long, value_name = "N", required_unless_present = "profile")]
    height: Option<u16>,

    /// Neighbours: 1 (right), 2 (left and right) or 4 [default: 4]
    #[arg(long, value_name = "1|2|3|4")]
    views: Option<usize>,

    /// Columns matched at a time; narrower tiles take less RAM and more time [default: the frame's width]
    #[arg(long, value_name = "N")]
    tile_width: Option<usize>,

    /// Fusion of the views' costs [default: min with one or two neighbours, heuristic with more]
    #[arg(long, value_parser = named::<Fusion>())]
    fusion: Option<Fusion>,

    #[command(flatten)]
    search: SearchOptions,

    #[command(flatten)]
    target: Target,

    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// The options that a profile decides.
const OWN: [&str; 7] = ["width", "height", "views", "tile_width", "min_disparity", "num_disparities", "block_size"];

/// What the match runs on, and what it must do there.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Target")]
struct Target {
    /// Processor
    #[arg(long, value_parser = named::<Processor>(), default_value = "cortex-m4")]
    core: Processor,

    /// Clock in MHz [default: 64, 480 or 32, those of nRF52840, STM32H743 and Arm's AN547]
    #[arg(long, value_name = "MHZ", value_parser = positive, allow_negative_numbers = true)]
    clock: Option<f64>,

    /// Cycles per instruction on average [default: 1.4, 0.8 or 1.5, assumed for memory without wait states]
    #[arg(long, value_name = "X", value_parser = positive, allow_negative_numbers = true)]
    cpi: Option<f64>,

    /// RAM that there is, as 144KiB or in bytes: exit code 1 if the match takes more
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    ram: Option<usize>,

    /// Frames per second that are wanted: exit code 1 if there are fewer
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true)]
    fps: Option<f64>,
}

impl Budget {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let profile = profile::ALL.into_iter().find(|profile| Some(profile.name) == self.profile.as_deref());
        let (params, tile_width) = match profile {
            Some(profile) => (self.params_of(&profile), profile.tile_width()),
            None => self.params()?,
        };
        let processor = self.target.core;
        let ram = Ram::new(&params, tile_width, processor);
        let report = Report::new(&self.target, &params, tile_width, &ram);
        terminal::print(&match self.json {
            true => serde_json::to_string(&report).expect("numbers and strings") + "\n",
            false => report.to_string(),
        })?;
        let failures = self.failures(&report, &params);
        failures.iter().for_each(|failure| terminal::say(failure));
        Ok(ExitCode::from(if failures.is_empty() { 0 } else { 1 }))
    }

    fn params_of(&self, profile: &Profile) -> Params {
        let views = profile.params(Fusion::Min).views().len();
        profile.params(self.fusion.unwrap_or(Fusion::default_for(views)))
    }

    /// The parameters of a match that is none of a profile, and the width of its tiles.
    fn params(&self) -> Result<(Params, usize)> {
        let size = [self.width, self.height].map(|side| usize::from(side.unwrap_or_default()));
        let views = views_of_count(self.views.unwrap_or(4))?;
        let params = self.search.params(size, views, self.fusion, SearchOptions::RANGE)?;
        let tile_width = self.tile_width.unwrap_or(params.width());
        if !(1..=params.width()).contains(&tile_width) {
            let message = format!("--tile-width is {tile_width}, it must be from 1 to the frame's width, {}", params.width());
            return Err(Error::Usage(message));
        }
        Ok((params, tile_width))
    }

    /// What is not met, in words.
    fn failures(&self, report: &Report, params: &Params) -> Vec<String> {
        let mut failures = Vec::new();
        if let Some(limit) = self.target.ram.filter(|limit| report.ram_total > *limit) {
            let fitting = match widest_tile(params, self.target.core, limit) {
                Some(width) if width < report.tile_width => format!("; column tiles would fit: --tile-width {width}"),
                _ => String::new(),
            };
            let (total, excess) = (report.ram_total, report.ram_total - limit);
            failures.push(format!("RAM: {total} bytes are {excess} more than the {limit} of --ram{fitting}"));
        }
        if let Some(limit) = self.target.fps.filter(|limit| report.fps < *limit) {
            let (fps, factor) = (report.fps, limit / report.fps);
            failures.push(format!(
                "time: {fps:.3} frames per second are too few for --fps {limit}: {factor:.2} times the speed is needed"
            ));
        }
        failures
    }
}

/// What `budget` reports.
#[derive(Debug, Serialize)]
struct Report {
    width: usize,
    height: usize,
    views: usize,
    fusion: &'static str,
    min_disparity: i16,
    num_disparities: usize,
    block_size: usize,
    tile_width: usize,
    core: &'static str,
    ram: BTreeMap<&'static str, usize>,
    ram_static: usize,
    stack_max: usize,
    ram_total: usize,
    de: u64,
    instructions: f64,
    instructions_per_de: f64,
    clock_mhz: f64,
    cycles_per_instruction: f64,
    seconds: f64,
    fps: f64,
    lines_latency: usize,
    tile_passes: usize,
    #[serde(skip)]
    buffers: Vec<Buffer>,
}

impl Report {
    fn new(target: &Target, params: &Params, tile_width: usize, ram: &Ram) -> Report {
        let processor = target.core;
        let clock_mhz = target.clock.unwrap_or(processor.clock_mhz());
        let cycles_per_instruction = target.cpi.unwrap_or(processor.cycles_per_instruction());
        let instructions = processor.instructions(params, tile_width);
        let instructions = instructions.round();
        let seconds = instructions * cycles_per_instruction / (clock_mhz * 1e6);
        Report {
            width: params.width(),
            height: params.height(),
            views: params.views().len(),
            fusion: params.fusion().name(),
            min_disparity: params.min_disparity(),
            num_disparities: params.num_disparities(),
            block_size: params.block_size(),
            tile_width,
            core: processor.name(),
            ram: ram.buffers().iter().map(|buffer| (buffer.name, buffer.bytes)).collect(),
            ram_static: ram.statics(),
            stack_max: ram.stack,
            ram_total: ram.bytes(),
            de: params.evaluations(),
            instructions,
            instructions_per_de: instructions / params.evaluations() as f64,
            clock_mhz,
            cycles_per_instruction,
            seconds,
            fps: 1.0 / seconds,
            lines_latency: params.latency_lines(),
            tile_passes: Region::tiles(params, tile_width).count(),
            buffers: ram.buffers().to_vec(),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Report { width, height, views, fusion, min_disparity, num_disparities, block_size, tile_width, core, .. } = self;
        let last = i32::from(*min_disparity) + *num_disparities as i32 - 1;
        writeln!(
            f,
            "{width}x{height}, views {views}, {fusion}, disparities {min_disparity}..={last}, block {block_size}, {tile_width} columns at a time"
        )?;
        for Buffer { name, bytes, contents } in &self.buffers {
            writeln!(f, "{bytes:>12}  {name:<12}  {contents}")?;
        }
        writeln!(
            f,
            "{:>12}  bytes of RAM in all, frames excluded: {} of statics, {} of stack",
            self.ram_total, self.ram_static, self.stack_max
        )?;
        writeln!(f, "{:>12}  evaluations (DE: pixel x disparity x view)", self.de)?;
        writeln!(
            f,
            "{:>12.0}  instructions on a {core}, predicted: {:.2} per DE, lines not fetched",
            self.instructions, self.instructions_per_de
        )?;
        writeln!(
            f,
            "{:>12.4}  s at {} MHz, if an instruction takes {} cycles: {:.3} frames per second",
            self.seconds, self.clock_mhz, self.cycles_per_instruction, self.fps
        )?;
        writeln!(f, "{:>12}  lines of latency, {} passes over the frames", self.lines_latency, self.tile_passes)
    }
}

/// A number of bytes, also in KiB or MiB.
fn bytes(text: &str) -> Result<usize> {
    let lower = text.trim().to_lowercase();
    let units = [("kib", 1 << 10), ("kb", 1 << 10), ("k", 1 << 10), ("mib", 1 << 20), ("mb", 1 << 20), ("m", 1 << 20), ("", 1)];
    let parsed = units.into_iter().find_map(|(unit, factor)| {
        let number: usize = lower.strip_suffix(unit)?.trim_end().parse().ok()?;
        number.checked_mul(factor)
    });
    parsed.ok_or_else(|| Error::Usage("it must be a number of bytes, as 147456 or 144KiB".into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_of_ram() {
        for (text, expected) in [("147456", 147_456), ("144KiB", 147_456), ("144 kb", 147_456), ("1M", 1 << 20), ("0", 0)] {
            assert_eq!(bytes(text).unwrap(), expected, "{text}");
        }
        assert!(["", "KiB", "-1", "1.5K", "12G", "99999999999999999999K"].iter().all(|text| bytes(text).is_err()));
    }
}
