//! The prediction, as a table or in JSON.

use std::{collections::BTreeMap, fmt};

use multiscopic::target::{Buffer, Ram};
use multiscopic_edge::Matching;
use serde::Serialize;

use super::target_options::TargetOptions;

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
    pub tile_width: usize,
    core: &'static str,
    ram: BTreeMap<&'static str, usize>,
    ram_static: usize,
    stack_max: usize,
    /// Bytes of RAM in all.
    pub ram_total: usize,
    de: u64,
    /// `None`, as all that follows from it, if the model does not cover the match.
    instructions: Option<f64>,
    instructions_per_de: Option<f64>,
    clock_mhz: f64,
    cycles_per_instruction: f64,
    seconds: Option<f64>,
    /// Frames per second.
    pub fps: Option<f64>,
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
    /// Predicts a match on `target`.
    pub fn new(target: &TargetOptions, matching: &Matching, ram: &Ram) -> Prediction {
        let search = matching.search();
        let processor = target.core;
        let clock_mhz = target.clock.unwrap_or(processor.clock_mhz());
        let cycles_per_instruction = target.cpi.unwrap_or(processor.cycles_per_instruction());
        let instructions = processor.instructions(matching).map(f64::round);
        let seconds = instructions.map(|instructions| instructions * cycles_per_instruction / (clock_mhz * 1e6));
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
            de: matching.evaluations(),
            instructions,
            instructions_per_de: instructions.map(|instructions| instructions / matching.evaluations() as f64),
            clock_mhz,
            cycles_per_instruction,
            seconds,
            fps: seconds.map(f64::recip),
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
        writeln!(f, "{:>12}  evaluations (DE: pixel x disparity x view)", self.de)?;
        match (self.instructions, self.instructions_per_de, self.seconds, self.fps) {
            (Some(instructions), Some(per_de), Some(seconds), Some(fps)) => {
                writeln!(
                    f,
                    "{instructions:>12.0}  instructions on a {core}, predicted: {per_de:.2} per DE, without fetching lines"
                )?;
                writeln!(
                    f,
                    "{seconds:>12.4}  s at {} MHz and {} cycles per instruction: {fps:.3} frames per second",
                    self.clock_mhz, self.cycles_per_instruction
                )?;
            }
            _ => writeln!(f, "{:>12}  instructions and time are not predicted for this match: see --help", "?")?,
        }
        writeln!(f, "{:>12}  lines of latency, passes over the frames: {}", self.lines_latency, self.tile_passes)
    }
}
