//! The cost of instructions on each processor.

use anyhow::{Context, Result};
use multiscopic::Processor;

use super::{
    cortex_m4,
    instruction::Instruction,
    scheduling_model::{CORTEX_M7, CORTEX_M55},
};

/// The cycles that the second sequence of each of `pairs` adds to the first, so that what overlaps between the two is
/// counted once. Taken branches and split accesses are not in them, nor are wait states, caches and wrong predictions.
pub fn added<'a>(processor: Processor, pairs: impl Iterator<Item = [&'a [&'a Instruction]; 2]>) -> Result<Vec<u64>> {
    let sequences: Vec<_> = pairs.flat_map(|pair| [pair[0].to_vec(), pair.concat()]).collect();
    let cycles = match processor {
        Processor::CortexM4 | Processor::CortexM33 => sequences.iter().map(|sequence| cortex_m4::cycles(sequence)).collect(),
        Processor::CortexM7 => CORTEX_M7.cycles(&sequences)?,
        Processor::CortexM55 => CORTEX_M55.cycles(&sequences)?,
    };
    let added = |pair: &[u64]| pair[1].checked_sub(pair[0]).context("more instructions take fewer cycles");
    cycles.chunks_exact(2).map(added).collect()
}

/// The cycles that refill the pipeline after `branch` is taken.
pub fn refill(processor: Processor, branch: &Instruction) -> u64 {
    match processor {
        // Arm's manual says 1 to 3, by the alignment and width of the target.
        Processor::CortexM4 | Processor::CortexM33 => 2,
        // Branches are predicted.
        Processor::CortexM7 => 0,
        // The end of a low-overhead loop fetches the loop's beginning in advance.
        Processor::CortexM55 if branch.name() == "le" => 0,
        // LLVM's penalty of a branch that is not predicted.
        Processor::CortexM55 => 3,
    }
}

/// The cycles of an additional access to memory, if an unaligned one is split into aligned ones.
pub fn split(processor: Processor) -> u64 {
    match processor {
        Processor::CortexM4 | Processor::CortexM33 => 1,
        // 64 bits wide, they load most unaligned words at once. How many they do not is left out.
        Processor::CortexM7 | Processor::CortexM55 => 0,
    }
}
