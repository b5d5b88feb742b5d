//! Runs the firmware in the emulator, compares what it sends with what this machine computes, and measures it.

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use multiscopic_core::Fusion;
use multiscopic_edge::{Profile, frame_file, profile};
use serde::Serialize;
use std::{
    fs,
    path::{Path, PathBuf},
    sync::Mutex,
    thread,
};

use crate::{
    board::{self, Board},
    counter::{Counter, Instructions},
    emulator,
    firmware::{self, Program},
    footprint::Footprint,
    image_set::ImageSet,
    layout,
    received::Received,
    toolchain::Toolchain,
};

/// How many emulators run at a time.
const AT_A_TIME: usize = 2;

/// What is run: everything, or what is named.
#[derive(Args, Default)]
pub struct Selection {
    /// Only this profile
    #[arg(long, value_parser = profile::ALL.map(|profile| profile.name))]
    profile: Option<String>,
    /// Only this rule of fusion
    #[arg(long, value_parser = Fusion::ALL.map(Fusion::name))]
    fusion: Option<String>,
    /// Only this board
    #[arg(long, value_parser = board::ALL.map(|board| board.name))]
    board: Option<String>,
    /// Write the measurements to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

impl Selection {
    /// Whether a profile is to run on a board, which must have the RAM for it.
    fn has(&self, board: &Board, profile: &Profile) -> bool {
        wanted(&self.board, board.name) && wanted(&self.profile, profile.name) && profile.ram_budget <= board.ram
    }
}

/// Whether a choice, if there is one, is this name.
fn wanted(choice: &Option<String>, name: &str) -> bool {
    choice.as_deref().is_none_or(|choice| choice == name)
}

/// What a run measured.
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
    text: u64,
    de: u64,
    instructions: u64,
    instructions_per_de: f64,
    instructions_matching: u64,
    instructions_sending: u64,
    lines_latency: usize,
    identical_to_host: bool,
}

/// An image and how it is run.
struct Run {
    board: &'static Board,
    profile: Profile,
    fusion: Fusion,
    image: PathBuf,
}

/// Builds the firmware, runs it, and reports.
pub fn run(toolchain: &Toolchain, selection: &Selection) -> Result<()> {
    let counter = Counter::build()?;
    let runs = build(toolchain, selection)?;
    ensure!(!runs.is_empty(), "no board of the selection can hold a profile of it");
    let mut measurements = measure_all(&runs, &counter)?;
    measurements.sort_by_key(|measurement| {
        runs.iter().position(|run| (run.board.name, run.profile.name, run.fusion.name()) == measurement.key())
    });
    print(&measurements);
    if let Some(path) = &selection.json {
        let json = serde_json::to_string_pretty(&measurements)?;
        fs::write(path, json + "\n").with_context(|| format!("cannot write {}", path.display()))?;
    }
    check(&measurements)
}

/// Builds the images of `selection`, board by board.
fn build(toolchain: &Toolchain, selection: &Selection) -> Result<Vec<Run>> {
    let mut runs = Vec::new();
    for board in &board::ALL {
        let profiles: Vec<_> = profile::ALL.into_iter().filter(|profile| selection.has(board, profile)).collect();
        if profiles.is_empty() {
            continue;
        }
        let programs: Vec<_> = profiles.iter().map(|profile| Program::Profile(profile.name)).collect();
        for (profile, image) in profiles.into_iter().zip(firmware::build(toolchain, board, &programs)?) {
            let fusions = Fusion::ALL.into_iter().filter(|fusion| wanted(&selection.fusion, fusion.name()));
            runs.extend(fusions.map(|fusion| Run { board, profile, fusion, image: image.clone() }));
        }
    }
    Ok(runs)
}

/// Measures `runs`, a few at a time.
fn measure_all(runs: &[Run], counter: &Counter) -> Result<Vec<Measurement>> {
    let (next, measurements) = (Mutex::new(runs.iter()), Mutex::new(Vec::new()));
    let take = || next.lock().expect("no thread panics here").next();
    let work = || -> Result<()> {
        while let Some(run) = take() {
            let measurement = run.measure(counter).with_context(|| format!("edge: {}", run.name()))?;
            println!("edge: {}: identical to this machine on {}", run.name(), measurement.images);
            measurements.lock().expect("no thread panics here").push(measurement);
        }
        Ok(())
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..AT_A_TIME).map(|_| scope.spawn(work)).collect();
        workers.into_iter().try_for_each(|worker| worker.join().expect("no thread panics here"))
    })?;
    Ok(measurements.into_inner()?)
}

