//! `multiscopic budget`: the memory, instructions, time and energy that matching takes on a microcontroller.

use std::{collections::BTreeMap, fmt, path::PathBuf, process::ExitCode};

use clap::Args;
use multiscopic::{
    Error, Processor, Result,
    files::output,
    target::{Buffer, Ram, ram::widest_tile},
};
use multiscopic_core::{Fusion, SearchSpace, SemiGlobalCost, SemiGlobalParams, network::NetworkParams};
use multiscopic_edge::{Matching, Profile, WholeLines, profile};
use serde::Serialize;

use super::{
    c_header::c_header,
    options::{SearchOptions, named, value::positive, views_of_count},
    terminal,
};

/// Predicts what matching takes on a microcontroller: RAM by buffer, flash, instructions, time, energy
///
/// Buffer sizes are exact: the firmware allocates exactly these statics. The other statics and the maximum stack
/// depth were measured, and so was flash: the most that a profile with the same method takes.
///
/// Instructions come from a cost model fitted to measurements. They include sending packets, but not fetching lines. With
/// --fusion mean and blocks of 13 or 15, high-contrast images take up to a third more. --rectified adds what rectifying lines
/// takes, without the RAM of lines and displacements. Semi-global matching of more than four views, or with --fusion half, is
/// not predicted.
///
/// Time depends on the average cycles per instruction. They come from Arm's manual (M4) and LLVM's models of the
/// processors (M7, M55), with memory that never waits: pass --cpi if you have measured your part. Arm publishes none for
/// the M33, which is taken to be as slow as an M4. For the M0+ and RISC-V, none are known without --cpi.
///
/// Energy is cycles times the energy of one, from the data of the part: 0.156 nJ (M4, nRF52840) or 0.91 nJ (M7, STM32H743). It is
/// that of the microcontroller alone. The parts of the other cores publish no such number: pass --nanojoules-per-cycle.
///
/// Exit code 1 if --ram, --flash, --fps or --joules is not met.
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

    /// Method: block matching, semi-global matching with sums of absolute differences, or the network
    #[arg(long, value_name = "METHOD", value_parser = ["bm", "sgm", "net"], default_value = "bm")]
    method: String,

    /// Confidences as well, which the network always gives
    #[arg(long, conflicts_with = "tile_width")]
    confidences: bool,

    /// Rectify every line of the frames as it is fetched
    #[arg(long)]
    rectified: bool,

    /// Fusion rule for the views' costs [default: min with one or two neighbours, heuristic with three or four, half with more]
    #[arg(long, value_parser = named::<Fusion>())]
    fusion: Option<Fusion>,

    #[command(flatten)]
    search: SearchOptions,

    #[command(flatten)]
    target: TargetOptions,

    /// Write the match as a header for C: its method, its memory and its parameters, for programs with multiscopic.h
    #[arg(long, value_name = "OUT.h")]
    header: Option<PathBuf>,

    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// The options that a profile sets.
const SET_BY_PROFILE: [&str; 9] =
    ["width", "height", "views", "tile_width", "method", "confidences", "min_disparity", "num_disparities", "block_size"];

