//! Adds up the cycles that the firmware takes: the price of each block that the emulator ran, times how often it ran.

use anyhow::{Context, Result, ensure};
use clap::Args;
use multiscopic::target::MEASURED;
use multiscopic_edge::{Profile, profile};
use std::{env, fs};

use crate::{
    counts::{self, Counts},
    emulation::{
        build::{self, Program},
        counter::Counter,
        emulated_board::{self, EmulatedBoard},
    },
    firmware_checks::{
        frames::ImageSet,
        profiles,
        traced_cost::{self, Cost},
    },
    system,
    tools::Toolchain,
};

/// The profile whose cycles per instruction `multiscopic budget` uses.
const REFERENCE: Profile = profile::QVGA;

/// The profile to run, and the use of the cycles.
#[derive(Args)]
pub struct Accounting {
    /// The profile
    #[arg(long, default_value = REFERENCE.name, value_parser = profile::ALL.map(|profile| profile.name))]
    profile: String,
    /// Only this board, one per processor
    #[arg(long, value_parser = emulated_board::one_per_processor().map(|(_, board)| board.name).collect::<Vec<_>>())]
    board: Option<String>,
    /// Record the cycles instead of comparing them with the record. With the default profile, also write the cycles
    /// per instruction to host/src/target/measured.toml
    #[arg(long)]
    update: bool,
}

impl Accounting {
    /// The default profile, compared.
    pub fn compare() -> Accounting {
        Accounting { profile: REFERENCE.name.to_owned(), board: None, update: false }
    }

    /// Runs the profile on one board per processor, and compares or records its cycles.
    pub fn run(&self, toolchain: &Toolchain) -> Result<()> {
        if env::consts::OS != "linux" {
            println!("cycles: skipped, LLVM's tools are installed on Linux alone");
            return Ok(());
        }
        let profile = profile::ALL.into_iter().find(|profile| profile.name == self.profile).context("no such profile")?;
        let counter = Counter::build()?;
        let (mut counts, mut ratios) = (Counts::new(), Counts::new());
        let is_wanted = |board: &EmulatedBoard| self.board.as_deref().is_none_or(|name| name == board.name);
        let boards = emulated_board::one_per_processor().filter(|(_, board)| is_wanted(board) && profile.ram_budget <= board.ram);
        for (processor, board) in boards {
            let mut sum = Cost::default();
            for fusion in profiles::fusions(&profile) {
                let run = format!("{}, {}, {}", board.name, profile.name, fusion.name());
                let image = build::build(toolchain, board, &[Program::of(&profile, fusion)])?.pop().context("one image")?;
                let folder = system::edge_target().join("runs").join("cycles").join(board.name).join(profile.name);
                let folder = folder.join(fusion.name());
                ImageSet::demo(&profile.matching(fusion)).write(&folder)?;
                let functions = traced_cost::traced(board, &image, &folder, &counter).context(run.clone())?;
                let total: Cost = functions.values().copied().sum();
                let evaluations = profile.matching(fusion).evaluations() as f64;
                traced_cost::print(&run, total, &functions, evaluations, "evaluation");
                counts.insert(run, total.cycles as f64 / evaluations);
                sum = [sum, total].into_iter().sum();
            }
            ratios.insert(processor.name().to_owned(), sum.cycles_per_instruction());
        }
        ensure!(!counts.is_empty(), "no board has enough RAM for {}", profile.name);
        counts::CYCLES.hold(&counts, self.update, &format!("cargo xtask cycles --profile {} --update", profile.name))?;
        match profile.name == REFERENCE.name {
            true => hold_ratios(&ratios, self.update),
            false => Ok(()),
        }
    }
}

/// Compares the cycles per instruction of each processor with those of `multiscopic budget`, or writes them for it.
fn hold_ratios(ratios: &Counts, update: bool) -> Result<()> {
    if !update {
        return counts::compare(ratios, &MEASURED.cycles_per_instruction).context("cycles per instruction of `budget`");
    }
    let rounded = ratios.iter().map(|(processor, ratio)| (processor.clone(), (ratio * 1e2).round() / 1e2));
    let mut table = MEASURED.clone();
    table.cycles_per_instruction.extend(rounded);
    fs::write(system::root().join("host/src/target/measured.toml"), table.to_toml())?;
    Ok(())
}
