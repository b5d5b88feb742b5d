//! The instructions of a firmware image, and the properties that their time depends on.

use anyhow::{Context, Result, ensure};
use multiscopic::Processor;
use std::{collections::BTreeMap, path::Path};

use crate::{system::read, tools};

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
        let disassembly = parse(&read(objdump.arg(format!("--mcpu={}", processor.name())).arg(image))?);
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

fn parse(text: &str) -> Disassembly {
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
    pub fn new(line: &str) -> Instruction {
        // A target is a number before its symbol: `bne 0x88a0 <match+0x10>`.
        let code = line.split(['@', '<']).next().unwrap_or_default().replace('\t', " ");
        let text = match code.trim().rsplit_once(' ') {
            Some((code, target)) if target.starts_with("0x") => format!("{code} .Ltarget"),
            _ => code,
        };
        Instruction { text: text.trim().to_owned() }
    }

    /// Its text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Its name without type and width: `ldr` of `ldr.w`, `vldrh` of `vldrh.u16`.
    pub fn name(&self) -> &str {
        let name = self.text.split(' ').next().unwrap_or_default();
        name.split('.').next().unwrap_or_default()
    }

    /// The number of registers that it loads or stores if they are several core registers.
    pub fn transfers(&self) -> Option<u64> {
        match self.name() {
            name if ["ldrd", "strd"].iter().any(|double| name.starts_with(double)) => Some(2),
            name if ["ldm", "stm", "push", "pop"].iter().any(|multiple| name.starts_with(multiple)) => {
                Some(self.text.split('{').nth(1).map_or(1, |list| list.split(',').count() as u64))
            }
            _ => None,
        }
    }

    /// Returns true if it loads one register.
    pub fn is_load(&self) -> bool {
        self.name().starts_with("ldr") && self.transfers().is_none()
    }

    /// Returns true if it stores one register.
    pub fn is_store(&self) -> bool {
        self.name().starts_with("str") && self.transfers().is_none()
    }

    /// The number of instructions after it that are conditional on it (IT, VPT, VPST).
    pub fn conditions(&self) -> usize {
        let of = |stem: &str| {
            let rest = self.name().strip_prefix(stem)?;
            rest.chars().all(|each| each == 't' || each == 'e').then_some(1 + rest.len())
        };
        ["it", "vpt", "vpst"].into_iter().find_map(of).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "00000100 <first>:\n     100:      \tcmp\tr0, r1\n     102:      \tite\tne\n     104:      \taddne\tr0, r1\n     \
                    106:      \tmoveq\tr0, r1\n     108:      \tb\t0x100 <first>\n\n0000010a <second>:\n     10a:      \tnop\n";

    #[test]
    fn blocks_do_not_end_between_a_condition_and_what_depends_on_it() {
        let disassembly = parse(TEXT);
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
}