impl Budget {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let profile = profile::ALL.into_iter().find(|profile| Some(profile.name) == self.profile.as_deref());
        let matching = match profile {
            Some(profile) => self.profile_matching(&profile),
            None => self.custom_matching()?,
        };
        let core = self.target.core;
        if core.firmware_costs().flash.of(&matching) == 0 {
            let message = format!("the memory of {} on {} was not measured", matching.name(), core.name());
            return Err(Error::Usage(message));
        }
        if self.rectified && core.firmware_costs().rectified_pixel.is_none() {
            return Err(Error::Usage(format!("--rectified: what a pixel takes was not measured on {}", core.name())));
        }
        let checked =
            [("--fps", self.target.fps), ("--joules", self.target.joules)].into_iter().find(|(_, limit)| limit.is_some());
        if let Some((option, _)) = checked
            && core.instructions(&matching).is_none()
        {
            let message = format!(
                "{option} cannot be checked: the instructions are not predicted for this match, see `multiscopic budget --help`"
            );
            return Err(Error::Usage(message));
        }
        if self.target.joules.is_some() && self.target.energy_per_cycle().is_none() {
            let core = core.name();
            let message =
                format!("--joules cannot be checked: no energy per cycle is known for {core}, give --nanojoules-per-cycle");
            return Err(Error::Usage(message));
        }
        for (option, limit) in [("--fps", self.target.fps), ("--joules", self.target.joules)] {
            if limit.is_some() && self.target.cycles_per_instruction().is_none() {
                let core = core.name();
                return Err(Error::Usage(format!("{option} cannot be checked: no cycles are known for {core}, give --cpi")));
            }
        }
        if let Some(path) = &self.header {
            let header = c_header(&matching)?;
            output::write(path, |file| file.write_all(header.as_bytes()))?;
        }
        let prediction = Prediction::new(&self.target, &matching, &Ram::new(&matching, core), self.rectified);
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
        if self.method != "bm" && self.tile_width.is_some() {
            return Err(Error::Usage("--tile-width is for block matching: paths lead through the whole line".into()));
        }
        if self.method == "net" {
            let params = NetworkParams::new(*params.search()).map_err(|error| Error::Usage(error.to_string()))?;
            return Ok(Matching::Network(params));
        }
        if self.method == "sgm" {
            let cost = SemiGlobalCost::Sad { block_size: self.search.block_size.unwrap_or(SemiGlobalCost::DEFAULT_BLOCK_SIZE) };
            let params = SemiGlobalParams::new(*params.search(), cost)?;
            return Ok(match self.confidences {
                true => Matching::WithConfidences(WholeLines::SemiGlobal(params)),
                false => Matching::SemiGlobal(params),
            });
        }
        if self.confidences {
            return Ok(Matching::WithConfidences(WholeLines::Blocks(params)));
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
        if let Some(limit) = self.target.flash.filter(|limit| prediction.flash > *limit) {
            failures.push(format!("flash: {} bytes exceed --flash {limit} by {}", prediction.flash, prediction.flash - limit));
        }
        if let (Some(limit), Some(fps)) = (self.target.fps, prediction.fps)
            && fps < limit
        {
            let factor = limit / fps;
            failures.push(format!(
                "time: {fps:.3} frames per second fall short of --fps {limit}; it must be {factor:.2} times as fast"
            ));
        }
        if let (Some(limit), Some(joules)) = (self.target.joules, prediction.joules)
            && joules > limit
        {
            let factor = joules / limit;
            failures
                .push(format!("energy: {joules:.6} J a frame exceed --joules {limit}; it must be {factor:.2} times as frugal"));
        }
        failures
    }
}

/// The microcontroller and what it must achieve.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Target")]
pub struct TargetOptions {
    /// Processor
    #[arg(long, value_parser = named::<Processor>(), default_value = "cortex-m4")]
    core: Processor,

    /// Clock in MHz [default: 64 (M4, nRF52840), 480 (M7, STM32H743), 150 (M33, RP2350) or 32 (M55,
    /// Arm's AN547)]
    #[arg(long, value_name = "MHZ", value_parser = positive, allow_negative_numbers = true)]
    clock: Option<f64>,

    /// Average cycles per instruction [default: that of the profile qvga, with memory that never waits]
    #[arg(long, value_name = "X", value_parser = positive, allow_negative_numbers = true)]
    cpi: Option<f64>,

    /// Available RAM, in bytes or as 144KiB: exit code 1 if matching takes more
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    ram: Option<usize>,

    /// Available flash, in bytes or as 64KiB: exit code 1 if the firmware takes more
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    flash: Option<usize>,

    /// Required frames per second: exit code 1 if matching is slower
    #[arg(long, value_name = "N", value_parser = positive, allow_negative_numbers = true)]
    fps: Option<f64>,

    /// Energy of a cycle in nanojoules [default: 0.156 (M4, nRF52840) or 0.91 (M7, STM32H743)]
    #[arg(long, value_name = "NJ", value_parser = positive, allow_negative_numbers = true)]
    nanojoules_per_cycle: Option<f64>,

    /// Available energy for a frame in joules: exit code 1 if matching takes more
    #[arg(long, value_name = "J", value_parser = positive, allow_negative_numbers = true)]
    joules: Option<f64>,
}

impl TargetOptions {
    /// A processor as it is, without requirements.
    #[cfg(feature = "live")]
    pub fn of(core: Processor) -> TargetOptions {
        TargetOptions {
            core,
            clock: None,
            cpi: None,
            ram: None,
            flash: None,
            fps: None,
            nanojoules_per_cycle: None,
            joules: None,
        }
    }

    /// Average cycles per instruction, if they are known.
    fn cycles_per_instruction(&self) -> Option<f64> {
        self.cpi.or(self.core.cycles_per_instruction())
    }

