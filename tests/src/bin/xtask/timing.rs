//! The cycles that sequences of instructions take, with memory that never waits: the instructions of a firmware image, the choice
//! between the models of the processors, and the cycles that taken branches and unaligned accesses add.
//!
//! The Cortex-M4 takes one instruction after another, and its manual gives every instruction's cycles. LLVM's model knows it too,
//! but not the registers of a multiple transfer, nor that an isolated load takes two cycles. The Cortex-M7 and M55 overlap
//! instructions: they have LLVM's scheduling models, which `llvm-mca` runs instructions through.

use anyhow::{Context, Result, bail, ensure};
use multiscopic::Processor;
use serde_json::Value;
use std::{collections::BTreeMap, fmt::Write, fs, path::Path};

use crate::{
    system::{self, read},
    tools,
};

/// The instructions and functions of an image by address.
#[derive(Debug, Default)]
pub struct Disassembly {
    lines: BTreeMap<u64, Line>,
    functions: BTreeMap<u64, String>,
}

#[derive(Debug)]
struct Line {
    instruction: Instruction,
    /// The address of the instruction that it is conditional on, or its own.
    group: u64,
}

/// Instructions in the order of their addresses.
pub struct Code<'a> {
    /// The instructions.
    pub instructions: Vec<&'a Instruction>,
    /// The address behind the last one.
    pub end: u64,
}

impl Disassembly {
    /// Disassembles `image`.
    pub fn of(image: &Path, processor: Processor) -> Result<Disassembly> {
        let mut objdump = tools::LLVM_OBJDUMP.install()?.command(&["--disassemble", "--demangle", "--no-show-raw-insn"])?;
        let disassembly = parse_disassembly(&read(objdump.arg(format!("--mcpu={}", processor.name())).arg(image))?);
        ensure!(!disassembly.lines.is_empty(), "{} has no instructions", image.display());
        Ok(disassembly)
    }

    /// The code of the `count` instructions from `address` on.
    ///
    /// The emulator ends blocks with pages, even between a condition and what depends on it. Both then count to the
    /// block after the page's end.
    pub fn code(&self, address: u64, count: usize) -> Code<'_> {
        let end = self.lines.range(address..).nth(count).map_or(u64::MAX, |(&end, _)| end);
        let lines = self.lines.range(self.group(address)..self.group(end));
        Code { instructions: lines.map(|(_, line)| &line.instruction).collect(), end }
    }

    /// The name of the function that `address` is in.
    pub fn function(&self, address: u64) -> Result<&str> {
        let (_, name) = self.functions.range(..=address).next_back().with_context(|| format!("no function at {address:#x}"))?;
        Ok(name)
    }

    fn group(&self, address: u64) -> u64 {
        self.lines.get(&address).map_or(address, |line| line.group)
    }
}

fn parse_disassembly(text: &str) -> Disassembly {
    let mut disassembly = Disassembly::default();
    // The address of the last condition, and how many instructions still depend on it.
    let mut condition = (0, 0);
    for line in text.lines() {
        let Some((address, rest)) = line.trim().split_once([' ', ':']) else { continue };
        let Ok(address) = u64::from_str_radix(address, 16) else { continue };
        if let Some(name) = rest.strip_prefix('<').and_then(|rest| rest.strip_suffix(">:")) {
            disassembly.functions.insert(address, name.to_owned());
            continue;
        }
        let instruction = Instruction::new(rest.trim());
        condition = match condition {
            (_, 0) => (address, instruction.conditions()),
            (group, left) => (group, left - 1),
        };
        disassembly.lines.insert(address, Line { instruction, group: condition.0 });
    }
    disassembly
}

/// An instruction as the disassembler prints it, with a label for the target of a branch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instruction {
    text: String,
}

impl Instruction {
    /// Takes a line of the disassembler without its address.
    fn new(line: &str) -> Instruction {
        // A target is a number before its symbol: `bne 0x88a0 <match+0x10>`.
        let code = line.split(['@', '<']).next().unwrap_or_default().replace('\t', " ");
        let text = match code.trim().rsplit_once(' ') {
            Some((code, target)) if target.starts_with("0x") => format!("{code} .Ltarget"),
            _ => code,
        };
        Instruction { text: text.trim().to_owned() }
    }

    /// Its text.
    fn text(&self) -> &str {
        &self.text
    }

    /// Its name without type and width: `ldr` of `ldr.w`, `vldrh` of `vldrh.u16`.
    fn name(&self) -> &str {
        let name = self.text.split(' ').next().unwrap_or_default();
        name.split('.').next().unwrap_or_default()
    }

