//! Runs the firmware of all profiles in the emulator, compares its packets with the host's results, and
//! measures it.

use anyhow::{Context, Result, ensure};
use clap::Args;
use multiscopic::target::{
    FirmwareCostTable, MEASURED, Processor, instruction_model::Workload, reception::ReceivedFrame, simulate,
};
use multiscopic_core::Fusion;
use multiscopic_edge::{Profile, frame_file, profile};
use serde::Serialize;
use std::{
    fs,
    path::{Path, PathBuf},
};

use crate::{
    counts::{self, Counts},
    emulation::{
        self,
        build::{self, Footprint, Program},
        counter::{Counter, Instructions},
        emulated_board::{self, EmulatedBoard},
    },
    firmware_checks::{
        frames::{self, ImageSet},
        price_fit::{self, MOST_OFF},
        rectifying, sweeping,
    },
    system::{self, command, in_parallel, read},
    tools::Toolchain,
};

/// The rules that are measured with a profile: those for which microcontrollers have loops. [`Fusion::Half`] of up to four
/// views is fused exactly, one candidate at a time.
pub fn fusions(profile: &Profile) -> impl Iterator<Item = Fusion> {
    let has_loops = |fusion: &Fusion| profile.needs_array() || *fusion != Fusion::Half;
    Fusion::ALL.into_iter().filter(move |fusion| has_loops(fusion) && profile.check_fusion(*fusion).is_ok())
}

/// A profile, and the fusion rules by which its firmware matches.
type SampledProfile = (Profile, &'static [Fusion]);

/// The runs of `cargo xtask test`: boards, and the profiles and fusion rules that run there.
///
/// Each kernel for Arm matches blocks by each rule for which it has loops, semi-globally, and with eight views; the portable one
/// shows that it works on a small processor. What does not
/// depend on the kernel runs on one board: confidences, the network. Column tiles and the prior, which the tests on this
/// machine compare with the references, are left to `--all`.
const SAMPLE: [(&EmulatedBoard, &[SampledProfile]); 3] = [
    (&emulated_board::SMALL, &[(profile::QQVGA, &[Fusion::Heuristic])]),
    (
        &emulated_board::REFERENCE,
        &[
            (profile::QQVGA, &[Fusion::Min, Fusion::Mean, Fusion::Heuristic]),
            (profile::QQVGA_SGM_CONFIDENCE, &[Fusion::Mean]),
            (profile::QQVGA_3X3, &[Fusion::Half]),
        ],
    ),
    (
        &emulated_board::VECTORS,
        &[
            (profile::QVGA, &[Fusion::Min, Fusion::Mean, Fusion::Heuristic]),
            (profile::QQVGA_SGM, &[Fusion::Heuristic]),
            (profile::QQVGA_3X3, &[Fusion::Half]),
            (profile::QQVGA_NET, &[Fusion::Trimmed]),
        ],
    ),
];

/// The fusion rules of a profile on a board in the sample.
fn sampled(board: &EmulatedBoard, profile: &Profile) -> &'static [Fusion] {
    let profiles = SAMPLE.iter().find(|(sampled, _)| sampled.name == board.name).map_or(&[][..], |(_, profiles)| profiles);
    profiles.iter().find(|(sampled, _)| sampled.name == profile.name).map_or(&[], |(_, fusions)| fusions)
}

/// The fusion rule of examples.
const EXAMPLE_FUSION: Fusion = rectifying::FUSION;

/// The selection of runs; all by default.
#[derive(Args, Default)]
pub struct Selection {
    /// Only this profile; qqvga-rectified is qqvga with frames in flash that are rectified, and qqvga-sweep the filter over a
    /// sweep's frames
    #[arg(long, value_parser = profile::ALL.iter().map(|profile| profile.name).chain([rectifying::NAME, sweeping::NAME]).collect::<Vec<_>>())]
    profile: Option<String>,
    /// Only this fusion rule
    #[arg(long, value_parser = Fusion::ALL.map(Fusion::name))]
    fusion: Option<String>,
    /// Only this board
    #[arg(long, value_parser = emulated_board::all().map(|board| board.name).collect::<Vec<_>>())]
    board: Option<String>,
    /// Only the runs of `cargo xtask test`, which have each kernel, each matcher and each fusion rule at least once
    #[arg(long, conflicts_with = "fit")]
    sample: bool,
    /// Instead of the profiles, fit the cost model of `multiscopic budget`, write it to host/src/target/measured.toml, and
    /// compare it with other matches; with --board, only for that board's instruction set
    #[arg(long, conflicts_with_all = ["profile", "fusion", "update", "json"])]
    fit: bool,
    /// Record the instructions per disparity evaluation instead of comparing them with the record, and write the measured
    /// memory to host/src/target/measured.toml
    #[arg(long)]
    update: bool,
    /// Write the measurements to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl Selection {
    /// The [sample](SAMPLE).
    pub fn sample() -> Selection {
        Selection { sample: true, ..Selection::default() }
    }