    /// Nanojoules of a cycle, if they are known.
    fn energy_per_cycle(&self) -> Option<f64> {
        self.nanojoules_per_cycle.or(self.core.nanojoules_per_cycle())
    }
}

/// Parses a number of bytes, with an optional unit up to MiB.
fn bytes(text: &str) -> Result<usize> {
    let lower = text.trim().to_lowercase();
    let units = [("kib", 1 << 10), ("kb", 1 << 10), ("k", 1 << 10), ("mib", 1 << 20), ("mb", 1 << 20), ("m", 1 << 20), ("", 1)];
    let parsed = units.into_iter().find_map(|(unit, factor)| {
        let number: usize = lower.strip_suffix(unit)?.trim_end().parse().ok()?;
        number.checked_mul(factor)
    });
    parsed.ok_or_else(|| Error::Usage("it must be a number of bytes, as 147456 or 144KiB".into()))
}

/// The prediction; `--json` prints these fields.
#[derive(Debug, Serialize)]
pub struct Prediction {
    method: &'static str,
    width: usize,
    height: usize,
    views: usize,
    fusion: &'static str,
    min_disparity: i16,
    num_disparities: usize,
    /// That of the sums of absolute differences; the network has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    block_size: Option<usize>,
    /// The search at long baselines around what was found.
    long: Option<LongSearch>,
    /// Columns of a tile.
    tile_width: usize,
    core: &'static str,
    ram: BTreeMap<&'static str, usize>,
    ram_static: usize,
    stack_max: usize,
    /// Bytes of RAM in all.
    ram_total: usize,
    /// The most bytes of flash that a profile with this method takes.
    flash: usize,
    de: u64,
    /// `None`, as all that follows from it, if the model does not cover the match.
    instructions: Option<f64>,
    instructions_per_de: Option<f64>,
    /// Those of all instructions that rectify lines.
    #[serde(skip_serializing_if = "Option::is_none")]
    rectifying: Option<f64>,
    clock_mhz: f64,
    cycles_per_instruction: Option<f64>,
    seconds: Option<f64>,
    /// Frames per second.
    fps: Option<f64>,
    /// `None` if none are known for the part.
    nanojoules_per_cycle: Option<f64>,
    /// Joules of a frame.
    joules: Option<f64>,
    lines_latency: usize,
    tile_passes: usize,
    #[serde(skip)]
    buffers: Vec<Buffer>,
}

/// The search at long baselines around the disparities found at short ones.
#[derive(Debug, Serialize)]
struct LongSearch {
    views: String,
    min_disparity: i16,
    num_disparities: usize,
    block_size: usize,
}

impl LongSearch {
    fn of(matching: &Matching) -> Option<LongSearch> {
        let Matching::AroundPrior { long, .. } = matching else { return None };
        Some(LongSearch {
            views: long.views().iter().map(|view| view.to_string()).collect::<Vec<_>>().join(" and "),
            min_disparity: long.min_disparity(),
            num_disparities: long.num_disparities(),
            block_size: long.block_size(),
        })
    }
}

impl Prediction {
    /// Predicts a match on `target`, of lines that are rectified if `rectified` is set.
    pub fn new(target: &TargetOptions, matching: &Matching, ram: &Ram, rectified: bool) -> Prediction {
        let search = matching.search();
        let processor = target.core;
        let clock_mhz = target.clock.unwrap_or(processor.clock_mhz());
        let cycles_per_instruction = target.cycles_per_instruction();
        let fetched =
            |search: &SearchSpace| matching.tiles().count() * (1 + search.views().len()) * search.width() * search.height();
        let price = processor.firmware_costs().rectified_pixel.filter(|_| rectified);
        let rectifying = price.map(|price| (price * matching.searches().map(fetched).sum::<usize>() as f64).round());
        let instructions = processor.instructions(matching).map(|matching| matching.round() + rectifying.unwrap_or_default());
        let cycles = instructions.zip(cycles_per_instruction).map(|(instructions, cycles)| instructions * cycles);
        let seconds = cycles.map(|cycles| cycles / (clock_mhz * 1e6));
        let nanojoules_per_cycle = target.energy_per_cycle();
        Prediction {
            method: matching.name(),
            width: search.width(),
            height: search.height(),
            views: matching.views().len(),
            fusion: search.fusion().name(),
            min_disparity: search.min_disparity(),
            num_disparities: search.num_disparities(),
            block_size: matching.block_matching().map(|params| params.block_size()),
            long: LongSearch::of(matching),
            tile_width: matching.tile_width(),
            core: processor.name(),
            ram: ram.buffers().iter().map(|buffer| (buffer.name, buffer.bytes)).collect(),
            ram_static: ram.statics(),
            stack_max: ram.stack,
            ram_total: ram.bytes(),
            flash: processor.firmware_costs().flash.of(matching),
            de: matching.evaluations(),
            instructions,
            instructions_per_de: instructions.map(|instructions| instructions / matching.evaluations() as f64),
            rectifying,
            clock_mhz,
            cycles_per_instruction,
            seconds,
            fps: seconds.map(f64::recip),
            nanojoules_per_cycle,
            joules: cycles.zip(nanojoules_per_cycle).map(|(cycles, nanojoules)| cycles * nanojoules * 1e-9),
            lines_latency: matching.latency_lines(),
            tile_passes: matching.tiles().count(),
            buffers: ram.buffers().to_vec(),
        }
    }
}

