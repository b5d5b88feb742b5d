//! Builds the firmware, and measures what it takes of a board's memory: that of the emulated boards, and that of a Raspberry
//! Pi Pico 2 with a HAL of its own, which has no board to run on here. Installs what building and running needs.

use anyhow::{Context, Result, ensure};
use multiscopic_edge::Profile;
use object::{
    LittleEndian,
    elf::{FileHeader32, SHF_ALLOC, SHF_WRITE, SHT_NOBITS},
    read::elf::FileHeader,
};
use std::{
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

/// The environment variable with the folder of the set of frames that goes into flash.
pub const FLASH_SET: &str = "MULTISCOPIC_FLASH_SET";

/// A program of the firmware's crate.
#[derive(Clone, Copy)]
pub enum Program {
    /// The firmware of a profile.
    Profile(&'static str),
    /// The firmware of a profile with more than four views, which the feature `array` is for.
    ArrayProfile(&'static str),
    /// An example.
    Example(&'static str),
    /// An example, with the feature `array`.
    ArrayExample(&'static str),
    /// An example with the [set of frames](system::flash_set) in flash, which the feature `flash-set` is for.
    FlashExample(&'static str),
}

impl Program {
    /// The firmware of `profile`.
    pub fn of(profile: &Profile) -> Program {
        if profile.needs_array() { Program::ArrayProfile(profile.name) } else { Program::Profile(profile.name) }
    }

    /// Its path among what is built.
    fn built(&self) -> PathBuf {
        match self {
            Program::Profile(name) | Program::ArrayProfile(name) => PathBuf::from(name),
            Program::Example(name) | Program::ArrayExample(name) | Program::FlashExample(name) => {
                Path::new("examples").join(name)
            }
        }
    }

    /// The name of its copy.
    fn kept(&self) -> String {
        match self {
            Program::ArrayExample(name) => format!("{name}-array"),
            Program::Profile(name) | Program::ArrayProfile(name) | Program::Example(name) | Program::FlashExample(name) => {
                (*name).to_owned()
            }
        }
    }

    fn is_for_array(&self) -> bool {
        matches!(self, Program::ArrayProfile(_) | Program::ArrayExample(_))
    }
}

/// The cargo command that builds `programs` for `board`, which are all for the feature `array` or none of them.
pub fn command(toolchain: &Toolchain, board: &EmulatedBoard, programs: &[Program]) -> Command {
    let mut cargo = toolchain.cargo("build");
    cargo.args(["--profile", "firmware", "--package", "multiscopic-firmware", "--target", board.target]);
    cargo.env("RUSTFLAGS", board.rustflags);
    let array = programs.iter().any(Program::is_for_array).then_some("array");
    let flash_set = programs.iter().any(|program| matches!(program, Program::FlashExample(_))).then_some("flash-set");
    cargo.args(board.feature.into_iter().chain(array).chain(flash_set).map(|feature| format!("--features={feature}")));
    cargo.env(FLASH_SET, system::flash_set());
    cargo.args(programs.iter().map(|program| match program {
        Program::Profile(name) | Program::ArrayProfile(name) => format!("--bin={name}"),
        Program::Example(name) | Program::ArrayExample(name) | Program::FlashExample(name) => format!("--example={name}"),
    }));
    cargo
}

/// Builds `programs` for `board`, and returns their paths.
pub fn build(toolchain: &Toolchain, board: &EmulatedBoard, programs: &[Program]) -> Result<Vec<PathBuf>> {
    let built = system::edge_target().join(board.target).join("firmware");
    let kept = system::edge_target().join("images").join(board.name);
    fs::create_dir_all(&kept)?;
    // The feature changes the core for all programs that are built together.
    let (for_array, others): (Vec<Program>, Vec<Program>) = programs.iter().partition(|program| program.is_for_array());
    for programs in [others, for_array].iter().filter(|programs| !programs.is_empty()) {
        run(&mut command(toolchain, board, programs))?;
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

/// The manifest of the firmware for a Pico 2, in the workspace.
pub const PICO2_MANIFEST: &str = "edge/pico2/Cargo.toml";

/// The target of a Pico 2's processor.
const PICO2_TARGET: &str = "thumbv8m.main-none-eabihf";

/// Bytes of the RAM that its memory.x gives it.
const PICO2_RAM: u64 = 512 * 1024;

/// Bytes that have to be left for the stack: twice as much as that of the emulated boards.
const PICO2_STACK: u64 = 16 * 1024;

/// Lints the firmware for a Pico 2.
pub fn lint_pico2(toolchain: &Toolchain) -> Result<()> {
    run(pico2_cargo(toolchain, "clippy").args(["--", "-Dwarnings"]))
}

/// Links the firmware for a Pico 2 as its readme says, and fails if its statics leave too little RAM for the stack.
pub fn build_pico2(toolchain: &Toolchain) -> Result<()> {
    run(&mut pico2_cargo(toolchain, "build"))?;
    let footprint = Footprint::of(&system::edge_target().join(PICO2_TARGET).join("release/multiscopic-pico2"))?;
    ensure!(footprint.ram() + PICO2_STACK <= PICO2_RAM, "{footprint}: fewer than {PICO2_STACK} bytes are left for the stack");
    println!("pico2: {footprint}, {} B left for the stack", PICO2_RAM - footprint.ram());
    Ok(())
}

/// The cargo command `verb` in the folder of that firmware, whose configuration names the target and the processor.
fn pico2_cargo(toolchain: &Toolchain, verb: &str) -> Command {
    let mut cargo = toolchain.cargo(verb);
    cargo.args(["--release", "--locked"]).current_dir(system::root().join("edge/pico2"));
    cargo
}