    /// The number of registers that it loads or stores if they are several core registers.
    fn transfers(&self) -> Option<u64> {
        match self.name() {
            name if ["ldrd", "strd"].iter().any(|double| name.starts_with(double)) => Some(2),
            name if ["ldm", "stm", "push", "pop"].iter().any(|multiple| name.starts_with(multiple)) => {
                Some(self.text.split('{').nth(1).map_or(1, |list| list.split(',').count() as u64))
            }
            _ => None,
        }
    }

    /// Returns true if it loads one register.
    fn is_load(&self) -> bool {
        self.name().starts_with("ldr") && self.transfers().is_none()
    }

    /// Returns true if it stores one register.
    fn is_store(&self) -> bool {
        self.name().starts_with("str") && self.transfers().is_none()
    }

    /// The number of instructions after it that are conditional on it (IT, VPT, VPST).
    fn conditions(&self) -> usize {
        let of = |stem: &str| {
            let rest = self.name().strip_prefix(stem)?;
            rest.chars().all(|each| each == 't' || each == 'e').then_some(1 + rest.len())
        };
        ["it", "vpt", "vpst"].into_iter().find_map(of).unwrap_or(0)
    }
}

/// The cycles that the second sequence of each of `pairs` adds to the first, so that what overlaps between the two is
/// counted once. Taken branches and split accesses are not in them, nor are wait states, caches and wrong predictions.
pub fn added<'a>(processor: Processor, pairs: impl Iterator<Item = [&'a [&'a Instruction]; 2]>) -> Result<Vec<u64>> {
    let sequences: Vec<_> = pairs.flat_map(|pair| [pair[0].to_vec(), pair.concat()]).collect();
    let cycles = match processor {
        Processor::CortexM0Plus | Processor::Rv32imac => bail!("no cycles are known for {}", processor.name()),
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
        Processor::CortexM4 | Processor::CortexM33 | Processor::CortexM0Plus | Processor::Rv32imac => 2,
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
        Processor::CortexM4 | Processor::CortexM33 | Processor::CortexM0Plus | Processor::Rv32imac => 1,
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

    const TEXT: &str = "00000100 <first>:\n     100:      \tcmp\tr0, r1\n     102:      \tite\tne\n     104:      \taddne\tr0, r1\n     \
                    106:      \tmoveq\tr0, r1\n     108:      \tb\t0x100 <first>\n\n0000010a <second>:\n     10a:      \tnop\n";

    #[test]
    fn blocks_do_not_end_between_a_condition_and_what_depends_on_it() {
        let disassembly = parse_disassembly(TEXT);
        assert_eq!((disassembly.function(0x108).unwrap(), disassembly.function(0x10a).unwrap()), ("first", "second"));
        let names = |address, count| {
            let Code { instructions, end } = disassembly.code(address, count);
            (instructions.iter().map(|instruction| instruction.name().to_owned()).collect::<Vec<_>>().join(" "), end)
        };
        assert_eq!(names(0x100, 3), ("cmp".into(), 0x106));
        assert_eq!(names(0x106, 2), ("ite addne moveq b".into(), 0x10a));
        assert_eq!(names(0x10a, 1), ("nop".into(), u64::MAX));
    }

    #[test]
    fn instructions_are_read_from_their_text() {
        let branch = Instruction::new("bne.w\t0x88a0 <match+0x10>       @ imm = #-0x20");
        assert_eq!((branch.text(), branch.name()), ("bne.w .Ltarget", "bne"));
        assert_eq!(Instruction::new("ldr\tr0, [pc, #0x10] @ 0x8414 <match+0x4>").text(), "ldr r0, [pc, #0x10]");
        assert_eq!(Instruction::new("adr r1, #468 <match+0x103>").text(), "adr r1, #468");
        assert_eq!(Instruction::new("subs r0, #0x20").text(), "subs r0, #0x20");
        let transfers = |line| Instruction::new(line).transfers();
        assert_eq!(transfers("ldm.w r11!, {r4, r5, r6, r7}"), Some(4));
        assert_eq!((transfers("pop {pc}"), transfers("strd r0, r1, [sp]"), transfers("ldr r0, [r1]")), (Some(1), Some(2), None));
        let conditions = |line| Instruction::new(line).conditions();
        assert_eq!((conditions("it ne"), conditions("itte ne"), conditions("add r0, r1")), (1, 3, 0));
        assert_eq!((conditions("vpt.u16 hi, q0, q1"), conditions("vpste"), conditions("vpsel q0, q1, q2")), (1, 2, 0));
    }

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
