//! `multiscopic budget`: the memory, instructions, time and energy that matching takes on a microcontroller.

use std::{collections::BTreeMap, fmt, path::PathBuf, process::ExitCode};

use clap::Args;
use multiscopic::{
    Error, Processor, Result,
    files::output,
    target::{Buffer, Ram, ram::widest_tile},
};
use multiscopic_core::{Fusion, SearchSpace, SemiGlobalCost, SemiGlobalParams, SweepParams, Views, network::NetworkParams};
use multiscopic_edge::{
    Matching, Profile, WholeLines,
    profile::{self, QQVGA_SWEEP},
};
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
/// For a sweep, all of these are of one frame and of a map that is sent after it, on average over 32 frames of the scene of the demo,
/// from the centre outwards. Where there is no texture, the filter searches in each frame: made-up scenes take 0.8 to 1.8 times as much.
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
        value_parser = profile::ALL.iter().map(|profile| profile.name).chain([QQVGA_SWEEP.name]).collect::<Vec<_>>())]
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

    /// Method: block matching, semi-global matching with sums of absolute differences, the network, or the filter over the frames of
    /// a sweep, with blocks of 3, 5 or 7
    #[arg(long, value_name = "METHOD", value_parser = ["bm", "sgm", "net", SWEEP], default_value = "bm")]
    method: String,

    /// Confidences as well, which the network always gives
    #[arg(long, conflicts_with = "tile_width")]
    confidences: bool,

    /// Rectify every line of the frames as it is fetched
    #[arg(long)]
    rectified: bool,

    /// Fusion rule for the views' costs [default: min with one or two neighbours, heuristic with three or four, half with more;
    /// for the network of several neighbours trimmed]
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

/// The name of the filter over the frames of a sweep.
const SWEEP: &str = "sweep";

/// The options that a profile sets.
const SET_BY_PROFILE: [&str; 9] =
    ["width", "height", "views", "tile_width", "method", "confidences", "min_disparity", "num_disparities", "block_size"];

