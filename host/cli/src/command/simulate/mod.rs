//! `multiscopic simulate`: the firmware's pipeline on this machine.

mod sweep;

use std::{
    collections::BTreeMap,
    fmt,
    path::{Path, PathBuf},
    process::ExitCode,
};

use clap::Args;
use multiscopic::{
    Error, Frames, Picture, Processor, Result,
    files::output,
    scene::{PinholeCamera, Scene, render_views},
    target::{Ram, Simulation, reception, simulate},
};
use multiscopic_core::{Fusion, SearchSpace, Views};
use multiscopic_edge::{
    Matching, Profile,
    profile::{self, QQVGA_SWEEP},
};
use serde::Serialize;

use super::{
    advice, limits,
    options::{SourceOptions, named, output_file},
    terminal,
};

/// Runs the firmware's pipeline on this machine: the same parameters, memory, order of lines and packets, byte for byte
#[derive(Clone, Debug, Args)]
pub struct Simulate {
    #[command(flatten)]
    source: SourceOptions,

    /// Firmware profile; larger frames are cropped to the middle, and without frames the scene of `multiscopic demo` is rendered.
    /// qqvga-sweep takes the folder of a sweep, refines with its frames from the centre outwards, and sends a map after each second
    #[arg(long, value_name = "NAME",
        value_parser = profile::ALL.iter().map(|profile| profile.name).chain([QQVGA_SWEEP.name]).collect::<Vec<_>>())]
    profile: String,

    /// Fusion rule for the views' costs [default: min with one or two neighbours, heuristic with three or four, half with more;
    /// for the network of several neighbours trimmed]
    #[arg(long, value_parser = named::<Fusion>())]
    fusion: Option<Fusion>,

    /// Processor for which memory and instructions are predicted
    #[arg(long, value_parser = named::<Processor>(), default_value = "cortex-m4")]
    core: Processor,

    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,

    /// Disparities in pixels, +inf where invalid, as PFM or for numpy (OUT.npy, OUT.npz); of a sweep, those after its last frame
    #[arg(short, long, value_name = "OUT.pfm", help_heading = "Output", value_parser = output_file::floats())]
    output: Option<PathBuf>,

    /// Confidences as an 8-bit image: the probability that a disparity is at most one pixel off, times 255, 0 where invalid;
    /// needs a profile that computes them: qvga-confidence, qqvga-sgm-confidence, qqvga-net or qqvga-sweep
    #[arg(long, value_name = "OUT.png", help_heading = "Output", value_parser = output_file::png())]
    confidence: Option<PathBuf>,

    /// Packets as the firmware sends them, except that the last one lacks the stack depth, which is unknown here
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    packets: Option<PathBuf>,

    /// All maps of a sweep, as PFM files that are named by the number of frames before them
    #[arg(long, value_name = "DIR", help_heading = "Output")]
    maps: Option<PathBuf>,
}

impl Simulate {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        if self.profile == QQVGA_SWEEP.name {
            return self.run_sweep(&QQVGA_SWEEP);
        }
        if self.maps.is_some() {
            return Err(Error::Usage(format!("--maps is for sweeps: give --profile {}", QQVGA_SWEEP.name)));
        }
        let profile = profile::ALL.into_iter().find(|profile| profile.name == self.profile);
        let profile = profile.expect("the parser admits the profiles' names alone");
        let fusion = self.fusion.unwrap_or(profile.default_fusion());
        profile.check_fusion(fusion)?;
        let matching = profile.matching(fusion);
        if let (Some(path), false) = (&self.confidence, matching.has_confidences()) {
            let message = format!("profile {} computes no confidences, --confidence {} needs them", profile.name, path.display());
            return Err(Error::Usage(message));
        }
        let (frames, images) = self.frames(&profile, matching.search(), matching.views())?;

