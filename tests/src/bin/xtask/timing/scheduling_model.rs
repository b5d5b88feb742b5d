//! LLVM's scheduling models, which `llvm-mca` runs instructions through.

use anyhow::{Context, Result, ensure};
use serde_json::Value;
use std::{collections::BTreeMap, fmt::Write, fs};

use super::instruction::Instruction;
use crate::{system::folders, tools::tool};

/// A processor that LLVM has a model of.
#[derive(Debug)]
pub struct SchedulingModel {
    /// LLVM's name of the processor.
    pub cpu: &'static str,
    /// LLVM's name of the instruction set.
    pub triple: &'static str,
    /// True if a base register is written before anything else. `llvm-mca` lets no instruction write before an
    /// older one, so it would not pair such instructions, as the processor does.
    pub early_bases: bool,
}

/// The Cortex-M7.
pub const CORTEX_M7: SchedulingModel = SchedulingModel { cpu: "cortex-m7", triple: "thumbv7em-none-eabihf", early_bases: true };

/// The Cortex-M55.
pub const CORTEX_M55: SchedulingModel =
    SchedulingModel { cpu: "cortex-m55", triple: "thumbv8.1m.main-none-eabihf", early_bases: false };

/// Instructions that the models do not know, and which take no cycle of their own: those of low-overhead loops, and
/// on a Cortex-M7 conditions.
const FREE: [&str; 7] = ["it", "le", "dls", "wls", "letp", "dlstp", "wlstp"];

/// Registers that a multiple transfer moves in a cycle. The models count all of them as one.
const REGISTERS_PER_CYCLE: u64 = 2;

impl SchedulingModel {
    /// The cycles of each of `sequences`, from an empty pipeline to the end of the last instruction.
    pub fn cycles(&self, sequences: &[Vec<&Instruction>]) -> Result<Vec<u64>> {
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
        let file = folders::edge_target().join(self.cpu).with_extension("s");
        fs::write(&file, assembly).with_context(|| format!("cannot write {}", file.display()))?;
        let mut mca = tool::LLVM_MCA.install()?.command(&["--json", "--iterations=1", "--all-views=false", "--summary-view"])?;
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
        regions.iter().map(|region| cycles(region).with_context(|| format!("llvm-mca reports {region}"))).collect()
    }
}

/// The name and the cycles of a region in the report.
fn cycles(region: &Value) -> Option<(usize, u64)> {
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
