//! External programs that the checks run, subcommands of cargo and compilers for other targets among them, and their
//! installation.

pub mod debian;

use anyhow::{Context, Result, bail};
use std::{
    env, fmt, fs,
    path::{Path, PathBuf},
    process::Command,
    time::Duration,
};

use crate::system::{self, command, read, run, run_within};

/// A program and the packages that provide it.
pub struct Tool {
    program: &'static str,
    debian: &'static [&'static str],
    fedora: Option<&'static str>,
    homebrew: Option<&'static str>,
}

/// The emulator of the boards.
pub const QEMU: Tool =
    Tool { program: "qemu-system-arm", debian: &["qemu-system-arm"], fedora: Some("qemu-system-arm"), homebrew: Some("qemu") };

/// The emulator of boards with RISC-V processors.
pub const QEMU_RISCV: Tool = Tool {
    program: "qemu-system-riscv32",
    debian: &["qemu-system-misc"],
    fedora: Some("qemu-system-riscv-core"),
    homebrew: Some("qemu"),
};

/// The emulator of the virtual machine with cameras.
pub const QEMU_X86: Tool = Tool {
    program: "qemu-system-x86_64",
    debian: &["qemu-system-x86"],
    fedora: Some("qemu-system-x86-core"),
    homebrew: Some("qemu"),
};

/// A C compiler for the emulator's plugin and the loopback module.
pub const CC: Tool = Tool { program: "cc", debian: &["gcc"], fedora: Some("gcc"), homebrew: Some("gcc") };

/// A C compiler for Arm's microcontrollers.
pub const ARM_CC: Tool =
    Tool { program: "arm-none-eabi-gcc", debian: &["gcc-arm-none-eabi"], fedora: Some("arm-none-eabi-gcc-cs"), homebrew: None };

/// The C++ compiler beside it.
pub const ARM_CXX: Tool = Tool { program: "arm-none-eabi-g++", fedora: Some("arm-none-eabi-gcc-cs-c++"), ..ARM_CC };

/// A C compiler for RISC-V.
pub const RISC_V_CC: Tool =
    Tool { program: "riscv64-unknown-elf-gcc", debian: &["gcc-riscv64-unknown-elf"], fedora: None, homebrew: None };

/// A C++ compiler for this machine.
pub const CXX: Tool = Tool { program: "c++", debian: &["g++"], fedora: Some("gcc-c++"), homebrew: Some("gcc") };

/// Build tools of projects in C.
pub const CMAKE: Tool = Tool { program: "cmake", debian: &["cmake"], fedora: Some("cmake"), homebrew: Some("cmake") };
pub const MESON: Tool =
    Tool { program: "meson", debian: &["meson", "ninja-build"], fedora: Some("meson"), homebrew: Some("meson") };

/// The build tool of the loopback module.
pub const MAKE: Tool = Tool { program: "make", debian: &["make"], fedora: Some("make"), homebrew: Some("make") };

/// The decompressor of the kernel.
pub const XZ: Tool = Tool { program: "xz", debian: &["xz-utils"], fedora: Some("xz"), homebrew: Some("xz") };

/// The linker and C library of 64-bit Arm Linux.
pub const AARCH64_CC: Tool = Tool {
    program: "aarch64-linux-gnu-gcc",
    debian: &["gcc-aarch64-linux-gnu", "libc6-dev-arm64-cross"],
    fedora: None,
    homebrew: None,
};

/// The emulator of 64-bit Arm programs.
pub const QEMU_AARCH64: Tool =
    Tool { program: "qemu-aarch64", debian: &["qemu-user"], fedora: Some("qemu-user"), homebrew: None };

/// The instruction counter.
pub const VALGRIND: Tool = Tool { program: "valgrind", debian: &["valgrind"], fedora: Some("valgrind"), homebrew: None };

/// LLVM's simulation of processors' pipelines. The record of cycles depends on its version.
pub const LLVM_MCA: Tool = Tool { program: "llvm-mca-19", debian: &["llvm-19"], fedora: None, homebrew: None };

/// The disassembler of the same version.
pub const LLVM_OBJDUMP: Tool = Tool { program: "llvm-objdump-19", ..LLVM_MCA };

/// The browser in which pages are tested.
pub const CHROMIUM: Tool = Tool { program: "chromium", debian: &["chromium"], fedora: Some("chromium"), homebrew: None };

/// The runtime of the scripts that drive the browser.
pub const NODE: Tool = Tool { program: "node", debian: &["nodejs"], fedora: Some("nodejs"), homebrew: Some("node") };