        let lines = matching.tiles().count() * matching.searches().count() * matching.search().height();
        let bar = terminal::progress(lines as u64, "lines");
        let simulation = simulate(&profile, fusion, &frames.planes(), &|| bar.inc(1))?;
        bar.finish_and_clear();
        output::write_together(|| {
            if let Some(path) = &self.packets {
                output::write(path, |writer| writer.write_all(&simulation.packets))?;
            }
            if self.output.is_some() || self.confidence.is_some() {
                let received = reception::receive(&simulation.packets[..], Path::new("the simulated packets"), limits(), |_| ())?;
                self.output
                    .iter()
                    .try_for_each(|path| output_file::write_floats(&received.disparities.to_float(), path, "disparity"))?;
                advice::no_disparity(&received.disparities).into_iter().for_each(terminal::warn);
                if let (Some(path), Some(confidences)) = (&self.confidence, &received.confidences) {
                    Picture::from(confidences).write_png(path)?;
                }
            }
            Ok(())
        })?;
        let report = SimulationReport::new(&profile, &matching, self.core, images, &simulation);
        terminal::print_report(&report, self.json)?;
        Ok(ExitCode::SUCCESS)
    }

    /// The frames in the size of the profile, and `"demo"` or `"given"` for the report.
    fn frames(&self, profile: &Profile, search: &SearchSpace, views: Views) -> Result<(Frames, &'static str)> {
        let outputs = self.outputs();
        let [width, height] = [search.width(), search.height()];
        let Some(mut source) = self.source.source()? else {
            output::check(&outputs, &[])?;
            let camera = PinholeCamera::new(width as u32, height as u32);
            return Ok((render_views(&Scene::demo(), &camera, views, 1).frames(views), "demo"));
        };
        output::check(&outputs, &source.paths().collect::<Vec<_>>())?;
        if let Some(view) = views.iter().find(|&view| !source.images.views().contains(view)) {
            let message = format!("profile {} needs the views {}: the {view} one is missing", profile.name, names(views));
            return Err(Error::Usage(message));
        }
        let (frames, ..) = source.load()?;
        check_size(frames.size(), [width, height], source.images.center, profile.name)?;
        Ok((frames.middle([width, height], views), "given"))
    }

    fn outputs(&self) -> Vec<&Path> {
        [&self.output, &self.confidence, &self.packets].into_iter().flatten().map(PathBuf::as_path).collect()
    }
}

/// Refuses frames that are smaller than those of a profile.
fn check_size([w, h]: [usize; 2], [width, height]: [usize; 2], path: PathBuf, profile: &str) -> Result<()> {
    if w < width || h < height {
        let expected = format!("at least {width}x{height}, the frame of profile {profile}");
        return Err(Error::Format { path, found: format!("{w}x{h} pixels"), expected });
    }
    Ok(())
}

fn names(views: Views) -> String {
    views.iter().map(|view| view.to_string()).collect::<Vec<_>>().join(", ")
}

/// The simulation and the prediction. `--json` prints these fields, named as in `cargo xtask edge`.
#[derive(Debug, Serialize)]
struct SimulationReport<'a> {
    profile: &'a str,
    core: &'a str,
    fusion: &'a str,
    images: &'a str,
    ram_static: usize,
    stack_max: usize,
    ram_total: usize,
    ram_budget: usize,
    de: u64,
    instructions: Option<f64>,
    instructions_per_de: Option<f64>,
    lines_latency: usize,
    tile_passes: usize,
    lines_read: BTreeMap<String, usize>,
    packet_bytes: usize,
}

impl<'a> SimulationReport<'a> {
    fn new(
        profile: &Profile,
        matching: &Matching,
        processor: Processor,
        images: &'a str,
        simulation: &Simulation,
    ) -> SimulationReport<'a> {
        let (search, ram) = (matching.search(), Ram::new(matching, processor));
        let instructions = processor.instructions(matching).map(f64::round);
        SimulationReport {
            profile: profile.name,
            core: processor.name(),
            fusion: search.fusion().name(),
            images,
            ram_static: simulation.workspace + ram.other_statics,
            stack_max: ram.stack,
            ram_total: simulation.workspace + ram.other_statics + ram.stack,
            ram_budget: profile.ram_budget,
            de: matching.evaluations(),
            instructions,
            instructions_per_de: instructions.map(|instructions| instructions / matching.evaluations() as f64),
            lines_latency: matching.latency_lines(),
            tile_passes: simulation.passes,
            lines_read: simulation.lines_read.iter().map(|(frame, lines)| (frame.to_string(), *lines)).collect(),
            packet_bytes: simulation.packets.len(),
        }
    }
}

impl fmt::Display for SimulationReport<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "profile {}, fusion {}, frames {}, processor {}", self.profile, self.fusion, self.images, self.core)?;
        let SimulationReport { ram_static, stack_max, ram_total, ram_budget, .. } = self;
        writeln!(f, "RAM      {ram_total} of {ram_budget} bytes: {ram_static} statics, {stack_max} stack")?;
        let SimulationReport { de, instructions, instructions_per_de, .. } = self;
        write!(f, "work     {de} DE (pixel x disparity x view), ")?;
        match (instructions, instructions_per_de) {
            (Some(instructions), Some(per_de)) => writeln!(f, "{instructions} instructions: {per_de:.2} per DE, predicted")?,
            _ => writeln!(f, "instructions are not predicted for this match")?,
        }
        let lines: Vec<String> = self.lines_read.iter().map(|(frame, lines)| format!("{frame} {lines}")).collect();
        writeln!(f, "lines    {} read ahead, {} passes; lines read: {}", self.lines_latency, self.tile_passes, lines.join(", "))?;
        writeln!(f, "packets  {} bytes", self.packet_bytes)
    }
}
