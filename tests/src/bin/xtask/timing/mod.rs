//! The cycles that sequences of instructions take, with memory that never waits: the choice between the models of the processors,
//! and the cycles that taken branches and unaligned accesses add.
//!
//! The Cortex-M4 takes one instruction after another, and its manual gives every instruction's cycles. LLVM's model knows it too,
//! but not the registers of a multiple transfer, nor that an isolated load takes two cycles. The Cortex-M7 and M55 overlap
//! instructions: they have LLVM's scheduling models, which `llvm-mca` runs instructions through.

pub mod disassembly;

use anyhow::{Context, Result, ensure};
use multiscopic::Processor;
use serde_json::Value;
use std::{collections::BTreeMap, fmt::Write, fs};

use self::disassembly::Instruction;
use crate::{system, tools};

/// The cycles that the second sequence of each of `pairs` adds to the first, so that what overlaps between the two is
/// counted once. Taken branches and split accesses are not in them, nor are wait states, caches and wrong predictions.
pub fn added<'a>(processor: Processor, pairs: impl Iterator<Item = [&'a [&'a Instruction]; 2]>) -> Result<Vec<u64>> {
    let sequences: Vec<_> = pairs.flat_map(|pair| [pair[0].to_vec(), pair.concat()]).collect();
    let cycles = match processor {
        Processor::CortexM4 | Processor::CortexM33 => sequences.iter().map(|sequence| cortex_m4_cycles(sequence)).collect(),
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

/// Cycles of a division, which takes 2 to 12 cycles by its operands.
const DIVISION: u64 = 7;

/// The cycles of `sequence` by Arm's Cortex-M4 Technical Reference Manual, table 3-1.
fn cortex_m4_cycles(sequence: &[&Instruction]) -> u64 {
    let next = sequence.iter().skip(1).map(Some).chain([None]);
    sequence.iter().zip(next).map(|(instruction, next)| alone(instruction) + wait(instruction, next.copied())).sum()
}

fn alone(instruction: &Instruction) -> u64 {
    match instruction.transfers() {
        Some(registers) => 1 + registers,
        None if instruction.name().contains("div") => DIVISION,
        None => 1,
    }
}

/// The second cycle of a load, which only a load or store of one register overlaps.
fn wait(instruction: &Instruction, next: Option<&Instruction>) -> u64 {
    let waits = instruction.is_load() && next.is_some_and(|next| !next.is_load() && !next.is_store());
    u64::from(waits)
}

/// A processor that LLVM has a model of.
#[derive(Debug)]
struct SchedulingModel {
    /// LLVM's name of the processor.
    cpu: &'static str,
    /// LLVM's name of the instruction set.
    triple: &'static str,
    /// True if a base register is written before anything else. `llvm-mca` lets no instruction write before an
    /// older one, so it would not pair such instructions, as the processor does.
    early_bases: bool,
}

/// The Cortex-M7.
const CORTEX_M7: SchedulingModel = SchedulingModel { cpu: "cortex-m7", triple: "thumbv7em-none-eabihf", early_bases: true };

/// The Cortex-M55.
const CORTEX_M55: SchedulingModel =
    SchedulingModel { cpu: "cortex-m55", triple: "thumbv8.1m.main-none-eabihf", early_bases: false };

/// Instructions that the models do not know, and which take no cycle of their own: those of low-overhead loops, and
/// on a Cortex-M7 conditions.
const FREE: [&str; 7] = ["it", "le", "dls", "wls", "letp", "dlstp", "wlstp"];

/// Registers that a multiple transfer moves in a cycle. The models count all of them as one.
const REGISTERS_PER_CYCLE: u64 = 2;

impl SchedulingModel {
    /// The cycles of each of `sequences`, from an empty pipeline to the end of the last instruction.
    fn cycles(&self, sequences: &[Vec<&Instruction>]) -> Result<Vec<u64>> {
        let modelled = self.modelled(&self.assembly(sequences)?)?;
        // A sequence of free instructions alone is not in the report.
        let of = |(i, sequence): (usize, &Vec<&Instruction>)| modelled.get(&i).unwrap_or(&0) + transfers(sequence);
        Ok(sequences.iter().enumerate().map(of).collect())
    }

    /// A region of assembly for each sequence, named by its index.
    fn assembly(&self, sequences: &[Vec<&Instruction>]) -> Result<String> {
        let mut text = ".syntax unified\n.thumb\n".to_owned();
        for (i, sequence) in sequences.iter().enumerate() {
            writeln!(text, "# LLVM-MCA-BEGIN {i}")?;
            for instruction in sequence {
                match self.early_bases {
                    true => writeln!(text, "{}", without_base_update(instruction.text()))?,
                    false => writeln!(text, "{}", instruction.text())?,
                }
            }
            writeln!(text, "# LLVM-MCA-END")?;
        }
        Ok(text)
    }

    /// Cycles by region of `assembly`.
    fn modelled(&self, assembly: &str) -> Result<BTreeMap<usize, u64>> {
        let file = system::edge_target().join(self.cpu).with_extension("s");
        fs::write(&file, assembly).with_context(|| format!("cannot write {}", file.display()))?;
        let mut mca = tools::LLVM_MCA.install()?.command(&["--json", "--iterations=1", "--all-views=false", "--summary-view"])?;
        mca.args(["--call-latency=0", "--skip-unsupported-instructions=lack-sched"]);
        mca.arg(format!("--mcpu={}", self.cpu)).arg(format!("--mtriple={}", self.triple)).arg(&file);
        let output = mca.output().context("cannot start llvm-mca")?;
        let warnings = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "llvm-mca failed on {}: {warnings}", file.display());
        for skipped in warnings.lines().filter_map(|line| line.strip_prefix("note: instruction:")) {
            let skipped = Instruction::new(skipped);
            let is_free = skipped.conditions() > 0 || FREE.contains(&skipped.name());
            ensure!(is_free, "LLVM's model of the {} does not know `{}`", self.cpu, skipped.text());
        }
        let report: Value = serde_json::from_slice(&output.stdout).context("the report of llvm-mca")?;
        let regions = report["CodeRegions"].as_array().context("llvm-mca reports no regions")?;
        regions.iter().map(|region| region_cycles(region).with_context(|| format!("llvm-mca reports {region}"))).collect()
    }
}

/// The name and the cycles of a region in the report.
fn region_cycles(region: &Value) -> Option<(usize, u64)> {
    Some((region["Name"].as_str()?.parse().ok()?, region["SummaryView"]["TotalCycles"].as_u64()?))
}

/// The cycles of multiple transfers beyond the first.
fn transfers(sequence: &[&Instruction]) -> u64 {
    let registers = sequence.iter().filter_map(|instruction| instruction.transfers());
    registers.map(|registers| registers.div_ceil(REGISTERS_PER_CYCLE) - 1).sum()
}

/// `ldr r0, [r1]` of `ldr r0, [r1], #4`, `ldm r0, {r1}` of `ldm r0!, {r1}`.
fn without_base_update(text: &str) -> String {
    let text = text.replace('!', "");
    match text.find("], #") {
        Some(address) => text[..=address].to_owned(),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loads_in_a_row_overlap() {
        let cycles = |lines: &[&str]| {
            let sequence: Vec<_> = lines.iter().map(|line| Instruction::new(line)).collect();
            cortex_m4_cycles(&sequence.iter().collect::<Vec<_>>())
        };
        let (load, add) = ("ldr r0, [r1]", "add r2, r3");
        assert_eq!(cycles(&[load, add]), 3);
        assert_eq!(cycles(&[load, load, load, add]), 5);
        assert_eq!(cycles(&[load, "str r0, [r2]", add]), 3);
        assert_eq!(cycles(&["ldm r0!, {r4, r5, r6, r7}", "ldrd r2, r3, [sp]"]), 5 + 3);
        assert_eq!(cycles(&[]), 0);
    }

    #[test]
    fn base_updates_are_dropped() {
        for (text, without) in [
            ("ldr r0, [r1], #4", "ldr r0, [r1]"),
            ("ldr r0, [r1, #4]!", "ldr r0, [r1, #4]"),
            ("stm.w r0!, {r1, r2}", "stm.w r0, {r1, r2}"),
            ("ldr r0, [r1, r2, lsl #2]", "ldr r0, [r1, r2, lsl #2]"),
        ] {
            assert_eq!(without_base_update(text), without);
        }
    }

    #[test]
    fn two_registers_move_in_a_cycle() {
        let extra = |line| transfers(&[&Instruction::new(line)]);
        assert_eq!((extra("ldm r0, {r1, r2, r3, r4}"), extra("pop {r4, r5, pc}"), extra("ldrd r0, r1, [sp]")), (1, 1, 0));
    }
}