/// The package manager that installs the libraries of these scripts.
pub const NPM: Tool = Tool { program: "npm", debian: &["npm"], fedora: Some("nodejs-npm"), homebrew: Some("node") };

/// The interpreter for which the Python package is tested. Debian has its virtual environments in a package of their own.
pub const PYTHON: Tool =
    Tool { program: "python3", debian: &["python3", "python3-venv"], fedora: Some("python3"), homebrew: Some("python") };

/// The tool that packs and unpacks Debian's packages.
pub const DPKG_DEB: Tool = Tool { program: "dpkg-deb", debian: &["dpkg"], fedora: Some("dpkg"), homebrew: Some("dpkg") };

/// The workload manager of clusters: its controller, with the daemon of its nodes and the commands of its users.
pub const SLURM: Tool = Tool { program: "slurmctld", debian: &["slurm-wlm"], fedora: Some("slurm-slurmctld"), homebrew: None };

/// The service that authenticates its users.
pub const MUNGE: Tool = Tool { program: "munged", debian: &["munge"], fedora: Some("munge"), homebrew: None };

/// Every program that the firmware's tests need.
pub const ALL: [Tool; 3] = [QEMU, QEMU_RISCV, CC];

impl Tool {
    /// The program, installed first if it is missing.
    pub fn install(&self) -> Result<InstalledProgram> {
        if let Some(program) = self.find() {
            return Ok(program);
        }
        let unpack = |reason: &dyn fmt::Display| {
            eprintln!("setup: {reason}; {} goes into {} instead", self.debian.join(" "), self.folder().display());
            debian::unpack(self.debian, &self.folder())
        };
        if debian::can_install() {
            debian::install(self.debian).or_else(|refusal| unpack(&format!("{refusal:#}")))?;
        } else if debian::is_here()
            && let Err(refusal) = unpack(&"only root may install")
        {
            eprintln!("setup: {refusal:#}");
        }
        match self.find() {
            Some(program) => Ok(program),
            None => bail!("{} is missing; install it with one of{}", self.program, self.instructions()),
        }
    }

    /// Commands that install it, one per line.
    fn instructions(&self) -> String {
        let fedora = self.fedora.map(|package| format!("\n  sudo dnf install {package}"));
        let homebrew = self.homebrew.map(|package| format!("\n  brew install {package}"));
        format!(
            "\n  sudo apt-get install {}{}{}",
            self.debian.join(" "),
            fedora.unwrap_or_default(),
            homebrew.unwrap_or_default()
        )
    }

    /// The program, if it is installed or unpacked.
    pub fn find(&self) -> Option<InstalledProgram> {
        let installed = env::var_os("PATH").and_then(|path| {
            let file = format!("{}{}", self.program, env::consts::EXE_SUFFIX);
            env::split_paths(&path).map(|folder| folder.join(&file)).find(|path| path.is_file())
        });
        let unpacked = || Some(self.folder().join("usr/bin").join(self.program)).filter(|path| path.is_file());
        match installed {
            Some(path) => Some(InstalledProgram { path, libraries: Vec::new() }),
            None => unpacked().map(|path| InstalledProgram { path, libraries: debian::libraries(&self.folder()) }),
        }
    }

    /// The folder for unpacking if the program cannot be installed.
    fn folder(&self) -> PathBuf {
        system::target().join("tools").join(self.program)
    }
}

/// An installed or unpacked program.
pub struct InstalledProgram {
    path: PathBuf,
    /// The folders of its libraries, unless they are the system's.
    libraries: Vec<PathBuf>,
}

impl InstalledProgram {
    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The command that runs it with `args`.
    pub fn command(&self, args: &[&str]) -> Result<Command> {
        let mut command = command(&self.path.to_string_lossy(), args);
        if !self.libraries.is_empty() {
            command.env("LD_LIBRARY_PATH", env::join_paths(&self.libraries)?);
        }
        Ok(command)
    }
}

impl fmt::Display for InstalledProgram {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", Path::display(&self.path))
    }
}

/// A subcommand, which its author publishes as a crate.
pub struct CargoTool {
    name: &'static str,
    version: &'static str,
}

/// Breaks code, and looks whether tests notice.
pub const MUTANTS: CargoTool = CargoTool { name: "mutants", version: "27.1.0" };

/// Compares what two versions of a crate offer.
pub const SEMVER_CHECKS: CargoTool = CargoTool { name: "semver-checks", version: "0.51.0" };

/// Looks dependencies up in the database of advisories.
pub const DENY: CargoTool = CargoTool { name: "deny", version: "0.20.2" };