impl Run {
    fn name(&self) -> String {
        format!("{} on {}, {}", self.profile.name, self.board.name, self.fusion.name())
    }

    /// Runs the image. What it sends must be what this machine computes.
    fn measure(&self, counter: &Counter) -> Result<Measurement> {
        let params = self.profile.params(self.fusion);
        let folder = layout::edge_target().join("runs").join(self.board.name).join(self.profile.name).join(self.fusion.name());
        let images = ImageSet::tsukuba(&params).unwrap_or_else(|| ImageSet::demo(&params));
        images.write(&folder)?;
        let received = self.received(&folder, counter)?;
        received.same_as(&images.disparities(&params)?, params.width())?;
        let (footprint, instructions) = (Footprint::of(&self.image)?, Instructions::read(&folder)?);
        let ram_static = footprint.ram() as usize;
        Ok(Measurement {
            profile: self.profile.name,
            board: self.board.name,
            fusion: self.fusion.name(),
            images: images.name,
            ram_static,
            stack_max: received.stack,
            ram_total: ram_static + received.stack,
            ram_budget: self.profile.ram_budget,
            text: footprint.text,
            de: params.evaluations(),
            instructions: instructions.pipeline(),
            instructions_per_de: instructions.pipeline() as f64 / params.evaluations() as f64,
            instructions_matching: instructions.matching,
            instructions_sending: instructions.sending,
            lines_latency: params.latency_lines(),
            identical_to_host: true,
        })
    }

    /// What the image sends as it is run in `folder`.
    fn received(&self, folder: &Path, counter: &Counter) -> Result<Received> {
        let packets = folder.join(frame_file::PACKETS.to_str()?);
        if packets.exists() {
            fs::remove_file(&packets)?;
        }
        let plugin = counter.plugin(&self.image)?;
        let end = emulator::run(self.board, &self.image, self.fusion.name(), folder, Some(&plugin))?;
        ensure!(end.code == 0, "the firmware ended with exit code {} and said:\n{}", end.code, end.words);
        let bytes = fs::read(&packets).with_context(|| format!("the firmware sent no {}", packets.display()))?;
        Received::decode(bytes, &self.profile.params(self.fusion)).with_context(|| packets.display().to_string())
    }
}

impl Measurement {
    fn key(&self) -> (&str, &str, &str) {
        (self.board, self.profile, self.fusion)
    }

    fn fits(&self) -> bool {
        self.ram_total <= self.ram_budget
    }
}

fn print(measurements: &[Measurement]) {
    println!(
        "\n{:<10} {:<10} {:<9} {:<8} {:>8} {:>6} {:>8} {:>8} {:>7} {:>13} {:>7} {:>8} {:>7}",
        "board",
        "profile",
        "fusion",
        "images",
        "static",
        "stack",
        "RAM",
        "budget",
        "text",
        "instructions",
        "per DE",
        "sending",
        "latency"
    );
    for m in measurements {
        println!(
            "{:<10} {:<10} {:<9} {:<8} {:>8} {:>6} {:>8} {:>8} {:>7} {:>13} {:>7.2} {:>8.2} {:>7}",
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
            m.lines_latency
        );
    }
    println!("RAM and text in bytes; DE = pixel x disparity x view; sending = for the packets, within per DE; latency in lines");
}

/// Fails if a run took more RAM than its profile may.
fn check(measurements: &[Measurement]) -> Result<()> {
    let over: Vec<_> = measurements.iter().filter(|measurement| !measurement.fits()).collect();
    for m in &over {
        eprintln!(
            "edge: {} on {}, {}: {} bytes of RAM, at most {} are allowed",
            m.profile, m.board, m.fusion, m.ram_total, m.ram_budget
        );
    }
    if over.is_empty() { Ok(()) } else { bail!("{} runs take too much RAM", over.len()) }
}
