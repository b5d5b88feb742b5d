//! The instructions of a firmware image.

use anyhow::{Context, Result, ensure};
use multiscopic::Processor;
use std::{collections::BTreeMap, path::Path};

use super::instruction::Instruction;
use crate::{system::process::read, tools::tool};

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
        let mut objdump = tool::LLVM_OBJDUMP.install()?.command(&["--disassemble", "--demangle", "--no-show-raw-insn"])?;
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
}
