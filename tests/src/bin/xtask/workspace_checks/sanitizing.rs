//! Runs the tests of everything that computes under watch. An access outside of what was allocated ends them, or a decision
//! by memory that was never written.

use anyhow::Result;
use clap::Args;

use super::fuzzing::UNSTABLE;
use crate::{
    system::{
        folders,
        process::{command, run},
    },
    tools::{tool, toolchain},
};

/// The units of the libraries, and the comparisons of all methods and kernels with their references.
const TESTS: [&str; 7] = [
    "--package=multiscopic-core",
    "--package=multiscopic-edge",
    "--package=multiscopic",
    "--package=multiscopic-tests",
    "--lib",
    "--test=matching",
    "--test=methods",
];

/// What watches the tests.
#[derive(Args)]
pub struct Sanitizing {
    /// Watch with Valgrind instead of AddressSanitizer: it also sees memory that was never written, but takes thirty times
    /// as long and has no AVX-512
    #[arg(long)]
    valgrind: bool,
}

impl Sanitizing {
    /// Builds the tests in a folder of their own, a little optimised, since watching makes them slower, and runs them.
    pub fn run_tests(&self) -> Result<()> {
        // With a target, build scripts and macros are not instrumented.
        let host = toolchain::host()?;
        let mut cargo = command("cargo", ["test", "--locked", "--target", &host, "--config", "profile.dev.opt-level=1"]);
        if self.valgrind {
            let valgrind = tool::VALGRIND.install()?;
            let runner = format!("CARGO_TARGET_{}_RUNNER", host.replace('-', "_").to_uppercase());
            cargo.env(runner, format!("{valgrind} --quiet --error-exitcode=99 --main-stacksize=67108864"));
            cargo.args(["--target-dir".as_ref(), folders::target().join("watched").as_os_str()]);
        } else {
            cargo.env("RUSTFLAGS", "-Zsanitizer=address").env(UNSTABLE.0, UNSTABLE.1);
            cargo.args(["--target-dir".as_ref(), folders::target().join("sanitized").as_os_str()]);
        }
        run(cargo.args(TESTS))
    }
}
