//! Adds up the cycles that the firmware takes: the price of each block that the emulator ran, times how often it ran.

use anyhow::{Context, Result, ensure};
use clap::Args;
use multiscopic::{Processor, target::MEASURED};
use multiscopic_core::Fusion;
use multiscopic_edge::{Profile, profile};
use std::{collections::BTreeMap, env, fs, path::Path};

use crate::{
    counts::{self, Counts},
    emulation::{
        self,
        build::{self, Program},
        counter::{self, BlockTrace, Counter, Instructions, Succession, TracedBlock},
        emulated_board::{self, EmulatedBoard},
    },
    firmware_checks::{frames::ImageSet, profiles},
    system,
    timing::{self, Disassembly},
    tools::Toolchain,
};

/// The profile whose cycles per instruction `multiscopic budget` uses.
const REFERENCE: Profile = profile::QVGA;

/// The least share of the cycles, in percent, of a function that is printed.
const SHARE: f64 = 3.0;

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

/// The cost of a run, or of a function in it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cost {
    pub instructions: u64,
    pub cycles: u64,
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
                let functions = traced(board, &image, &folder, &counter).context(run.clone())?;
                let total: Cost = functions.values().copied().sum();
                let evaluations = profile.matching(fusion).evaluations() as f64;
                print(&run, total, &functions, evaluations, "evaluation");
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

impl Cost {
    fn cycles_per_instruction(self) -> f64 {
        self.cycles as f64 / self.instructions as f64
    }
}

impl std::iter::Sum for Cost {
    fn sum<I: Iterator<Item = Cost>>(costs: I) -> Cost {
        costs.fold(Cost::default(), |sum, cost| Cost {
            instructions: sum.instructions + cost.instructions,
            cycles: sum.cycles + cost.cycles,
        })
    }
}

/// Runs `image` in `folder`, and returns the cost of each function.
pub fn traced(board: &EmulatedBoard, image: &Path, folder: &Path, counter: &Counter) -> Result<BTreeMap<String, Cost>> {
    let plugin = format!("{},{}", counter.plugin(image)?, counter::TRACE_ARGUMENT);
    let exit = emulation::run(board, image, &[], folder, Some(&plugin))?;
    ensure!(exit.code == 0, "the firmware ended with exit code {} and printed:\n{}", exit.code, exit.output);
    let costs = priced(&counter::read_trace(folder)?, &Disassembly::of(image, board.processor)?, board.processor)?;
    let (traced, counted) = (costs.values().copied().sum::<Cost>().instructions, Instructions::read(folder)?.pipeline());
    ensure!(traced == counted, "the blocks have {traced} instructions, the emulator counted {counted}");
    Ok(costs)
}

/// The cost of each function in `trace`.
fn priced(trace: &BlockTrace, disassembly: &Disassembly, processor: Processor) -> Result<BTreeMap<String, Cost>> {
    let code = |block: TracedBlock| disassembly.code(block.address, block.instructions);
    let pairs: Vec<_> = trace.keys().map(|pair| pair.map(code)).collect();
    let added = timing::added(processor, pairs.iter().map(|pair| pair.each_ref().map(|code| &*code.instructions)))?;
    let mut costs = BTreeMap::<String, Cost>::new();
    for (((&[_, block], &Succession { times, splits }), [before, after]), added) in trace.iter().zip(&pairs).zip(added) {
        let branch = before.instructions.last().filter(|_| before.end != block.address);
        let refill = branch.map_or(0, |branch| timing::refill(processor, branch));
        let cost = costs.entry(disassembly.function(block.address)?.to_owned()).or_default();
        cost.instructions += times * after.instructions.len() as u64;
        cost.cycles += times * (added + refill) + splits * timing::split(processor);
    }
    Ok(costs)
}

/// Prints the cost of a run and of its most expensive functions.
pub fn print(run: &str, total: Cost, functions: &BTreeMap<String, Cost>, evaluations: f64, unit: &str) {
    let line = |cost: Cost, name: &str| {
        let [instructions, cycles] = [cost.instructions, cost.cycles].map(|count| count as f64 / evaluations);
        let name = name.rsplit_once("::h").map_or(name, |(name, _)| name);
        println!("{instructions:>9.3} {cycles:>9.3} {:>9.2}  {name}", cost.cycles_per_instruction());
    };
    println!("cycles: {run}: instructions and cycles per {unit}, cycles per instruction");
    line(total, "all");
    let mut functions: Vec<_> =
        functions.iter().filter(|(_, cost)| 100.0 * cost.cycles as f64 > SHARE * total.cycles as f64).collect();
    functions.sort_by_key(|(_, cost)| std::cmp::Reverse(cost.cycles));
    functions.iter().for_each(|(name, cost)| line(**cost, name));
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
