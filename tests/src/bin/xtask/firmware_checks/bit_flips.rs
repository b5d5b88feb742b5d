//! Flips bits in the memory of firmware that matches, and checks that nothing goes wrong silently.

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use multiscopic_core::{Disparity, Fusion};
use multiscopic_edge::{Matching, profile::QQVGA};
use multiscopic_reference::split_mix::Random;
use object::{Object, ObjectSymbol, read::elf::ElfFile32};
use std::{
    collections::BTreeMap,
    fmt, fs,
    ops::Range,
    path::{Path, PathBuf},
    time::Duration,
};

use crate::{
    emulation::{
        self, Debugger, Exit, Stop,
        build::{self, Program},
        emulated_board::{EmulatedBoard, REFERENCE},
    },
    firmware_checks::frames::{self, ImageSet},
    system::{self, free_ports, in_parallel},
    tools::Toolchain,
};

/// The board: the watchdog in the example is its own.
const BOARD: &EmulatedBoard = &REFERENCE;
/// The files of packets, by frame. Bits are flipped while the first is matched.
const PACKETS: [&str; 3] = ["packets.0.bin", "packets.1.bin", "packets.2.bin"];
/// The emulator's clock advances by 32 ns with each instruction, whatever time this machine takes for it.
const CLOCK: [&str; 2] = ["-icount", "shift=5"];
/// The time limit of a run, in which the watchdog ends what is stuck. Only a hung one reaches it.
const LIMIT: Duration = Duration::from_secs(600);
/// The most instructions between the beginning of a phase and a flip.
const STEPS: usize = 400;
/// About the instructions that encode and send the packet of a line.
const STEPS_OF_PACKET: usize = 7000;

/// Exit codes of the firmware: all frames were matched, one was lost, and those of a panic, a fault, a stack overflow and the
/// watchdog.
const WHOLE: i32 = 0;
const LOST: i32 = 2;
const NAMED: [(i32, &str); 4] = [(101, "a panic"), (102, "a hard fault"), (103, "a stack overflow"), (104, "the watchdog")];

/// The number of bits to flip.
#[derive(Args)]
pub struct BitFlips {
    /// Bits to flip, one a run
    #[arg(long, value_name = "N", default_value_t = 1000)]
    count: usize,

    /// Seed of the bits and moments
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// A part of the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    LineBuffersAndSums,
    Disparities,
    Packet,
    Parameters,
    Stack,
    FreeStack,
}

/// The effect of a flip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Effect {
    /// The packets are the same.
    Nothing,
    /// Pixels of the frame differ.
    Pixels,
    /// The receiver reports packets that are damaged, missing or twice there.
    Packets,
    /// The firmware reports that the frame is lost, and goes on.
    Reported,
    /// The firmware ends with a message.
    Ended(&'static str),
}

/// The firmware's image, and where parts of the memory are.
struct Target<'a> {
    image: &'a Path,
    workspace: u32,
    parameters: Range<u32>,
    stack: Range<u32>,
    /// The addresses at which phases begin: matching, fetching and sending.
    phases: [u32; 3],
    matching: Matching,
    expected: Vec<Option<Disparity>>,
    images: ImageSet,
}

impl BitFlips {
    /// A few, for the tests.
    pub fn few() -> BitFlips {
        BitFlips { count: 48, seed: 1 }
    }

    /// As many as by default.
    pub fn many() -> BitFlips {
        BitFlips { count: 1000, seed: 1 }
    }

    /// Flips the bits.
    pub fn run(&self, toolchain: &Toolchain) -> Result<()> {
        let images = build::build(toolchain, BOARD, &[Program::Example("bit_flips")])?;
        let target = Target::new(images.first().context("one program gives one image")?)?;
        target.without_flips()?;
        target.stuck()?;
        let seeds: Vec<u64> = (0..self.count as u64).map(|n| self.seed.wrapping_add(n << 32)).collect();
        let effects = in_parallel(&seeds, |&seed| target.flip(seed).with_context(|| format!("a flip of seed {seed:#x}")))?;
        let mut tally = BTreeMap::<Part, BTreeMap<Effect, usize>>::new();
        for (part, effect) in effects {
            *tally.entry(part).or_default().entry(effect).or_default() += 1;
        }
        for (part, effects) in tally {
            let effects: Vec<_> = effects.iter().map(|(effect, times)| format!("{times} {effect}")).collect();
            println!("flips: {part}: {}", effects.join(", "));
        }
        println!("flips: {} bits flipped, every end has a name, and every later frame is that of this machine", self.count);
        Ok(())
    }
}