impl CargoTool {
    /// The command that runs it, without arguments. It is first built into the folder of build results, unless it is there.
    pub fn command(&self) -> Result<Command> {
        let CargoTool { name, version } = self;
        let folder = system::target().join("tools").join(format!("cargo-{name}-{version}"));
        let program = folder.join("bin").join(format!("cargo-{name}{}", env::consts::EXE_SUFFIX));
        if !program.is_file() {
            let mut install =
                command("cargo", ["install", "--quiet", "--locked", &format!("cargo-{name}"), "--version", version]);
            // Elsewhere than the workspace's: its flags are not for others.
            install.arg("--root").arg(&folder).arg("--target-dir").arg(folder.join("build"));
            run(&mut install).with_context(|| format!("cargo-{name} cannot be installed"))?;
            fs::remove_dir_all(folder.join("build"))?;
        }
        Ok(command(&program.to_string_lossy(), [name]))
    }
}

/// The time limit for adding targets to the active toolchain. It fails sooner if no server answers.
const ADDING_LIMIT: Duration = Duration::from_secs(120);

/// A Rust toolchain that has the requested targets.
pub enum Toolchain {
    /// The active toolchain.
    Active,
    /// A separate one in this folder.
    Own(PathBuf),
}

impl Toolchain {
    /// Finds or makes a toolchain for `targets`: the active one if it has them or rustup can add them,
    /// otherwise one made from Debian's packages.
    pub fn install(targets: &[&str]) -> Result<Toolchain> {
        if Toolchain::Active.has(targets)? {
            return Ok(Toolchain::Active);
        }
        let own = system::target().join("edge-toolchain");
        if debian::is_toolchain(&own, targets)? {
            return Ok(Toolchain::Own(own));
        }
        let Err(refusal) = add(targets) else { return Ok(Toolchain::Active) };
        eprintln!("setup: {refusal:#}");
        if !debian::can_install() {
            bail!(
                "no compiler for {}; run\n  rustup target add {}\nor, as root on Debian, this command again",
                targets.join(", "),
                targets.join(" ")
            );
        }
        debian::make_toolchain(&own, targets)?;
        Ok(Toolchain::Own(own))
    }

    /// The cargo command `verb` with this toolchain and the firmware's target folder.
    pub fn cargo(&self, verb: &str) -> Command {
        self.cargo_in(&system::edge_target(), verb)
    }

    /// [`cargo`](Toolchain::cargo) with a folder for what it builds.
    pub fn cargo_in(&self, target: &Path, verb: &str) -> Command {
        let mut cargo = command("cargo", [verb, "--target-dir"]);
        cargo.arg(target);
        self.set_for(&mut cargo);
        cargo
    }

    /// Sets this toolchain for `command`, which runs cargo.
    pub fn set_for<'c>(&self, command: &'c mut Command) -> &'c mut Command {
        // The user's flags are for the host's processor.
        command.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS").env_remove("CARGO_BUILD_TARGET");
        if let Toolchain::Own(folder) = self {
            // `cargo run` sets these for the active toolchain.
            command.env_remove("RUSTC").env_remove("RUSTDOC").env_remove("LD_LIBRARY_PATH").env("RUSTUP_TOOLCHAIN", folder);
        }
        command
    }

    fn has(&self, targets: &[&str]) -> Result<bool> {
        let libraries =
            targets.iter().map(|target| read(&mut command("rustc", ["--print", "target-libdir", "--target", target])));
        let libraries = libraries.collect::<Result<Vec<_>>>()?;
        Ok(libraries.iter().all(|folder| has_core(Path::new(folder))))
    }
}

impl fmt::Display for Toolchain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Toolchain::Active => write!(f, "the active toolchain"),
            Toolchain::Own(folder) => write!(f, "{}", folder.display()),
        }
    }
}

/// The target that the active toolchain builds for by itself.
pub fn host_target() -> Result<String> {
    let version = read(&mut command("rustc", ["-vV"]))?;
    version.lines().find_map(|line| line.strip_prefix("host: ")).map(str::to_owned).context("rustc does not tell its host")
}

/// Adds `targets` to the active toolchain with rustup.
fn add(targets: &[&str]) -> Result<()> {
    let mut rustup = command("rustup", ["target", "add"].iter().chain(targets));
    rustup.env("RUSTUP_MAX_RETRIES", "0");
    run_within(&mut rustup, ADDING_LIMIT).context("rustup cannot add the targets")
}

/// Returns true if `folder` contains the core library.
fn has_core(folder: &Path) -> bool {
    let Ok(entries) = fs::read_dir(folder) else { return false };
    entries.flatten().any(|entry| entry.file_name().to_string_lossy().starts_with("libcore-"))
}
