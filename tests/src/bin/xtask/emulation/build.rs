//! Builds the firmware, and measures what it takes of a board's memory: that of the emulated boards, and that of a Raspberry
//! Pi Pico 2 with a HAL of its own, which has no board to run on here. Installs what building and running needs.

use anyhow::{Context, Result, ensure};
use multiscopic_core::Fusion;
use multiscopic_edge::Profile;
use object::{
    LittleEndian,
    elf::{FileHeader32, SHF_ALLOC, SHF_WRITE, SHT_NOBITS},
    read::elf::FileHeader,
};
use std::{
    collections::BTreeMap,
    fmt, fs,
    path::{Path, PathBuf},
    process::Command,
};

use crate::{
    emulation::emulated_board::{self, EmulatedBoard},
    system::{self, run},
    tools::{self, Toolchain},
};

/// Makes sure that every tool and target is installed.
pub fn set_up() -> Result<Toolchain> {
    for tool in &tools::ALL {
        eprintln!("setup: {}", tool.install()?);
    }
    let toolchain = toolchain()?;
    eprintln!("setup: {} from {toolchain}", emulated_board::targets().join(", "));
    Ok(toolchain)
}

/// The toolchain for the boards with Arm processors.
pub fn toolchain() -> Result<Toolchain> {
    Toolchain::install(&emulated_board::targets()).context("setup: the Rust targets of the boards")
}