impl fmt::Display for Prediction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Prediction {
            method, width, height, views, fusion, min_disparity, num_disparities, block_size, tile_width, core, ..
        } = self;
        let last = i32::from(*min_disparity) + *num_disparities as i32 - 1;
        let block = block_size.map_or_else(String::new, |size| format!("block {size}, "));
        writeln!(
            f,
            "{method}, {width}x{height}, views {views}, {fusion}, disparities {min_disparity}..={last}, {block}column tiles of \
             {tile_width}"
        )?;
        if let Some(LongSearch { views, min_disparity, num_disparities, block_size }) = &self.long {
            let last = i32::from(*min_disparity) + *num_disparities as i32 - 1;
            writeln!(f, "around them in views {views}: disparities {min_disparity}..={last}, block {block_size}")?;
        }
        for Buffer { name, bytes, contents } in &self.buffers {
            writeln!(f, "{bytes:>12}  {name:<12}  {contents}")?;
        }
        // The network's buffers hold them.
        let frames = if self.ram.iter().any(|(name, _)| *name == "network") { "with" } else { "without" };
        writeln!(
            f,
            "{:>12}  bytes of RAM in total, {frames} frames: {} statics, {} stack",
            self.ram_total, self.ram_static, self.stack_max
        )?;
        writeln!(f, "{:>12}  bytes of flash at most, with constant parameters, packets and a log", self.flash)?;
        writeln!(f, "{:>12}  evaluations (DE: pixel x disparity x view)", self.de)?;
        if let (Some(instructions), Some(per_de)) = (self.instructions, self.instructions_per_de) {
            let rectifying = self.rectifying.map(|count| format!(", {count:.0} to rectify lines")).unwrap_or_default();
            writeln!(
                f,
                "{instructions:>12.0}  instructions on a {core}, predicted: {per_de:.2} per DE, without fetching lines{rectifying}"
            )?;
        } else {
            writeln!(f, "{:>12}  instructions, time and energy are not predicted for this match: see --help", "?")?;
        }
        match (self.seconds, self.fps, self.cycles_per_instruction) {
            (Some(seconds), Some(fps), Some(cycles)) => writeln!(
                f,
                "{seconds:>12.4}  s at {} MHz and {cycles} cycles per instruction: {fps:.3} frames per second",
                self.clock_mhz
            )?,
            (.., None) => writeln!(f, "{:>12}  s and J: no cycles per instruction are known for {core}, see --cpi", "?")?,
            _ => {}
        }
        match (self.joules, self.nanojoules_per_cycle) {
            (Some(joules), Some(nanojoules)) => {
                let (millijoules, frames) = (1e3 * joules, 3600.0 / joules);
                writeln!(
                    f,
                    "{millijoules:>12.3}  mJ a frame at {nanojoules} nJ a cycle: {frames:.0} frames on a watt-hour of battery"
                )?;
            }
            (None, None) => writeln!(f, "{:>12}  J: no energy per cycle is known for {core}, see --nanojoules-per-cycle", "?")?,
            _ => {}
        }
        writeln!(f, "{:>12}  lines of latency, passes over the frames: {}", self.lines_latency, self.tile_passes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ram_sizes_with_units() {
        for (text, expected) in [("147456", 147_456), ("144KiB", 147_456), ("144 kb", 147_456), ("1M", 1 << 20), ("0", 0)] {
            assert_eq!(bytes(text).unwrap(), expected, "{text}");
        }
        assert!(["", "KiB", "-1", "1.5K", "12G", "99999999999999999999K"].iter().all(|text| bytes(text).is_err()));
    }
}
