//! Checks that run no test: formatting, architecture, lints and documentation.

use anyhow::{Result, anyhow, ensure};
use std::process::Command;

use crate::{
    emulation::{
        build,
        emulated_board::{self, EmulatedBoard},
    },
    firmware_checks::rectifying::DistortedSet,
    system::{self, command, read, run},
    tools::Toolchain,
};

/// The letters that are too many for the subject of a commit.
const MOST_LETTERS: usize = 72;

/// Prints every violation of the architecture. Fails if there is one.
pub fn architecture() -> Result<()> {
    let violations = multiscopic_tests::architecture::check(system::root()).map_err(|error| anyhow!("{error}"))?;
    violations.iter().for_each(|violation| eprintln!("{violation}"));
    ensure!(violations.is_empty(), "{} violations of the architecture", violations.len());
    println!("architecture: no violations");
    Ok(())
}

/// Checks that the subjects of commits that are not yet upstream fit on a line.
pub fn subjects() -> Result<()> {
    // A clone in CI has no upstream.
    let Ok(subjects) = read(&mut command("git", ["log", "--format=%s", "@{upstream}.."])) else { return Ok(()) };
    let long: Vec<&str> = subjects.lines().filter(|subject| subject.chars().count() >= MOST_LETTERS).collect();
    ensure!(long.is_empty(), "subjects of {MOST_LETTERS} letters or more:\n{}", long.join("\n"));
    Ok(())
}

/// Builds the documentation of every crate, in which no link may lead nowhere.
pub fn documentation() -> Result<()> {
    run(cargo(&["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-Dwarnings"))
}

/// Checks the formatting of all workspaces.
pub fn formatting() -> Result<()> {
    run(&mut cargo(&["fmt", "--all", "--check"]))?;
    run(&mut cargo(&["fmt", "--check", "--manifest-path", build::PICO2_MANIFEST]))
}

/// Lints every crate for this machine.
pub fn lints() -> Result<()> {
    run(&mut cargo(&["clippy", "--workspace", "--all-targets", "--features=multiscopic-fuzz/guided", "--", "-Dwarnings"]))
}

/// Lints the program of other systems than Linux, which have no V4L2, and the library alone.
pub fn lints_without_features() -> Result<()> {
    ["multiscopic-cli", "multiscopic"]
        .iter()
        .try_for_each(|package| run(&mut cargo(&["clippy", "--package", package, "--no-default-features", "--", "-Dwarnings"])))
}

/// Compiles the libraries for every Arm target.
pub fn libraries_for_arm(toolchain: &Toolchain) -> Result<()> {
    // As a user's firmware depends on them.
    let libraries: [&[&str]; 3] = [
        &["--package", "multiscopic-core"],
        &["--package", "multiscopic-edge"],
        &["--package", "multiscopic-drivers", "--features", "stepper,hm01b0"],
    ];
    emulated_board::targets().iter().flat_map(|target| libraries.map(|library| (target, library))).try_for_each(
        |(target, library)| {
            let mut build = toolchain.cargo("rustc");
            build.args(["--release", "--no-default-features", "--lib"]).args(library);
            run(build.args(["--target", target, "--", "-Dwarnings"]))
        },
    )
}

/// Lints the libraries and the firmware for every Arm target.
pub fn lints_for_arm(toolchain: &Toolchain) -> Result<()> {
    DistortedSet::render()?.write(&system::flash_set())?;
    // Examples of libraries run on this machine.
    let libraries = ["multiscopic-core", "multiscopic-edge", "multiscopic-drivers"].map(|package| format!("--package={package}"));
    let firmware = ["--package=multiscopic-firmware", "--features=multiscopic-firmware/flash-set", "--bins", "--examples"];
    emulated_board::targets().iter().try_for_each(|target| {
        let clippy = |arguments: &[&str]| {
            let mut clippy = toolchain.cargo("clippy");
            clippy.env(build::FLASH_SET, system::flash_set());
            run(clippy.args(["--target", target, "--lib"]).args(arguments).args(["--", "-Dwarnings"]))
        };
        clippy(&libraries.each_ref().map(String::as_str))?;
        clippy(&firmware)
    })
}

/// Lints the firmware for RISC-V.
pub fn lints_for_risc_v() -> Result<()> {
    let EmulatedBoard { target, feature, .. } = &emulated_board::RISC_V;
    let mut clippy = Toolchain::install(&[target])?.cargo("clippy");
    // Of the examples, some use registers of Arm.
    clippy.args(["--target", target, "--package=multiscopic-firmware", "--lib", "--bins"]);
    run(clippy.args(feature.map(|feature| format!("--features={feature}"))).args(["--", "-Dwarnings"]))
}

fn cargo(args: &[&str]) -> Command {
    command("cargo", args)
}
