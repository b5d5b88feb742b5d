//! The suites of checks: what `check`, `lint` and `test` run.

use anyhow::{Context, Result, anyhow, ensure};
use std::{path::Path, process::Command, time::Instant};

use super::{emulated_arm64, emulated_cameras, fuzzing, host_instructions, pages, python_package, sanitizing::Sanitizing};
use crate::{
    emulation::{
        build,
        emulated_board::{self, EmulatedBoard},
        setup,
    },
    firmware_checks::{
        bit_flips::BitFlips, capturing, cycles, distorted_set::DistortedSet, faults, kernel_twins, pico2, profiles,
    },
    publishing::{crates, release, supply_chain::SupplyChain},
    system::{
        background_task::BackgroundTask,
        folders,
        process::{OPTIMIZED, PYTHON_PACKAGE, built_optimized_program, built_program, command, run},
    },
    tools::toolchain::Toolchain,
};

/// The tests of `check`: units, and the comparisons of all methods with their references.
const QUICK: [&str; 9] = [
    "-pmultiscopic-core",
    "-pmultiscopic",
    "-pmultiscopic-cli",
    "-pmultiscopic-edge",
    "-pmultiscopic-tests",
    "--lib",
    "--bins",
    "--test=matching",
    "--test=methods",
];

/// The tests that optimisation might change: of what computes, not of what talks to users, browsers, cameras and stages.
const COMPUTATIONS: [&str; 7] = [
    "--lib",
    "--test=matching",
    "--test=methods",
    "--test=mccnn",
    "--test=outside_bytes",
    "--test=real_data",
    "--test=rectified_lines",
];
/// The parts of others with tests that take minutes in debug, which leaves them out.
const LONG: [&str; 14] = [
    "--test=commands",
    "--test=capture",
    "--",
    "alignment",
    "arrays",
    "calibrations",
    "commands_that_are_killed",
    "edge_commands",
    "filters",
    "lenses",
    "memory_demand",
    "mounts",
    "search_ranges",
    "the_truth_is",
];

/// The checks for every change.
pub fn check() -> Result<()> {
    step("formatting", formatting)?;
    step("architecture", architecture)?;
    step("lints", lints)?;
    step("unit and bit-exactness tests", || run(cargo(&["test"]).args(QUICK)))?;
    println!("\nevery check passed; `cargo xtask test` runs every test");
    Ok(())
}

/// Prints every violation of the architecture; fails if there is one.
pub fn architecture() -> Result<()> {
    let violations = multiscopic_tests::architecture::check(folders::root()).map_err(|error| anyhow!("{error}"))?;
    violations.iter().for_each(|violation| eprintln!("{violation}"));
    ensure!(violations.is_empty(), "{} violations of the architecture", violations.len());
    println!("architecture: no violations");
    Ok(())
}

