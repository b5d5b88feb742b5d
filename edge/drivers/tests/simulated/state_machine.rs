//! A state machine of the RP2350's PIO, cycle by cycle, with the instructions that programs for pixel buses use.

use std::collections::{HashMap, VecDeque};

/// The bits that fill the input shift register.
const PUSH_BITS: u32 = 8;
/// The words that each of the two queues holds.
const QUEUE: usize = 4;

/// A register or the pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    X,
    Y,
    Osr,
    Pins,
    Null,
    Pc,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Instruction {
    Jump(u32),
    /// Jumps if X is not zero, and decrements it in either case.
    JumpXDecrement(u32),
    /// Jumps if Y is zero.
    JumpYZero(u32),
    /// Waits for a level of an input pin.
    Wait(bool, u32),
    In(Place, u32),
    Out(Place, u32),
    Mov(Place, Place),
    Set(Place, u32),
    PullBlock,
}

/// An assembled program.
#[derive(Clone, Debug)]
pub struct Program {
    code: Vec<Instruction>,
    wrap: [u32; 2],
    /// Definitions and labels.
    symbols: HashMap<String, u32>,
}

impl Program {
    /// Assembles a program, which is loaded at 0. `definitions` replace its own.
    pub fn assemble(text: &str, definitions: &[(&str, u32)]) -> Program {
        let mut symbols: HashMap<String, u32> = HashMap::new();
        let (mut lines, mut wrap) = (Vec::new(), [None; 2]);
        for line in text.lines() {
            let line = line.split(';').next().expect("a first part").replace(',', " ");
            let words: Vec<&str> = line.split_whitespace().filter(|&word| word != "public").collect();
            let address = lines.len() as u32;
            match words[..] {
                [] | [".program", _] | [".origin", "0"] => {}
                [".define", name, value] => {
                    let replaced = definitions.iter().find(|(defined, _)| *defined == name).map(|&(_, value)| value);
                    symbols.insert(name.into(), replaced.unwrap_or_else(|| value.parse().expect("a number")));
                }
                [".wrap_target"] => wrap[0] = Some(address),
                [".wrap"] => wrap[1] = Some(address - 1),
                [label] if label.ends_with(':') => {
                    symbols.insert(label.trim_end_matches(':').into(), address);
                }
                _ => lines.push(words.into_iter().map(str::to_owned).collect::<Vec<_>>()),
            }
        }
        let code: Vec<_> = lines.iter().map(|words| Instruction::assemble(words, &symbols)).collect();
        assert!(code.len() <= 32, "{} instructions are too many", code.len());
        Program { wrap: [wrap[0].unwrap_or(0), wrap[1].unwrap_or(code.len() as u32 - 1)], code, symbols }
    }

    /// The value of a definition, or the address of a label.
    pub fn symbol(&self, name: &str) -> Option<u32> {
        self.symbols.get(name).copied()
    }
}

impl Instruction {
    fn assemble(words: &[String], symbols: &HashMap<String, u32>) -> Instruction {
        let number = |word: &str| word.parse().unwrap_or_else(|_| *symbols.get(word).unwrap_or_else(|| panic!("no {word}")));
        let place = |word: &str| match word {
            "x" => Place::X,
            "y" => Place::Y,
            "osr" => Place::Osr,
            "pins" => Place::Pins,
            "null" => Place::Null,
            "pc" => Place::Pc,
            _ => panic!("{word} is not modelled"),
        };
        match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
            ["jmp", target] => Instruction::Jump(number(target)),
            ["jmp", "x--", target] => Instruction::JumpXDecrement(number(target)),
            ["jmp", "!y", target] => Instruction::JumpYZero(number(target)),
            ["wait", level, "pin", pin] => Instruction::Wait(number(level) == 1, number(pin)),
            ["in", source, bits] => Instruction::In(place(source), number(bits)),
            ["out", target, bits] => Instruction::Out(place(target), number(bits)),
            ["mov", target, source] => Instruction::Mov(place(target), place(source)),
            ["set", target, value] => Instruction::Set(place(target), number(value)),
            ["pull", "block"] => Instruction::PullBlock,
            _ => panic!("{words:?} is not modelled"),
        }
    }
}