impl<'a> Target<'a> {
    fn new(image: &'a Path) -> Result<Target<'a>> {
        let bytes = fs::read(image).with_context(|| format!("cannot read {}", image.display()))?;
        let elf = ElfFile32::<object::Endianness>::parse(&*bytes).with_context(|| image.display().to_string())?;
        let symbol = |part: &str| {
            let found = elf.symbols().find(|symbol| symbol.name().is_ok_and(|name| name.contains(part)));
            let found = found.with_context(|| format!("{} has no symbol {part}", image.display()))?;
            Ok::<Range<u32>, anyhow::Error>(found.address() as u32..(found.address() + found.size()) as u32)
        };
        // The lowest bit of a function's address says that its instructions are Thumb.
        let function = |name: &str| symbol(name).map(|range| range.start & !1);
        let matching = QQVGA.matching(Fusion::Min);
        let images = ImageSet::demo(&matching);
        let (workspace, lengths) = (symbol("WORKSPACE")?, matching.lengths());
        let size = (workspace.end - workspace.start) as usize;
        // The cell has a flag beside it.
        ensure!(size >= lengths.bytes(), "the workspace has {size} bytes, expected {}", lengths.bytes());
        Ok(Target {
            image,
            workspace: workspace.start,
            parameters: symbol("PARAMETERS")?,
            stack: symbol("_stack_end")?.start..symbol("_stack_start")?.start,
            phases: [function("phase_matching")?, function("phase_fetching")?, function("phase_sending")?],
            expected: images.disparities(&matching)?,
            matching,
            images,
        })
    }

    /// Every frame is right where nothing is flipped.
    fn without_flips(&self) -> Result<()> {
        let folder = self.folder("none")?;
        let exit = emulation::start(BOARD, self.image, &[""], &folder, &CLOCK)?.end(LIMIT)?;
        let effect = self.effect(&exit, &folder)?;
        ensure!(effect == Effect::Nothing, "without a flip: {effect}:\n{}", exit.output);
        Ok(())
    }

    /// The watchdog ends what is stuck.
    fn stuck(&self) -> Result<()> {
        let folder = self.folder("stuck")?;
        let exit = emulation::start(BOARD, self.image, &["stuck"], &folder, &CLOCK)?.end(LIMIT)?;
        let effect = self.effect(&exit, &folder)?;
        ensure!(effect == Effect::Ended("the watchdog"), "stuck firmware: {effect}:\n{}", exit.output);
        println!("flips: {}", exit.output.lines().last().unwrap_or_default());
        Ok(())
    }

    /// Flips a bit at a moment in the first frame, both as `seed` has it.
    fn flip(&self, seed: u64) -> Result<(Part, Effect)> {
        let mut random = Random(seed);
        let folder = self.folder(&format!("{seed:x}"))?;
        let [port] = free_ports()?;
        let address = format!("tcp:127.0.0.1:{port}");
        let options = [&CLOCK[..], &["-S", "-gdb", &address]].concat();
        let running = emulation::start(BOARD, self.image, &[""], &folder, &options)?;
        let mut debugger = Debugger::connect(port)?;
        let part = Part::ALL[random.below(Part::ALL.len())];
        let (phase, steps) = match part {
            Part::Packet => (self.phases[2], STEPS_OF_PACKET),
            _ => (self.phases[random.below(3)], STEPS),
        };
        // Each phase begins at least once a line.
        let times = 1 + random.below(self.matching.search().height()) as u32;
        ensure!(debugger.run_to(phase, times)? == Stop::Trapped, "the firmware ended before the flip");
        debugger.step(random.below(steps))?;
        let memory = self.memory(part, debugger.stack_pointer()?);
        debugger.flip(memory.start + random.below(memory.len()) as u32, random.below(8) as u32)?;
        debugger.leave()?;
        let exit = running.end(LIMIT)?;
        let effect = self.effect(&exit, &folder)?;
        let is_wrong = matches!(effect, Effect::Pixels | Effect::Packets);
        ensure!(part != Part::Parameters || !is_wrong, "other parameters, without a report: {effect}");
        fs::remove_dir_all(&folder)?;
        Ok((part, effect))
    }

    /// Returns the addresses of a part.
    fn memory(&self, part: Part, stack_pointer: u32) -> Range<u32> {
        let lengths = self.matching.lengths();
        let words = self.workspace..self.workspace + 4 * lengths.words() as u32;
        let line = words.end..words.end + lengths.line_bytes() as u32;
        match part {
            Part::LineBuffersAndSums => words,
            Part::Packet => line.end..line.end + lengths.packet as u32,
            Part::Disparities => line,
            Part::Parameters => self.parameters.clone(),
            Part::Stack => stack_pointer..self.stack.end,
            Part::FreeStack => self.stack.start..stack_pointer,
        }
    }

    /// Returns the effect on the frames. Fails if the firmware ended without a name, or if a later frame is not right.
    fn effect(&self, exit: &Exit, folder: &Path) -> Result<Effect> {
        if let Some((_, name)) = NAMED.into_iter().find(|(code, _)| *code == exit.code) {
            let is_named = exit.output.lines().last().is_some_and(|line| line.starts_with("firmware: "));
            ensure!(is_named, "{name} without a message:\n{}", exit.output);
            return Ok(Effect::Ended(name));
        }
        ensure!([WHOLE, LOST].contains(&exit.code), "exit code {}, which no end has:\n{}", exit.code, exit.output);
        for packets in &PACKETS[1..] {
            self.differs(&folder.join(packets))?.map_or(Ok(()), |difference| bail!("{packets}: {difference}"))?;
        }
        if exit.code == LOST {
            ensure!(exit.output.contains("error: "), "a lost frame without a message:\n{}", exit.output);
            return Ok(Effect::Reported);
        }
        match self.differs(&folder.join(PACKETS[0])) {
            Ok(None) => Ok(Effect::Nothing),
            Ok(Some(_)) => Ok(Effect::Pixels),
            Err(_) => Ok(Effect::Packets),
        }
    }

    /// The first pixel that differs from this machine's, if any does. Fails if the receiver has anything to report.
    fn differs(&self, packets: &Path) -> Result<Option<String>> {
        let bytes = fs::read(packets).with_context(|| format!("the firmware sent no {}", packets.display()))?;
        let received = frames::whole(&bytes, packets, self.matching.search())?;
        Ok(frames::same(&received.disparities, &self.expected).err().map(|difference| difference.to_string()))
    }

    /// An own folder with the frames.
    fn folder(&self, name: &str) -> Result<PathBuf> {
        let folder = system::edge_target().join("runs/bit_flips").join(name);
        let _ = fs::remove_dir_all(&folder);
        self.images.write(&folder)?;
        Ok(folder)
    }
}

impl Part {
    const ALL: [Part; 6] =
        [Part::LineBuffersAndSums, Part::Disparities, Part::Packet, Part::Parameters, Part::Stack, Part::FreeStack];
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Part::LineBuffersAndSums => "line buffers and sums",
            Part::Disparities => "a line of disparities",
            Part::Packet => "a packet",
            Part::Parameters => "parameters",
            Part::Stack => "the stack",
            Part::FreeStack => "the free stack",
        })
    }
}

impl fmt::Display for Effect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Effect::Nothing => write!(f, "changed nothing"),
            Effect::Pixels => write!(f, "changed pixels of the frame"),
            Effect::Packets => write!(f, "damaged packets, which the receiver reports"),
            Effect::Reported => write!(f, "lost the frame, which the firmware reports"),
            Effect::Ended(name) => write!(f, "ended in {name}"),
        }
    }
}
