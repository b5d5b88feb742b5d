//! Tests the kernel of 64-bit Arm, emulated on other machines.

use anyhow::{Context, Result, ensure};
use std::{env, path::Path};

use crate::{
    system::process::run,
    tools::{tool, toolchain::Toolchain},
};

const TARGET: &str = "aarch64-unknown-linux-gnu";

/// The target's system libraries.
const SYSROOT: &str = "/usr/aarch64-linux-gnu";

/// Compares every kernel of the host's engine on the target with the float reference.
pub fn run_tests() -> Result<()> {
    match (env::consts::ARCH, env::consts::OS) {
        ("aarch64", _) => println!("aarch64: skipped, the tests in debug and release cover this machine's kernel"),
        (_, "linux") => emulate()?,
        (_, system) => println!("aarch64: skipped, the emulator does not run on {system}"),
    }
    Ok(())
}

fn emulate() -> Result<()> {
    let (linker, emulator) = (tool::AARCH64_CC.install()?, tool::QEMU_AARCH64.install()?);
    ensure!(Path::new(SYSROOT).is_dir(), "{SYSROOT} is missing; run\n  sudo apt-get install libc6-dev-arm64-cross");
    let toolchain = Toolchain::install(&[TARGET]).context("the Rust target of 64-bit Arm")?;
    let mut tests = toolchain.cargo("test");
    tests.env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER", linker.path());
    tests.env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER", format!("{emulator} -L {SYSROOT}"));
    tests.env("CARGO_PROFILE_DEV_DEBUG", "0");
    tests.args(["--package", "multiscopic-tests", "--no-default-features", "--test", "matching", "--target", TARGET]);
    // The engine's matches, and random matches of semi-global matching.
    tests.args(["--", "engine::", "semi_global::"]);
    run(&mut tests).context("a kernel of 64-bit Arm differs from the reference")?;
    println!("aarch64: every kernel equals the reference in the emulator");
    Ok(())
}