/// A state machine. It shifts in to the left, pushes eight bits by itself, and shifts out to the right.
pub struct StateMachine<'p> {
    program: &'p Program,
    /// The pins that it sees: the others are low for it.
    visible: u32,
    pc: u32,
    x: u32,
    y: u32,
    osr: u32,
    isr: u32,
    isr_bits: u32,
    /// The pins of the last two cycles, which the synchronisers hold.
    synchronisers: [u32; 2],
    /// The words on their way to the program on the processor.
    pub received: VecDeque<u32>,
    /// The words from there.
    pub sent: VecDeque<u32>,
}

impl<'p> StateMachine<'p> {
    /// A state machine that sees the first `pins` pins and starts at `start`. Its registers have any content.
    pub fn new(program: &'p Program, pins: u32, start: u32) -> StateMachine<'p> {
        StateMachine {
            program,
            visible: (1 << pins) - 1,
            pc: start,
            x: 0xdead_beef,
            y: 0xdead_beef,
            osr: 0xdead_beef,
            isr: 0,
            isr_bits: 0,
            synchronisers: [0; 2],
            received: VecDeque::new(),
            sent: VecDeque::new(),
        }
    }

    /// Runs for a cycle, at whose start the pins have the levels `pins`.
    pub fn step(&mut self, pins: u32) {
        let [newer, older] = self.synchronisers;
        self.synchronisers = [pins, newer];
        let pins = older & self.visible;
        let [wrap_target, wrap] = self.program.wrap;
        let mut next = if self.pc == wrap { wrap_target } else { self.pc + 1 };
        match self.program.code[self.pc as usize] {
            Instruction::Jump(target) => next = target,
            Instruction::JumpXDecrement(target) => {
                if self.x != 0 {
                    next = target;
                }
                self.x = self.x.wrapping_sub(1);
            }
            Instruction::JumpYZero(target) => {
                if self.y == 0 {
                    next = target;
                }
            }
            Instruction::Wait(level, pin) => {
                if (pins >> pin & 1 == 1) != level {
                    return;
                }
            }
            Instruction::In(source, bits) => {
                let is_full = self.isr_bits + bits >= PUSH_BITS;
                if is_full && self.received.len() == QUEUE {
                    return;
                }
                self.isr = self.isr << bits | self.read(source, pins) & ((1 << bits) - 1);
                self.isr_bits += bits;
                if is_full {
                    self.received.push_back(self.isr);
                    (self.isr, self.isr_bits) = (0, 0);
                }
            }
            Instruction::Out(target, bits) => {
                let value = self.osr & ((1 << bits) - 1);
                self.osr >>= bits;
                match target {
                    Place::Pc => next = value,
                    target => self.write(target, value),
                }
            }
            Instruction::Mov(target, source) => self.write(target, self.read(source, pins)),
            Instruction::Set(target, value) => self.write(target, value),
            Instruction::PullBlock => match self.sent.pop_front() {
                Some(word) => self.osr = word,
                None => return,
            },
        }
        self.pc = next;
    }

    fn read(&self, source: Place, pins: u32) -> u32 {
        match source {
            Place::X => self.x,
            Place::Y => self.y,
            Place::Osr => self.osr,
            Place::Pins => pins,
            Place::Null => 0,
            Place::Pc => panic!("the address of an instruction is not a source"),
        }
    }

    fn write(&mut self, target: Place, value: u32) {
        match target {
            Place::X => self.x = value,
            Place::Y => self.y = value,
            Place::Osr => self.osr = value,
            Place::Null => {}
            Place::Pins | Place::Pc => panic!("{target:?} is not a target that is modelled"),
        }
    }
}
