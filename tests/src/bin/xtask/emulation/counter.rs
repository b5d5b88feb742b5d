//! Counts the firmware's instructions by phase, and traces its blocks, with a plugin of the emulator.

use anyhow::{Context, Result, ensure};
use object::{Object, ObjectSymbol, read::elf::ElfFile32};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    env, fs,
    path::{Path, PathBuf},
};

use crate::{
    system::{self, read, run},
    tools,
};

/// The functions that mark the beginning of a phase.
const PHASES: [&str; 4] = ["phase_idle", "phase_matching", "phase_fetching", "phase_sending"];

/// The phases of the pipeline: all but fetching lines, whose cost depends on where they are stored.
const PIPELINE: [&str; 2] = ["phase_matching", "phase_sending"];

/// The file to which the plugin writes counts.
const REPORT: &str = "instructions.txt";

/// The plugin, compiled for the installed emulator.
pub struct Counter {
    library: PathBuf,
    emulator: String,
}

/// Instructions by phase.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Instructions {
    /// Matching.
    pub matching: u64,
    /// Fetching lines.
    pub fetching: u64,
    /// Encoding and sending disparity lines.
    pub sending: u64,
}

impl Counter {
    /// Compiles the plugin.
    pub fn build() -> Result<Counter> {
        let library = system::edge_target().join("libcount.so");
        let emulator = read(&mut tools::QEMU.install()?.command(&["--version"])?)?;
        let version = format!("-DQEMU_PLUGIN_VERSION={}", interface(&emulator)?);
        let mut cc = tools::CC.install()?.command(&["-O2", "-Wall", "-shared", "-fPIC", &version])?;
        if env::consts::OS == "macos" {
            cc.arg("-Wl,-undefined,dynamic_lookup");
        }
        fs::create_dir_all(system::edge_target())?;
        run(cc.arg(system::root().join("tests/emulator/count.c")).arg("-o").arg(&library))?;
        let emulator = emulator.lines().next().unwrap_or_default().to_owned();
        Ok(Counter { library, emulator })
    }

    /// The emulator's name and version.
    pub fn emulator(&self) -> &str {
        &self.emulator
    }

    /// The emulator's argument that counts instructions in `image`.
    pub fn plugin(&self, image: &Path) -> Result<String> {
        let bytes = fs::read(image).with_context(|| format!("cannot read {}", image.display()))?;
        let elf = ElfFile32::<object::Endianness>::parse(&*bytes).with_context(|| image.display().to_string())?;
        PHASES.iter().try_fold(format!("{},to={REPORT}", self.library.display()), |argument, name| {
            let symbol = elf.symbol_by_name(name).with_context(|| format!("{} has no function {name}", image.display()))?;
            Ok(format!("{argument},phase={:#x}", symbol.address()))
        })
    }
}

impl Instructions {
    /// Reads the plugin's report in `folder`.
    pub fn read(folder: &Path) -> Result<Instructions> {
        let path = folder.join(REPORT);
        let report = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let counts =
            report.lines().map(str::parse).collect::<Result<Vec<u64>, _>>().with_context(|| path.display().to_string())?;
        ensure!(counts.len() == PHASES.len(), "{} has {} lines, expected {}", path.display(), counts.len(), PHASES.len());
        Ok(Instructions { matching: counts[1], fetching: counts[2], sending: counts[3] })
    }

    /// Those of the [pipeline](PIPELINE).
    pub fn pipeline(&self) -> u64 {
        self.matching + self.sending
    }
}

/// The version of the plugin interface of the emulator that reports `version`.
fn interface(version: &str) -> Result<u32> {
    let number = version.split_whitespace().find(|word| word.starts_with(|first: char| first.is_ascii_digit()));
    let major = number.and_then(|number| number.split('.').next()?.parse::<u32>().ok());
    let major = major.with_context(|| format!("no version in {version:?}"))?;
    Ok(if major < 9 { 1 } else { 2 })
}

/// The file to which the plugin writes the trace.
const TRACE_REPORT: &str = "blocks.txt";

/// The plugin's argument that asks for the trace.
pub const TRACE_ARGUMENT: &str = "blocks=blocks.txt";

/// A stretch of instructions without a branch, or with one at its end. It ends with a page of memory too.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TracedBlock {
    /// The address of its first instruction.
    pub address: u64,
    /// The number of its instructions.
    pub instructions: usize,
}

/// The runs of one block right after another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Succession {
    /// The number of these runs.
    pub times: u64,
    /// The additional accesses to memory, of all these times together, if each access to an unaligned address is split
    /// into aligned ones.
    pub splits: u64,
}

/// The blocks of the [pipeline](PIPELINE) that ran after each other.
pub type BlockTrace = BTreeMap<[TracedBlock; 2], Succession>;

/// Reads the plugin's report in `folder`.
pub fn read_trace(folder: &Path) -> Result<BlockTrace> {
    let path = folder.join(TRACE_REPORT);
    let report = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    parse_trace(&report).with_context(|| format!("{} is not a trace of blocks", path.display()))
}

fn parse_trace(report: &str) -> Option<BlockTrace> {
    let mut trace = BlockTrace::new();
    for line in report.lines() {
        let [phase, from, from_instructions, to, to_instructions, times, splits] = *line.split(' ').collect::<Vec<_>>() else {
            return None;
        };
        let pair = [block(from, from_instructions)?, block(to, to_instructions)?];
        if PIPELINE.contains(PHASES.get(phase.parse::<usize>().ok()?)?) {
            // The emulator translates a block again if the processor's mode differs.
            let succession = trace.entry(pair).or_default();
            succession.times += times.parse::<u64>().ok()?;
            succession.splits += splits.parse::<u64>().ok()?;
        }
    }
    Some(trace)
}

fn block(address: &str, instructions: &str) -> Option<TracedBlock> {
    Some(TracedBlock { address: u64::from_str_radix(address, 16).ok()?, instructions: instructions.parse().ok()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interface_follows_the_emulators_version() {
        assert_eq!(interface("QEMU emulator version 7.2.19 (Debian 1:7.2+dfsg-7)\nCopyright (c)").unwrap(), 1);
        assert_eq!(interface("QEMU emulator version 10.0.2").unwrap(), 2);
        assert!(interface("QEMU").is_err());
    }

    #[test]
    fn the_pipelines_blocks_are_added_up() {
        let report = "1 a0 3 b0 4 5 1\n3 a0 3 b0 4 6 2\n2 a0 3 b0 4 7 0\n1 b0 4 a0 3 9 0\n";
        let [first, second] = [TracedBlock { address: 0xa0, instructions: 3 }, TracedBlock { address: 0xb0, instructions: 4 }];
        let (there, back) = (Succession { times: 11, splits: 3 }, Succession { times: 9, splits: 0 });
        assert_eq!(parse_trace(report).unwrap(), BlockTrace::from([([first, second], there), ([second, first], back)]));
        assert!(parse_trace("1 a0 3 5\n").is_none() && parse_trace("9 a0 3 b0 4 5 0\n").is_none());
    }
}
