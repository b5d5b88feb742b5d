//! Runs the tests of everything that computes with AddressSanitizer, which ends them at an access outside of what was allocated.

use anyhow::Result;

use super::fuzzing::UNSTABLE;
use crate::{
    system::{
        folders,
        process::{command, run},
    },
    tools::toolchain,
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

/// Builds the tests in a folder of their own, a little optimised, since the sanitizer makes them slower, and runs them.
pub fn run_tests() -> Result<()> {
    // With a target, build scripts and macros are not instrumented.
    let mut cargo =
        command("cargo", ["test", "--locked", "--target", &toolchain::host()?, "--config", "profile.dev.opt-level=1"]);
    cargo.arg("--target-dir").arg(folders::target().join("sanitized")).args(TESTS);
    run(cargo.env("RUSTFLAGS", "-Zsanitizer=address").env(UNSTABLE.0, UNSTABLE.1))
}
