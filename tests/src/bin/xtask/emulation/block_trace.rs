//! The blocks of a firmware image that ran, each with the block before it.

use anyhow::{Context, Result};
use std::{collections::BTreeMap, fs, path::Path};

use super::counter::{PHASES, PIPELINE};

/// The file that the plugin writes.
const REPORT: &str = "blocks.txt";

/// The plugin's argument that asks for the trace.
pub const ARGUMENT: &str = "blocks=blocks.txt";

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
pub fn read(folder: &Path) -> Result<BlockTrace> {
    let path = folder.join(REPORT);
    let report = fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    parse(&report).with_context(|| format!("{} is not a trace of blocks", path.display()))
}

fn parse(report: &str) -> Option<BlockTrace> {
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
    fn the_pipelines_blocks_are_added_up() {
        let report = "1 a0 3 b0 4 5 1\n3 a0 3 b0 4 6 2\n2 a0 3 b0 4 7 0\n1 b0 4 a0 3 9 0\n";
        let [first, second] = [TracedBlock { address: 0xa0, instructions: 3 }, TracedBlock { address: 0xb0, instructions: 4 }];
        let (there, back) = (Succession { times: 11, splits: 3 }, Succession { times: 9, splits: 0 });
        assert_eq!(parse(report).unwrap(), BlockTrace::from([([first, second], there), ([second, first], back)]));
        assert!(parse("1 a0 3 5\n").is_none() && parse("9 a0 3 b0 4 5 0\n").is_none());
    }
}
