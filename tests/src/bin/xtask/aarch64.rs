//! Tests the kernel of 64-bit Arm, in the emulator where this machine is another.

use anyhow::{Context, Result, ensure};
use std::env;

use crate::{
    command::{read, run},
    tool,
    toolchain::Toolchain,
};

const TARGET: &str = "aarch64-unknown-linux-gnu";

/// Where Debian's cross compiler has the target's libraries.
const SYSROOT: &str = "/usr/aarch64-linux-gnu";

/// Compares every kernel that this target has, and the portable one, with the float reference.
pub fn run_tests() -> Result<()> {
    if env::consts::ARCH == "aarch64" {
        println!("aarch64: this machine is one, the tests in release compare its kernel");
        return Ok(());
    }
    let (linker, emulator) = (tool::AARCH64_CC.install()?, tool::QEMU_AARCH64.install()?);
    let toolchain = Toolchain::install(&[TARGET]).context("the Rust target of 64-bit Arm")?;
    // An emulator that has no NEON, or a library that is not found, would otherwise look like a kernel that is wrong.
    read(&mut emulator.command(&["--version"])?)?;
    ensure!(std::path::Path::new(SYSROOT).is_dir(), "{SYSROOT} is missing: install libc6-dev-arm64-cross");
    let mut tests = toolchain.cargo("test");
    tests.env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER", linker.path());
    tests.env("CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER", format!("{} -L {SYSROOT}", emulator));
    // Optimising all of it takes longer than what it saves here.
    tests.env("CARGO_PROFILE_DEV_OPT_LEVEL", "1").env("CARGO_PROFILE_DEV_DEBUG", "0");
    tests.args(["--package", "multiscopic-tests", "--test", "engine", "--test", "bit_exact", "--target", TARGET]);
    run(&mut tests).context("the kernel of 64-bit Arm")
}
