//! Tests the kernel of 64-bit Arm and the whole program there, emulated on other machines.

use anyhow::{Context, Result, ensure};
use std::{env, fs, path::Path, process::Command};

use crate::{
    system::{self, built_program, run},
    tools::{self, Toolchain},
};

const TARGET: &str = "aarch64-unknown-linux-gnu";

/// Methods, with options that other code runs for.
const METHODS: [&str; 7] = [
    "bm",
    "bm --fusion heuristic --median 3 --uniqueness-ratio 5",
    "sgm",
    "sgm --cost census2 --sub-pixel lucas-kanade",
    "gc",
    "net",
    "net --smooth",
];

/// The target's system libraries.
const SYSROOT: &str = "/usr/aarch64-linux-gnu";

/// Compares every kernel of the host's engine on the target with the float reference, and the program's maps with this machine's.
pub fn run_tests() -> Result<()> {
    match (env::consts::ARCH, env::consts::OS) {
        ("aarch64", _) => println!("aarch64: skipped, the other tests cover this machine's kernel"),
        (_, "linux") => emulate()?,
        (_, system) => println!("aarch64: skipped, the emulator does not run on {system}"),
    }
    Ok(())
}

fn emulate() -> Result<()> {
    let (linker, emulator) = (tools::AARCH64_CC.install()?, tools::QEMU_AARCH64.install()?);
    ensure!(Path::new(SYSROOT).is_dir(), "{SYSROOT} is missing; run\n  sudo apt-get install libc6-dev-arm64-cross");
    let toolchain = Toolchain::install(&[TARGET]).context("the Rust target of 64-bit Arm")?;
    let cargo = |verb: &str| {
        let mut cargo = toolchain.cargo(verb);
        cargo.env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER", linker.path());
        cargo.env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER", format!("{emulator} -L {SYSROOT}"));
        cargo.env("CARGO_PROFILE_DEV_DEBUG", "0");
        cargo.args(["--package", "multiscopic-cli", "--package", "multiscopic-tests", "--target", TARGET]);
        cargo.args(["--no-default-features", "--features", "multiscopic-cli/v4l2"]);
        cargo
    };
    // Together, so that the library is built once.
    run(cargo("build").args(["--bin", "multiscopic"]))?;
    // The engine's matches, and random matches of semi-global matching.
    run(cargo("test").args(["--test=matching", "--test=methods", "--", "engines_equal", "semi_global::"]))
        .context("a kernel of 64-bit Arm differs from the reference")?;
    println!("aarch64: every kernel equals the reference in the emulator");
    let program = system::edge_target().join(TARGET).join("debug/multiscopic");
    same_maps(&|| {
        let mut command = emulator.command(&["-L", SYSROOT])?;
        command.arg(&program);
        Ok(command)
    })
}

/// Compares what the whole program finds on the target, by each method, with what it finds on this machine.
fn same_maps(emulated: &dyn Fn() -> Result<Command>) -> Result<()> {
    let folder = system::target().join("aarch64");
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let native = built_program()?;
    run(Command::new(&native).args(["--quiet", "demo", "--width", "96", "--height", "72", "-o", "rig"]).current_dir(&folder))?;
    for method in METHODS {
        let maps = |command: &mut Command| -> Result<[Vec<u8>; 2]> {
            command.args(["--quiet", "match", "rig", "--num-disparities", "24", "--method"]).args(method.split(' '));
            run(command.args(["-o", "map.pfm", "--confidence", "confidence.png"]).current_dir(&folder))?;
            Ok([fs::read(folder.join("map.pfm"))?, fs::read(folder.join("confidence.png"))?])
        };
        let (here, there) = (maps(&mut Command::new(&native))?, maps(&mut emulated()?)?);
        ensure!(here[0] == there[0], "{method}: 64-bit Arm finds other disparities than this machine");
        ensure!(here[1] == there[1], "{method}: 64-bit Arm finds other confidences than this machine");
        println!("aarch64: {method}: the program finds what it finds on this machine");
    }
    Ok(())
}