impl Budget {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let core = self.target.core;
        let unmeasured = |name: &str| Error::Usage(format!("the memory of {name} on {} was not measured", core.name()));
        let (prediction, matching) = match self.sweep()? {
            Some(params) => (Prediction::of_sweep(&self.target, &params).ok_or_else(|| unmeasured("a sweep"))?, None),
            None => {
                let matching = self.matching()?;
                if core.firmware_costs().flash.of(&matching) == 0 {
                    return Err(unmeasured(matching.name()));
                }
                if self.rectified && core.firmware_costs().rectified_pixel.is_none() {
                    return Err(Error::Usage(format!("--rectified: what a pixel takes was not measured on {}", core.name())));
                }
                (Prediction::new(&self.target, &matching, &Ram::new(&matching, core), self.rectified), Some(matching))
            }
        };
        self.check_limits(&prediction)?;
        if let (Some(path), Some(matching)) = (&self.header, &matching) {
            let header = c_header(matching)?;
            output::write(path, |file| file.write_all(header.as_bytes()))?;
        }
        terminal::print_report(&prediction, self.json)?;
        let failures = self.failures(&prediction, matching.as_ref());
        failures.iter().for_each(|failure| terminal::complain(failure));
        Ok(ExitCode::from(if failures.is_empty() { 0 } else { 1 }))
    }

    /// Refuses a limit of time or energy that cannot be checked.
    fn check_limits(&self, prediction: &Prediction) -> Result<()> {
        let core = self.target.core.name();
        for (option, _) in
            [("--fps", self.target.fps), ("--joules", self.target.joules)].iter().filter(|(_, limit)| limit.is_some())
        {
            let reason = if prediction.instructions.is_none() {
                "the instructions are not predicted for this match, see `multiscopic budget --help`".into()
            } else if *option == "--joules" && prediction.nanojoules_per_cycle.is_none() {
                format!("no energy per cycle is known for {core}, give --nanojoules-per-cycle")
            } else if prediction.cycles_per_instruction.is_none() {
                format!("no cycles are known for {core}, give --cpi")
            } else {
                continue;
            };
            return Err(Error::Usage(format!("{option} cannot be checked: {reason}")));
        }
        Ok(())
    }

    /// Returns the sweep that is filtered, if it is one.
    fn sweep(&self) -> Result<Option<SweepParams>> {
        let is_profile = self.profile.as_deref() == Some(QQVGA_SWEEP.name);
        if !is_profile && (self.profile.is_some() || self.method != SWEEP) {
            return Ok(None);
        }
        let unheeded = [
            ("--views", self.views.is_some()),
            ("--tile-width", self.tile_width.is_some()),
            ("--confidences", self.confidences),
            ("--rectified", self.rectified),
            ("--fusion", self.fusion.is_some()),
            ("--header", self.header.is_some()),
        ];
        if let Some((option, _)) = unheeded.iter().find(|(_, is_given)| *is_given) {
            return Err(Error::Usage(format!("{option} is not for sweeps: leave it out")));
        }
        if is_profile {
            return Ok(Some(QQVGA_SWEEP.params));
        }
        let search = self.search.search(self.size(), Views::STEREO, None, SearchOptions::DEFAULT_RANGE)?;
        let block_size = self.search.block_size.unwrap_or(2 * QQVGA_SWEEP.params.radius() as u8 + 1);
        if ![3, 5, 7].contains(&block_size) {
            return Err(Error::Usage(format!("--block-size is {block_size}, that of a sweep must be 3, 5 or 7")));
        }
        let params = SweepParams::new(search, QQVGA_SWEEP.params.noise_q4(), block_size / 2);
        params.map(Some).map_err(|error| Error::Usage(error.to_string()))
    }

    /// Returns the match of a profile, or that of the options.
    fn matching(&self) -> Result<Matching> {
        let profile = profile::ALL.into_iter().find(|profile| Some(profile.name) == self.profile.as_deref());
        profile.map_or_else(|| self.custom_matching(), |profile| self.profile_matching(&profile))
    }

    fn size(&self) -> [usize; 2] {
        [self.width, self.height].map(|side| usize::from(side.unwrap_or_default()))
    }

    fn profile_matching(&self, profile: &Profile) -> Result<Matching> {
        let fusion = self.fusion.unwrap_or(profile.default_fusion());
        profile.check_fusion(fusion)?;
        Ok(profile.matching(fusion))
    }

    /// Returns the matching that is computed without a profile.
    fn custom_matching(&self) -> Result<Matching> {
        let views = views_of_count(self.views.unwrap_or(4))?;
        let default: fn(usize) -> Fusion = if self.method == "net" { Fusion::default_for_census } else { Fusion::default_for };
        let fusion = self.fusion.unwrap_or_else(|| default(views.len()));
        let search = self.search.search(self.size(), views, Some(fusion), SearchOptions::DEFAULT_RANGE)?;
        if self.method != "bm" && self.tile_width.is_some() {
            return Err(Error::Usage("--tile-width is for block matching: paths lead through the whole line".into()));
        }
        if self.method == "net" {
            let params = NetworkParams::new(search).map_err(|error| Error::Usage(error.to_string()))?;
            return Ok(Matching::Network(params));
        }
        let params = self.search.params(search)?;
        if self.method == "sgm" {
            let cost = SemiGlobalCost::Sad { block_size: self.search.block_size.unwrap_or(SemiGlobalCost::DEFAULT_BLOCK_SIZE) };
            let params = SemiGlobalParams::new(search, cost)?;
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
    fn failures(&self, prediction: &Prediction, matching: Option<&Matching>) -> Vec<String> {
        let mut failures = Vec::new();
        if let Some(limit) = self.target.ram.filter(|limit| prediction.ram_total > *limit) {
            let tile = match matching {
                Some(Matching::Blocks { params, .. }) => widest_tile(params, self.target.core, limit),
                _ => None,
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
#[derive(Debug, Default, Serialize)]
pub struct Prediction {
    method: &'static str,
    width: usize,
    height: usize,
    /// `None`, as the fusion and the evaluations, for a sweep.
    #[serde(skip_serializing_if = "Option::is_none")]
    views: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fusion: Option<&'static str>,
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
    #[serde(skip_serializing_if = "Option::is_none")]
    de: Option<u64>,
    /// `None`, as all that follows from it, if the model does not cover the match.
    instructions: Option<f64>,
    instructions_per_de: Option<f64>,
    /// Those of all instructions that rectify lines.
    #[serde(skip_serializing_if = "Option::is_none")]
    rectifying: Option<f64>,
    /// Those of all instructions for a frame of a sweep that send the map after it.
    #[serde(skip_serializing_if = "Option::is_none")]
    sending: Option<f64>,
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
        let fetched =
            |search: &SearchSpace| matching.tiles().count() * (1 + search.views().len()) * search.width() * search.height();
        let price = processor.firmware_costs().rectified_pixel.filter(|_| rectified);
        let rectifying = price.map(|price| (price * matching.searches().map(fetched).sum::<usize>() as f64).round());
        let instructions = processor.instructions(matching).map(|matching| matching.round() + rectifying.unwrap_or_default());
        Prediction {
            method: matching.name(),
            views: Some(matching.views().len()),
            fusion: Some(search.fusion().name()),
            block_size: matching.block_matching().map(|params| params.block_size()),
            long: LongSearch::of(matching),
            tile_width: matching.tile_width(),
            flash: processor.firmware_costs().flash.of(matching),
            de: Some(matching.evaluations()),
            instructions_per_de: instructions.map(|instructions| instructions / matching.evaluations() as f64),
            rectifying,
            lines_latency: matching.latency_lines(),
            tile_passes: matching.tiles().count(),
            ..Prediction::of_work(target, search, ram, instructions, processor.cycles_per_instruction())
        }
    }

    /// Predicts a frame of a sweep on `target`, and the map after it. `None` if sweeps were not measured there.
    pub fn of_sweep(target: &TargetOptions, params: &SweepParams) -> Option<Prediction> {
        let (costs, search) = (target.core.firmware_costs().sweep.as_ref()?, params.search());
        let [refining, sending] = costs.prices.instructions(params).map(f64::round);
        let cycles_per_instruction = costs.cycles_per_instruction.get(target.core.name()).copied();
        let ram = Ram::of_sweep(params, target.core)?;
        Some(Prediction {
            method: SWEEP,
            block_size: Some(2 * params.radius() + 1),
            tile_width: search.width(),
            flash: costs.flash,
            sending: Some(sending),
            lines_latency: search.height(),
            tile_passes: 1,
            ..Prediction::of_work(target, search, &ram, Some(refining + sending), cycles_per_instruction)
        })
    }

    /// Predicts what follows from the instructions, the memory and the search.
    fn of_work(
        target: &TargetOptions,
        search: &SearchSpace,
        ram: &Ram,
        instructions: Option<f64>,
        cycles_per_instruction: Option<f64>,
    ) -> Prediction {
        let clock_mhz = target.clock.unwrap_or(target.core.clock_mhz());
        let cycles_per_instruction = target.cpi.or(cycles_per_instruction);
        let cycles = instructions.zip(cycles_per_instruction).map(|(instructions, cycles)| instructions * cycles);
        let seconds = cycles.map(|cycles| cycles / (clock_mhz * 1e6));
        let nanojoules_per_cycle = target.energy_per_cycle();
        Prediction {
            width: search.width(),
            height: search.height(),
            min_disparity: search.min_disparity(),
            num_disparities: search.num_disparities(),
            core: target.core.name(),
            ram: ram.buffers().iter().map(|buffer| (buffer.name, buffer.bytes)).collect(),
            ram_static: ram.statics(),
            stack_max: ram.stack,
            ram_total: ram.bytes(),
            instructions,
            clock_mhz,
            cycles_per_instruction,
            seconds,
            fps: seconds.map(f64::recip),
            nanojoules_per_cycle,
            joules: cycles.zip(nanojoules_per_cycle).map(|(cycles, nanojoules)| cycles * nanojoules * 1e-9),
            buffers: ram.buffers(),
            ..Prediction::default()
        }
    }
}

impl fmt::Display for Prediction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Prediction { method, width, height, min_disparity, num_disparities, block_size, tile_width, core, .. } = self;
        let last = i32::from(*min_disparity) + *num_disparities as i32 - 1;
        let block = block_size.map(|size| format!(", block {size}")).unwrap_or_default();
        let of_views = self
            .views
            .zip(self.fusion)
            .map(|(views, fusion)| (format!(", views {views}, {fusion}"), format!(", column tiles of {tile_width}")));
        let (views, tiles) = of_views.unwrap_or_default();
        writeln!(f, "{method}, {width}x{height}{views}, disparities {min_disparity}..={last}{block}{tiles}")?;
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
        if let Some(de) = self.de {
            writeln!(f, "{de:>12}  evaluations (DE: pixel x disparity x view)")?;
        }
        if let (Some(instructions), Some(per_de)) = (self.instructions, self.instructions_per_de) {
            let rectifying = self.rectifying.map(|count| format!(", {count:.0} to rectify lines")).unwrap_or_default();
            writeln!(
                f,
                "{instructions:>12.0}  instructions on a {core}, predicted: {per_de:.2} per DE, without fetching lines{rectifying}"
            )?;
        } else if let (Some(instructions), Some(sending)) = (self.instructions, self.sending) {
            let per_pixel = instructions / (width * height) as f64;
            writeln!(
                f,
                "{instructions:>12.0}  instructions on a {core} for a frame and a map after it, predicted: {per_pixel:.0} per pixel, \
                 without fetching lines, {sending:.0} to send the map"
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