/// The static checks.
pub fn lint() -> Result<()> {
    let toolchain = step("setup", setup::run)?;
    step("formatting", formatting)?;
    step("architecture", architecture)?;
    step("lints", lints)?;
    step("lints for Arm", || lints_for_arm(&toolchain))?;
    step("lints for RISC-V", lints_for_risc_v)?;
    step("lints for the Pico 2", || pico2::lint(&toolchain))?;
    step("supply chain", || SupplyChain::CHECK.run())?;
    step("documentation", || run(cargo(&["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-Dwarnings")))
}

/// Every test. Those of the firmware run in the background: their compilers and emulators use one processor at a time.
pub fn test() -> Result<()> {
    step("setup", setup::run)?;
    let firmware = BackgroundTask::start("firmware")?;
    step("tests in debug", || {
        run_tests(&built_program()?, &["--workspace", "--exclude", PYTHON_PACKAGE])?;
        // As most firmware has it. In the workspace, the tests' features are on.
        run(&mut cargo(&["test", "-pmultiscopic-core", "--lib"]))
    })?;
    step("units under AddressSanitizer", || Sanitizing::UNITS.run_tests())?;
    step("a short fuzz run under AddressSanitizer", fuzzing::run_shortly)?;
    step("the Python package", python_package::run_tests)?;
    step("the published packages", crates::check)?;
    step("computations in release", || run_optimized_tests(&COMPUTATIONS))?;
    step("long tests in release", || run_optimized_tests(&LONG))?;
    step("archives of the program", release::check)?;
    step("pages in a browser", pages::run_tests)?;
    step("instructions", || host_instructions::Guard::COMPARE.run())?;
    step("cameras in a virtual machine", emulated_cameras::run_tests)?;
    step("64-bit Arm", emulated_arm64::run_tests)?;
    step("the firmware", || firmware.finish())?;
    println!("\nevery test passed");
    Ok(())
}

/// Every test of the firmware, and of the libraries as firmware depends on them.
pub fn firmware() -> Result<()> {
    let toolchain = step("setup", setup::run)?;
    step("the libraries for Arm", || libraries_for_arm(&toolchain))?;
    step("the firmware for the Pico 2", || pico2::build(&toolchain))?;
    step("the kernels in the emulator", || kernel_twins::run(&toolchain))?;
    step("the firmware in the emulator", || profiles::run(&toolchain, &profiles::Selection::once()))?;
    step("the firmware's cycles", || cycles::Accounting::compare().run(&toolchain))?;
    step("the firmware that captures", || capturing::run(&toolchain))?;
    step("the firmware's faults", || faults::run(&toolchain))?;
    step("flipped bits", || BitFlips::few().run(&toolchain))
}

/// Runs a named step and reports its time.
fn step<T>(name: &str, run: impl FnOnce() -> Result<T>) -> Result<T> {
    println!("\n== {name}");
    let start = Instant::now();
    let done = run().with_context(|| format!("step failed: {name}"))?;
    println!("== {name}: passed in {:.0} s", start.elapsed().as_secs_f64());
    Ok(done)
}

fn formatting() -> Result<()> {
    run(&mut cargo(&["fmt", "--all", "--check"]))?;
    run(&mut cargo(&["fmt", "--check", "--manifest-path", fuzzing::MANIFEST]))?;
    run(&mut cargo(&["fmt", "--check", "--manifest-path", pico2::MANIFEST]))
}

fn lints() -> Result<()> {
    run(&mut cargo(&["clippy", "--workspace", "--all-targets", "--", "-Dwarnings"]))?;
    // The program of other systems than Linux, which have no V4L2, and the library alone.
    for package in ["multiscopic-cli", "multiscopic"] {
        run(&mut cargo(&["clippy", "--package", package, "--no-default-features", "--", "-Dwarnings"]))?;
    }
    fuzzing::lint()
}

fn run_tests(program: &Path, selection: &[&str]) -> Result<()> {
    run(cargo(&["test"]).args(selection).env("MULTISCOPIC_BINARY", program))
}

fn run_optimized_tests(selection: &[&str]) -> Result<()> {
    run_tests(&built_optimized_program()?, &[&OPTIMIZED[..], &["--release"], selection].concat())
}

fn libraries_for_arm(toolchain: &Toolchain) -> Result<()> {
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

fn lints_for_arm(toolchain: &Toolchain) -> Result<()> {
    DistortedSet::render()?.write(&folders::flash_set())?;
    // Examples of libraries run on this machine.
    let libraries = ["multiscopic-core", "multiscopic-edge", "multiscopic-drivers"].map(|package| format!("--package={package}"));
    let firmware = ["--package=multiscopic-firmware", "--features=multiscopic-firmware/flash-set", "--bins", "--examples"];
    emulated_board::targets().iter().try_for_each(|target| {
        let clippy = |arguments: &[&str]| {
            let mut clippy = toolchain.cargo("clippy");
            clippy.env(build::FLASH_SET, folders::flash_set());
            run(clippy.args(["--target", target, "--lib"]).args(arguments).args(["--", "-Dwarnings"]))
        };
        clippy(&libraries.each_ref().map(String::as_str))?;
        clippy(&firmware)
    })
}

fn lints_for_risc_v() -> Result<()> {
    let EmulatedBoard { target, feature, .. } = &emulated_board::RISC_V;
    let mut clippy = Toolchain::install(&[target])?.cargo("clippy");
    // Of the examples, some use registers of Arm.
    clippy.args(["--target", target, "--package=multiscopic-firmware", "--lib", "--bins"]);
    run(clippy.args(feature.map(|feature| format!("--features={feature}"))).args(["--", "-Dwarnings"]))
}

fn cargo(args: &[&str]) -> Command {
    command("cargo", args)
}
