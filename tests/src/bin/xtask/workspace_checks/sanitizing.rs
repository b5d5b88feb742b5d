//! Runs the tests of everything that computes under watch. An access outside of what was allocated ends them, or a decision
//! by memory that was never written; in Miri, an interpreter, any undefined behaviour: also a misaligned access, references that
//! must not exist at once, a race between threads.

use anyhow::{Result, bail};
use clap::Args;
use std::{path::PathBuf, process::Command};

use crate::{
    system::{self, command, read, run},
    tools,
};

/// The units of the libraries, and the comparisons of all methods and kernels with their references.
const TESTS: [&str; 8] = [
    "--package=multiscopic-core",
    "--package=multiscopic-edge",
    "--package=multiscopic",
    "--package=multiscopic-reference",
    "--package=multiscopic-tests",
    "--lib",
    "--test=matching",
    "--test=methods",
];

/// The tool that watches the tests.
#[derive(Args)]
pub struct Sanitizing {
    /// Watch with Valgrind instead of AddressSanitizer: it also sees memory that was never written, but takes thirty times
    /// as long, so that it gets a tenth of the random values, and it has no AVX-512
    #[arg(long)]
    valgrind: bool,
}

impl Sanitizing {
    /// In AddressSanitizer.
    pub const ADDRESSES: Sanitizing = Sanitizing { valgrind: false };
    /// In Valgrind.
    pub const VALGRIND: Sanitizing = Sanitizing { valgrind: true };

    /// Builds the tests in a folder of their own and runs them. All of them are a little optimised, since watching makes them
    /// slower.
    pub fn run_tests(&self) -> Result<()> {
        let mut cargo = if self.valgrind { under_valgrind()? } else { under_address_sanitizer()? };
        run(cargo.args(["--no-fail-fast", "--config", "profile.dev.opt-level=1"]).args(TESTS))
    }
}

/// The cargo command that runs tests under AddressSanitizer: those of the fuzz targets' seeds, too, without their limit of
/// addresses.
fn under_address_sanitizer() -> Result<Command> {
    let (mut cargo, _) = instrumented("test", "-Zsanitizer=address", "sanitized")?;
    cargo.args(["--package=multiscopic-fuzz", "--test=seeds"]).env("MULTISCOPIC_UNLIMITED", "1");
    Ok(cargo)
}

/// The cargo command `verb` for instrumented code, with a target folder of this name, and where the folders of profiles are.
pub fn instrumented(verb: &str, instruments: &str, folder: &str) -> Result<(Command, PathBuf)> {
    let (mut cargo, folder) = apart(verb, folder)?;
    // Lets stable Rust use a sanitizer, which it has but does not promise to keep.
    cargo.env("RUSTFLAGS", instruments).env("RUSTC_BOOTSTRAP", "1");
    Ok((cargo, folder))
}

/// The command that runs tests in Valgrind.
fn under_valgrind() -> Result<Command> {
    let (valgrind, (mut cargo, _)) = (tools::VALGRIND.install()?, apart("test", "watched")?);
    cargo.env("MULTISCOPIC_EFFORT", "0.1");
    let runner = format!("CARGO_TARGET_{}_RUNNER", tools::host_target()?.replace('-', "_").to_uppercase());
    cargo.env(runner, format!("{valgrind} --quiet --error-exitcode=99 --main-stacksize=67108864"));
    Ok(cargo)
}

/// The cargo command `verb` with a target folder of this name, and where the folders of profiles are.
pub fn apart(verb: &str, folder: &str) -> Result<(Command, PathBuf)> {
    let (host, folder) = (tools::host_target()?, system::target().join(folder));
    // With a target, build scripts and macros are neither instrumented nor watched.
    let mut cargo = command("cargo", [verb, "--locked", "--target", &host, "--target-dir"]);
    cargo.arg(&folder);
    Ok((cargo, folder.join(host)))
}

/// The toolchain that has Miri, and how to get it.
const NIGHTLY: &str = "nightly";
const INSTALLING: &str = "rustup toolchain install nightly --component miri,rust-src";

/// Processors, and their features as flags of the compiler. Miri knows few instructions of AVX-512.
const MIRI_PROCESSORS: [(&str, &str); 2] =
    [("the baseline alone", ""), ("AVX2", "-Ctarget-feature=+avx2,+bmi1,+bmi2,+lzcnt,+popcnt")];

/// The units of the core, without those that try all numbers, and the comparisons of matchers with their references on
/// small images.
const MIRI_TESTS: [&[&str]; 2] = [
    &["--package=multiscopic-core", "--features=array,network", "--lib", "--", "--skip=disparity::"],
    &[
        "--package=multiscopic-tests",
        "--test=matching",
        "--test=methods",
        "--",
        "small_matches",
        "engines_equal",
        "priors::",
        "semi_global_matches",
        "--skip=wide_images",
    ],
];

/// Runs tests in Miri for each processor, on a few of the usual random values.
pub fn run_tests_in_miri() -> Result<()> {
    let miri = ["run", NIGHTLY, "cargo", "miri"];
    if read(command("rustup", miri).arg("--version")).is_err() {
        bail!("Miri is not installed; run\n  {INSTALLING}");
    }
    let is_x86 = tools::host_target()?.starts_with("x86_64");
    for (processor, features) in MIRI_PROCESSORS.into_iter().filter(|(_, features)| features.is_empty() || is_x86) {
        println!("miri: a processor with {processor}");
        for tests in MIRI_TESTS {
            let mut cargo = command("rustup", miri);
            cargo.args(["test", "--locked", "--no-default-features", "--target-dir"]).arg(system::target().join("miri"));
            // Rayon's queues break the rules of Stacked Borrows, and its threads run until the program ends.
            let flags = "-Zmiri-disable-isolation -Zmiri-tree-borrows -Zmiri-permissive-provenance -Zmiri-ignore-leaks";
            cargo.env("MIRIFLAGS", flags).env("RUSTFLAGS", features).env("MULTISCOPIC_EFFORT", "0.003");
            run(cargo.args(tests))?;
        }
    }
    Ok(())
}