/// A program of the firmware's crate.
#[derive(Clone, Copy)]
pub enum Program {
    /// The firmware of a profile, with its fusion rule.
    Profile(&'static str, Fusion),
    /// The firmware of a profile with more than four views, which the feature `array` is for.
    ArrayProfile(&'static str, Fusion),
    /// An example.
    Example(&'static str),
    /// An example, with the feature `array`.
    ArrayExample(&'static str),
    /// The example with the matches in the file of this [index](system::calibrations), which the feature `calibrations` is for.
    Calibrations(usize),
    /// The same with the feature `array`.
    ArrayCalibrations(usize),
    /// An example with the [set of frames](system::flash_set) in flash, which the feature `flash-set` is for.
    FlashExample(&'static str),
}

impl Program {
    /// The firmware of `profile` that fuses by `fusion`.
    pub fn of(profile: &Profile, fusion: Fusion) -> Program {
        match profile.needs_array() {
            true => Program::ArrayProfile(profile.name, fusion),
            false => Program::Profile(profile.name, fusion),
        }
    }

    /// Its path among what is built.
    fn built(&self) -> PathBuf {
        match self {
            Program::Profile(name, _) | Program::ArrayProfile(name, _) => PathBuf::from(name),
            Program::Calibrations(_) | Program::ArrayCalibrations(_) => PathBuf::from("examples/calibrate"),
            Program::Example(name) | Program::ArrayExample(name) | Program::FlashExample(name) => {
                Path::new("examples").join(name)
            }
        }
    }

    /// The name of its copy.
    fn kept(&self) -> String {
        match self {
            Program::Profile(name, fusion) | Program::ArrayProfile(name, fusion) => format!("{name}-{}", fusion.name()),
            Program::ArrayExample(name) => format!("{name}-array"),
            Program::Calibrations(index) | Program::ArrayCalibrations(index) => format!("calibrate-{index}"),
            Program::Example(name) | Program::FlashExample(name) => (*name).to_owned(),
        }
    }

    /// The features and the environment of its build. Programs that are built together have the same.
    pub fn setting(&self) -> (&'static [&'static str], Option<(&'static str, PathBuf)>) {
        let fusion = |fusion: &Fusion| Some(("MULTISCOPIC_FUSION", PathBuf::from(fusion.name())));
        let flash_set = Some(("MULTISCOPIC_FLASH_SET", system::flash_set()));
        let calibrations = |index: &usize| Some(("MULTISCOPIC_CALIBRATIONS", system::calibrations(*index)));
        match self {
            Program::Profile(_, rule) => (&[], fusion(rule)),
            Program::ArrayProfile(_, rule) => (&["array"], fusion(rule)),
            Program::Example(_) => (&[], None),
            Program::ArrayExample(_) => (&["array"], None),
            Program::Calibrations(index) => (&["calibrations"], calibrations(index)),
            Program::ArrayCalibrations(index) => (&["array", "calibrations"], calibrations(index)),
            Program::FlashExample(_) => (&["flash-set"], flash_set),
        }
    }
}

/// The cargo command that builds `programs` for `board`, which have the same [setting](Program::setting).
pub fn command(toolchain: &Toolchain, board: &EmulatedBoard, programs: &[Program]) -> Command {
    let mut cargo = toolchain.cargo_in(&folder(board, programs), "build");
    cargo.args(["--profile", "firmware", "--package", "multiscopic-firmware", "--target", board.target]);
    cargo.env("RUSTFLAGS", board.rustflags);
    let (features, environment) = programs.first().map(Program::setting).unwrap_or_default();
    cargo.args(board.feature.iter().chain(features).map(|feature| format!("--features={feature}"))).envs(environment);
    cargo.args(programs.iter().map(|program| match program {
        Program::Profile(name, _) | Program::ArrayProfile(name, _) => format!("--bin={name}"),
        Program::Calibrations(_) | Program::ArrayCalibrations(_) => "--example=calibrate".to_owned(),
        Program::Example(name) | Program::ArrayExample(name) | Program::FlashExample(name) => format!("--example={name}"),
    }));
    cargo
}

/// The folder of what is built. Matches to calibrate have one for each board, so that boards build side by side.
fn folder(board: &EmulatedBoard, programs: &[Program]) -> PathBuf {
    match programs.first() {
        Some(Program::Calibrations(_) | Program::ArrayCalibrations(_)) => {
            system::edge_target().join("price-fit").join(board.name)
        }
        _ => system::edge_target(),
    }
}

/// Builds `programs` for `board`, and returns their paths.
pub fn build(toolchain: &Toolchain, board: &EmulatedBoard, programs: &[Program]) -> Result<Vec<PathBuf>> {
    let kept = system::edge_target().join("images").join(board.name);
    fs::create_dir_all(&kept)?;
    let mut together = BTreeMap::<_, Vec<Program>>::new();
    for program in programs {
        together.entry(program.setting()).or_default().push(*program);
    }
    for programs in together.values() {
        run(&mut command(toolchain, board, programs))?;
        let built = folder(board, programs).join(board.target).join("firmware");
        // Keep copies: the next images have the same paths.
        for program in programs {
            let from = built.join(program.built());
            fs::copy(&from, kept.join(program.kept())).with_context(|| format!("cannot copy {}", from.display()))?;
        }
    }
    Ok(programs.iter().map(|program| kept.join(program.kept())).collect())
}

/// The size of an image by kind of memory, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Footprint {
    /// Code, constants and the vector table.
    pub text: u64,
    /// Initialised statics, which take RAM and flash.
    pub data: u64,
    /// Zeroed statics, which take RAM alone.
    pub bss: u64,
}

impl Footprint {
    /// The footprint of the ELF file at `path`.
    pub fn of(path: &Path) -> Result<Footprint> {
        let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        measure(&bytes).with_context(|| format!("{} is not a 32-bit little-endian ELF file", path.display()))
    }

    /// The flash that the image takes.
    pub fn flash(&self) -> u64 {
        self.text + self.data
    }

    /// The RAM that the statics take.
    pub fn ram(&self) -> u64 {
        self.data + self.bss
    }
}

impl fmt::Display for Footprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Footprint { text, data, bss } = self;
        write!(f, "text {text} B, static RAM {} B (data {data}, bss {bss}), flash {} B", self.ram(), self.flash())
    }
}

fn measure(bytes: &[u8]) -> object::Result<Footprint> {
    let header = FileHeader32::<LittleEndian>::parse(bytes)?;
    let endian = header.endian()?;
    let mut footprint = Footprint::default();
    let sections = header.sections(endian, bytes)?;
    for section in sections.iter() {
        // Measured by itself. On Arm it is no section.
        if sections.section_name(endian, section)? == b".stack" {
            continue;
        }
        let (flags, size) = (section.sh_flags.get(endian), u64::from(section.sh_size.get(endian)));
        let has = |flag: u32| flags & flag != 0;
        match (has(SHF_ALLOC), has(SHF_WRITE), section.sh_type.get(endian)) {
            (false, ..) => {}
            (true, false, _) => footprint.text += size,
            (true, true, SHT_NOBITS) => footprint.bss += size,
            (true, true, _) => footprint.data += size,
        }
    }
    Ok(footprint)
}

/// The folder of the firmware for a Pico 2, a workspace of its own.
pub const PICO2: &str = "edge/pico2";
/// The folder to begin with, another one.
pub const START: &str = "edge/start";

/// The target of a Pico 2's processor.
const PICO2_TARGET: &str = "thumbv8m.main-none-eabihf";

/// Bytes of the RAM that its memory.x gives it.
const PICO2_RAM: u64 = 512 * 1024;

/// Bytes that have to be left for the stack: twice as much as that of the emulated boards.
const PICO2_STACK: u64 = 16 * 1024;

/// Lints the firmware for a Pico 2.
pub fn lint_pico2(toolchain: &Toolchain) -> Result<()> {
    run(cargo_in(toolchain, PICO2, "clippy").args(["--", "-Dwarnings"]))
}

/// Links the firmware for a Pico 2 as its readme says, and fails if its statics leave too little RAM for the stack.
pub fn build_pico2(toolchain: &Toolchain) -> Result<()> {
    run(&mut cargo_in(toolchain, PICO2, "build"))?;
    let footprint = Footprint::of(&system::edge_target().join(PICO2_TARGET).join("release/multiscopic-pico2"))?;
    ensure!(footprint.ram() + PICO2_STACK <= PICO2_RAM, "{footprint}: fewer than {PICO2_STACK} bytes are left for the stack");
    println!("pico2: {footprint}, {} B left for the stack", PICO2_RAM - footprint.ram());
    Ok(())
}

/// Lints the programs to begin with, and links each as who copies its folder does. Returns their images.
pub fn build_start(toolchain: &Toolchain) -> Result<[PathBuf; 3]> {
    run(cargo_in(toolchain, START, "clippy").args(["--bins", "--all-features", "--", "-Dwarnings"]))?;
    // Each alone: the interrupts of RTIC's device are linked into no other.
    let programs = ["start", "with-embassy --features=embassy", "with-rtic --features=rtic"];
    for program in programs {
        run(cargo_in(toolchain, START, "build").arg("--bin").args(program.split(' ')))?;
    }
    let images = system::edge_target().join(emulated_board::REFERENCE.target).join("release");
    Ok(programs.map(|program| images.join(program.split(' ').next().unwrap_or_default())))
}

/// The cargo command `verb` in the folder of another workspace, whose configuration names the target and the processor.
fn cargo_in(toolchain: &Toolchain, folder: &str, verb: &str) -> Command {
    let mut cargo = toolchain.cargo(verb);
    cargo.args(["--release", "--locked"]).current_dir(system::root().join(folder));
    cargo
}
