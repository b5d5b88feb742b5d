//! Runs tests in Miri, an interpreter that ends them at undefined behaviour: an access outside of what was allocated, a
//! misaligned one, memory that was never written, references that must not exist at once, a race between threads.

use anyhow::{Result, bail};

use crate::{
    system::{self, command, read, run},
    tools,
};

/// The toolchain that has Miri, and how to get it.
const NIGHTLY: &str = "nightly";
const INSTALLING: &str = "rustup toolchain install nightly --component miri,rust-src";

/// Processors, and their features as flags of the compiler. Miri knows few instructions of AVX-512.
const PROCESSORS: [(&str, &str); 2] = [("the baseline alone", ""), ("AVX2", "-Ctarget-feature=+avx2,+bmi1,+bmi2,+lzcnt,+popcnt")];

/// The units of the core, without those that try all numbers, and the comparisons of matchers with their references on
/// small images.
const TESTS: [&[&str]; 2] = [
    &["--package=multiscopic-core", "--features=array,network", "--lib", "--", "--skip=disparity::"],
    &[
        "--package=multiscopic-tests",
        "--test=matching",
        "--",
        "small_matches",
        "engines_equal",
        "priors::",
        "semi_global_matches",
        "--skip=wide_images",
    ],
];

/// Runs the tests for each processor, on a few of the usual random values.
pub fn run_tests() -> Result<()> {
    let miri = ["run", NIGHTLY, "cargo", "miri"];
    if read(command("rustup", miri).arg("--version")).is_err() {
        bail!("Miri is not installed; run\n  {INSTALLING}");
    }
    let is_x86 = tools::host_target()?.starts_with("x86_64");
    for (processor, features) in PROCESSORS.into_iter().filter(|(_, features)| features.is_empty() || is_x86) {
        println!("miri: a processor with {processor}");
        for tests in TESTS {
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
