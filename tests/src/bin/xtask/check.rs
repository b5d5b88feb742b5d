//! The tests and the checks, step by step.

use anyhow::{Context, Result};
use std::{process::Command, time::Instant};

use crate::{
    aarch64, board, capture,
    command::{built_program, command, run},
    edge, faults, instructions, kernels, setup,
    toolchain::Toolchain,
    v4l2,
};

/// Every test.
pub fn test() -> Result<()> {
    let toolchain = step("setup", setup::run)?;
    step("tests in debug", || test_workspace("dev"))?;
    step("tests in release", || test_workspace("release"))?;
    step("the kernel of 64-bit Arm", aarch64::run_tests)?;
    step("instructions", || instructions::Guard::COMPARE.run())?;
    step("cameras in a virtual machine", v4l2::run_tests)?;
    step("the libraries for Arm", || libraries_for_arm(&toolchain))?;
    step("the kernels in the emulator", || kernels::run(&toolchain))?;
    step("the firmware in the emulator", || edge::run(&toolchain, &edge::Selection::default()))?;
    step("the firmware that captures", || capture::run(&toolchain))?;
    step("the firmware's faults", || faults::run(&toolchain))?;
    println!("\nevery test passed");
    Ok(())
}

/// Formatting, lints, documentation, and every test.
pub fn ci() -> Result<()> {
    let toolchain = step("setup", setup::run)?;
    step("formatting", || run(&mut cargo(&["fmt", "--all", "--check"])))?;
    step("lints", || run(&mut cargo(&["clippy", "--workspace", "--all-targets", "--", "-Dwarnings"])))?;
    step("lints for Arm", || lints_for_arm(&toolchain))?;
    step("documentation", || run(cargo(&["doc", "--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-Dwarnings")))?;
    test()
}

/// Runs a step, and names it if it fails.
fn step<T>(name: &str, run: impl FnOnce() -> Result<T>) -> Result<T> {
    println!("\n== {name}");
    let start = Instant::now();
    let done = run().with_context(|| format!("step failed: {name}"))?;
    println!("== {name}: passed in {:.0} s", start.elapsed().as_secs_f64());
    Ok(done)
}

fn test_workspace(profile: &str) -> Result<()> {
    let program = built_program(profile)?;
    run(cargo(&["test", "--workspace", "--profile", profile]).env("MULTISCOPIC_BINARY", program))
}

fn libraries_for_arm(toolchain: &Toolchain) -> Result<()> {
    let libraries: [&[&str]; 3] = [
        &["--package", "multiscopic-core"],
        &["--package", "multiscopic-edge"],
        &["--package", "multiscopic-drivers", "--features", "stepper,hm01b0"],
    ];
    board::targets().iter().flat_map(|target| libraries.map(|library| (target, library))).try_for_each(|(target, library)| {
        let mut build = toolchain.cargo("rustc");
        build.args(["--release", "--no-default-features", "--lib"]).args(library);
        run(build.args(["--target", target, "--", "-Dwarnings"]))
    })
}

fn lints_for_arm(toolchain: &Toolchain) -> Result<()> {
    board::targets().iter().try_for_each(|target| {
        let mut clippy = toolchain.cargo("clippy");
        let packages = ["multiscopic-core", "multiscopic-edge", "multiscopic-drivers", "multiscopic-firmware"];
        run(clippy.args(packages.map(|package| format!("--package={package}"))).args([
            "--target",
            target,
            "--lib",
            "--bins",
            "--examples",
            "--",
            "-Dwarnings",
        ]))
    })
}

fn cargo(args: &[&str]) -> Command {
    command("cargo", args)
}