    /// Returns true if nothing is left out: the memory of an instruction set is the most that any of its boards takes.
    fn has_every_run(&self) -> bool {
        self.profile.is_none() && self.fusion.is_none() && self.board.is_none() && !self.sample
    }

    /// The rules that run for a profile on a board.
    fn fusions(&self, board: &EmulatedBoard, profile: &Profile) -> Vec<Fusion> {
        let is_in_sample = |fusion: &Fusion| !self.sample || sampled(board, profile).contains(fusion);
        fusions(profile).filter(|fusion| wanted(&self.fusion, fusion.name()) && is_in_sample(fusion)).collect()
    }

    /// Returns true if a profile runs on a board: both are selected, and the board has enough RAM. The portable kernel, which
    /// every other test runs too, has to show on its processors only that it works there.
    fn has(&self, board: &EmulatedBoard, profile: &Profile) -> bool {
        let is_shown = [profile::QQVGA.name, profile::QVGA_TILED.name].contains(&profile.name);
        wanted(&self.board, board.name)
            && wanted(&self.profile, profile.name)
            && profile.ram_budget <= board.ram
            && (board.processor.has_kernel() || self.board.is_some() || is_shown)
            && !self.fusions(board, profile).is_empty()
    }

    /// Those of `boards` on which an example runs: in the sample on the first, since it does not depend on the kernel.
    fn of_example<const N: usize>(&self, name: &str, boards: [&'static EmulatedBoard; N]) -> Vec<&'static EmulatedBoard> {
        let is_chosen = wanted(&self.profile, name) && wanted(&self.fusion, EXAMPLE_FUSION.name());
        let boards = boards.into_iter().take(if self.sample { 1 } else { N });
        boards.filter(|board| is_chosen && wanted(&self.board, board.name)).collect()
    }
}

/// Returns true if `choice` is `name` or open.
fn wanted(choice: &Option<String>, name: &str) -> bool {
    choice.as_deref().is_none_or(|choice| choice == name)
}

/// The measurements of a run.
#[derive(Debug, Serialize)]
struct Measurement {
    profile: &'static str,
    board: &'static str,
    fusion: &'static str,
    images: &'static str,
    ram_static: usize,
    stack_max: usize,
    ram_total: usize,
    ram_budget: usize,
    /// Code and constants, also those of packets and of the log.
    text: u64,
    flash_budget: usize,
    de: u64,
    instructions: u64,
    instructions_per_de: f64,
    instructions_matching: u64,
    instructions_sending: u64,
    /// `None` if the cost model does not cover the match.
    instructions_predicted: Option<f64>,
    lines_latency: usize,
    identical_to_host: bool,
}

/// A firmware image and its run.
struct Run {
    board: &'static EmulatedBoard,
    profile: Profile,
    fusion: Fusion,
    image: PathBuf,
}

/// Builds the selected firmware, runs it, and reports.
pub fn run(toolchain: &Toolchain, selection: &Selection) -> Result<()> {
    if selection.fit {
        return fit(selection);
    }
    let rectifying_boards = [&emulated_board::REFERENCE, &emulated_board::PICO, &emulated_board::VECTORS];
    let rectifying_boards = selection.of_example(rectifying::NAME, rectifying_boards);
    let sweeping_boards = [&emulated_board::M7, &emulated_board::REFERENCE, &emulated_board::PICO, &emulated_board::VECTORS];
    let sweeping_boards = selection.of_example(sweeping::NAME, sweeping_boards);
    match selection.profile.as_deref() {
        Some(name @ (rectifying::NAME | sweeping::NAME)) => {
            ensure!(
                !(rectifying_boards.is_empty() && sweeping_boards.is_empty()),
                "{name} does not run on this board, or not so"
            );
        }
        _ => run_profiles(toolchain, selection)?,
    }
    if !rectifying_boards.is_empty() {
        rectifying::run(toolchain, &rectifying_boards, selection.update)?;
    }
    if sweeping_boards.is_empty() { Ok(()) } else { sweeping::run(toolchain, &sweeping_boards, selection.update) }
}

fn run_profiles(toolchain: &Toolchain, selection: &Selection) -> Result<()> {
    let counter = Counter::build()?;
    let mut table = MEASURED.clone();
    let runs = build(toolchain, selection)?;
    ensure!(!runs.is_empty(), "no selected board has enough RAM for a selected profile");
    let mut measurements = in_parallel(&runs, |run| {
        let measurement = run.measure(&counter).with_context(|| format!("edge: {}", run.name()))?;
        println!("edge: {}: identical to this machine on {}", run.name(), measurement.images);
        Ok(measurement)
    })?;
    if selection.update {
        if selection.has_every_run() {
            Processor::ALL
                .into_iter()
                .filter(|processor| processor.has_kernel())
                .for_each(|processor| table.of_mut(processor).forget_memory());
        }
        note_memory(&mut table, &runs, &measurements);
        price_fit::write(&table)?;
    }
    for (run, measurement) in runs.iter().zip(&mut measurements) {
        measurement.predict(run, &table);
    }
    print(&measurements);
    if let Some(path) = &selection.json {
        let json = serde_json::to_string_pretty(&measurements)?;
        fs::write(path, json + "\n").with_context(|| format!("cannot write {}", path.display()))?;
    }
    check(&runs, &measurements, &table)?;
    counts::INSTRUCTIONS.hold(&counts(&measurements), selection.update, "cargo xtask edge --update")
}

/// The counts under their names in the record. They depend on the images by less than the record's tolerance.
fn counts(measurements: &[Measurement]) -> Counts {
    let name = |m: &Measurement| format!("{}, {}, {}", m.board, m.profile, m.fusion);
    measurements.iter().map(|m| (name(m), m.instructions_per_de)).collect()
}

/// Fits the cost model on the selected boards, and writes it.
fn fit(selection: &Selection) -> Result<()> {
    let counter = Counter::build()?;
    let compiler = read(&mut command("rustc", ["--version"]))?;
    let mut table = MEASURED.clone();
    table.date = read(&mut command("date", ["-u", "+%Y-%m-%d"]))?;
    table.machine = format!("{}, {compiler}", counter.emulator());
    price_fit::fit_all(&mut table, |board| wanted(&selection.board, board.name), &counter)?;
    price_fit::write(&table)
}

/// Adds the measured memory to the table.
fn note_memory(table: &mut FirmwareCostTable, runs: &[Run], measurements: &[Measurement]) {
    for (run, measurement) in runs.iter().zip(measurements) {
        let processor = run.board.processor;
        let noted = table.of_mut(processor);
        noted.statics = noted.statics.max(measurement.ram_static - run.workspace_bytes());
        let matching = run.profile.matching(run.fusion);
        // The compiler spills a register more or less from one build to the next.
        noted.stack.note(&matching, (measurement.stack_max + 32).next_multiple_of(64));
        noted.flash.note(&matching, measurement.text as usize);
    }
}

/// Builds the selected images, board by board.
fn build(toolchain: &Toolchain, selection: &Selection) -> Result<Vec<Run>> {
    let mut runs = Vec::new();
    for board in emulated_board::all() {
        let profiles = profile::ALL.into_iter().filter(|profile| selection.has(board, profile));
        let matches: Vec<_> = profiles
            .flat_map(|profile| selection.fusions(board, &profile).into_iter().map(move |fusion| (profile, fusion)))
            .collect();
        if matches.is_empty() {
            continue;
        }
        let programs: Vec<_> = matches.iter().map(|(profile, fusion)| Program::of(profile, *fusion)).collect();
        let images = match board.is_arm() {
            true => build::build(toolchain, board, &programs)?,
            false => build::build(&Toolchain::install(&[board.target])?, board, &programs)?,
        };
        runs.extend(matches.into_iter().zip(images).map(|((profile, fusion), image)| Run { board, profile, fusion, image }));
    }
    Ok(runs)
}

impl Run {
    fn name(&self) -> String {
        format!("{} on {}, {}", self.profile.name, self.board.name, self.fusion.name())
    }

    /// Returns true if the cost model covers it.
    fn is_modelled(&self) -> bool {
        let matching = self.profile.matching(self.fusion);
        Workload::new(&matching, self.board.processor).is_some()
    }

    /// The size of its workspace in bytes.
    fn workspace_bytes(&self) -> usize {
        self.profile.matching(self.fusion).lengths().bytes()
    }

    /// Runs the image and measures it. Fails unless its packets equal the host's.
    fn measure(&self, counter: &Counter) -> Result<Measurement> {
        let matching = self.profile.matching(self.fusion);
        let folder = system::edge_target().join("runs").join(self.board.name).join(self.profile.name).join(self.fusion.name());
        let images = ImageSet::tsukuba(&matching).unwrap_or_else(|| ImageSet::demo(&matching));
        images.write(&folder)?;
        let (bytes, received) = self.received(&folder, counter)?;
        let simulation = simulate(&self.profile, self.fusion, &images.frames().planes(), &|| ())?;
        frames::same_lines(&bytes, &simulation.packets)?;
        frames::same(&received.disparities, &images.disparities(&matching)?)?;
        frames::same_confidences(received.confidences.as_ref(), images.confidences(&matching)?.as_ref())?;
        let stack_max = received.stack.context("the firmware did not measure its stack")?;
        let (footprint, instructions) = (Footprint::of(&self.image)?, Instructions::read(&folder)?);
        let ram_static = footprint.ram() as usize;
        Ok(Measurement {
            profile: self.profile.name,
            board: self.board.name,
            fusion: self.fusion.name(),
            images: images.name,
            ram_static,
            stack_max,
            ram_total: ram_static + stack_max,
            ram_budget: self.profile.ram_budget,
            text: footprint.flash(),
            flash_budget: self.profile.flash_budget,
            de: matching.evaluations(),
            instructions: instructions.pipeline(),
            instructions_per_de: instructions.pipeline() as f64 / matching.evaluations() as f64,
            instructions_matching: instructions.matching,
            instructions_sending: instructions.sending,
            instructions_predicted: None,
            lines_latency: matching.latency_lines(),
            identical_to_host: true,
        })
    }

    /// Runs the image in `folder`, and returns its packets as bytes and as a received frame.
    fn received(&self, folder: &Path, counter: &Counter) -> Result<(Vec<u8>, ReceivedFrame)> {
        let packets = folder.join(frame_file::PACKETS.to_str()?);
        if packets.exists() {
            fs::remove_file(&packets)?;
        }
        let plugin = counter.plugin(&self.image)?;
        let exit = emulation::run(self.board, &self.image, &[], folder, Some(&plugin))?;
        ensure!(exit.code == 0, "the firmware ended with exit code {} and printed:\n{}", exit.code, exit.output);
        let bytes = fs::read(&packets).with_context(|| format!("the firmware sent no {}", packets.display()))?;
        let matching = self.profile.matching(self.fusion);
        let received = frames::whole(&bytes, &packets, matching.search()).with_context(|| packets.display().to_string())?;
        Ok((bytes, received))
    }
}

impl Measurement {
    /// Adds the prediction of the cost model.
    fn predict(&mut self, run: &Run, table: &FirmwareCostTable) {
        let processor = run.board.processor;
        let prices = &table.of(processor).prices;
        self.instructions_predicted = prices.instructions(&run.profile.matching(run.fusion), processor);
    }

    /// The error of the prediction, in percent of the measurement.
    fn error(&self) -> Option<f64> {
        Some(100.0 * (self.instructions_predicted? / self.instructions as f64 - 1.0))
    }
}

fn print(measurements: &[Measurement]) {
    println!(
        "\n{:<10} {:<10} {:<9} {:<8} {:>8} {:>6} {:>8} {:>8} {:>7} {:>13} {:>7} {:>8} {:>7} {:>13} {:>6}",
        "board",
        "profile",
        "fusion",
        "images",
        "static",
        "stack",
        "RAM",
        "budget",
        "flash",
        "instructions",
        "per DE",
        "sending",
        "latency",
        "predicted",
        "off"
    );
    for m in measurements {
        println!(
            "{:<10} {:<10} {:<9} {:<8} {:>8} {:>6} {:>8} {:>8} {:>7} {:>13} {:>7.2} {:>8.2} {:>7} {:>13} {:>6}",
            m.board,
            m.profile,
            m.fusion,
            m.images,
            m.ram_static,
            m.stack_max,
            m.ram_total,
            m.ram_budget,
            m.text,
            m.instructions,
            m.instructions_per_de,
            m.instructions_sending as f64 / m.de as f64,
            m.lines_latency,
            m.instructions_predicted.map_or("-".into(), |predicted| format!("{predicted:.0}")),
            m.error().map_or("-".into(), |error| format!("{error:+.1}%"))
        );
    }
    println!("RAM and flash in bytes; DE = pixel x disparity x view; sending: the packets' share of per DE; latency in lines");
}

/// Fails if a run exceeded its profile's budget of RAM or flash, or if the model behind `multiscopic budget` is off.
fn check(runs: &[Run], measurements: &[Measurement], table: &FirmwareCostTable) -> Result<()> {
    let mut wrong = 0;
    let mut fail = |run: &Run, what: String| {
        wrong += 1;
        eprintln!("edge: {}: {what}", run.name());
    };
    for (run, m) in runs.iter().zip(measurements) {
        for (memory, taken, budget) in [("RAM", m.ram_total, m.ram_budget), ("flash", m.text as usize, m.flash_budget)] {
            if taken > budget {
                fail(run, format!("{taken} bytes of {memory}, at most {budget} are allowed"));
            }
        }
        let processor = run.board.processor;
        let measured = table.of(processor);
        let statics = run.workspace_bytes() + measured.statics;
        if m.ram_static != statics {
            fail(run, format!("{} bytes of statics, the formula says {statics}: run cargo xtask edge --update", m.ram_static));
        }
        let matching = run.profile.matching(run.fusion);
        let noted = measured.stack.of(&matching);
        // Stacks differ: where lanes saturate, exact costs need some.
        if m.stack_max > noted || 8 * m.stack_max < 7 * noted {
            let found = m.stack_max;
            fail(run, format!("{found} bytes of stack, budgets are made with {noted}: run cargo xtask edge --update"));
        }
        let noted = measured.flash.of(&matching);
        if m.text as usize > noted + noted / 50 {
            fail(run, format!("{} bytes of flash, budgets are made with {noted}: run cargo xtask edge --update", m.text));
        }
        if m.instructions_predicted.is_none() && run.is_modelled() {
            fail(run, "the cost model has no prices for it: run cargo xtask edge --fit".into());
        }
        if let (Some(predicted), Some(error)) = (m.instructions_predicted, m.error())
            && error.abs() > MOST_OFF
        {
            let found = m.instructions;
            fail(run, format!("{found} instructions, the cost model says {predicted:.0}: run cargo xtask edge --fit"));
        }
    }
    ensure!(wrong == 0, "{wrong} budgets are not met");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    use std::collections::BTreeSet;

    #[test]
    fn the_sample_has_each_profile_and_rule() {
        let runs: Vec<(&EmulatedBoard, &Profile, Fusion)> = SAMPLE
            .iter()
            .flat_map(|(board, profiles)| profiles.iter().map(move |(profile, rules)| (*board, profile, rules)))
            .flat_map(|(board, profile, rules)| rules.iter().map(move |&fusion| (board, profile, fusion)))
            .collect();
        for (board, profile, fusion) in &runs {
            assert!(Selection::sample().has(board, profile), "{} does not run on {}", profile.name, board.name);
            assert!(fusions(profile).any(|rule| rule == *fusion), "{} has no {}", profile.name, fusion.name());
        }
        // Larger frames of what smaller profiles match, and what the tests on this machine compare with the references.
        let left_out = ["vga", "vga-tiled", "qvga-sgm", "qvga-tiled", "qvga-prior", "qvga-confidence"];
        let is_sampled = |name: &&str| !left_out.contains(name);
        let profiles: BTreeSet<&str> = profile::ALL.iter().map(|profile| profile.name).filter(is_sampled).collect();
        assert_eq!(runs.iter().map(|run| run.1.name).collect::<BTreeSet<_>>(), profiles);
        let rules = |board: &EmulatedBoard| -> BTreeSet<&str> {
            runs.iter().filter(|run| run.0.name == board.name).map(|run| run.2.name()).collect()
        };
        assert_eq!(rules(&emulated_board::REFERENCE), Fusion::OF_ANY_COSTS.map(Fusion::name).into());
        assert_eq!(rules(&emulated_board::VECTORS), Fusion::ALL.map(Fusion::name).into());
    }
}
