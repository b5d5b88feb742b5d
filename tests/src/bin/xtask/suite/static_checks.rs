//! Checks that run no test: formatting, architecture, lints, documentation, and the features of what builds depend on.

use anyhow::{Context, Result, anyhow, ensure};
use multiscopic_core::Fusion;
use multiscopic_edge::profile;
use std::{
    collections::{BTreeMap, BTreeSet},
    process::Command,
};

use crate::{
    emulation::{
        build::{self, Program},
        emulated_board::{self, EmulatedBoard},
    },
    firmware_checks::{price_fit::write_calibrations, rectifying::DistortedSet},
    system::{self, OPTIMIZED, OPTIMIZED_PROGRAM, PYTHON_PACKAGE, checked_cargo, command, read, run},
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
    run(checked_cargo("doc").args(["--workspace", "--no-deps"]).env("RUSTDOCFLAGS", "-Dwarnings"))
}

/// Checks the formatting of all workspaces.
pub fn formatting() -> Result<()> {
    run(&mut cargo(&["fmt", "--all", "--check"]))?;
    [build::PICO2, build::START]
        .iter()
        .try_for_each(|folder| run(cargo(&["fmt", "--check", "--manifest-path"]).arg(format!("{folder}/Cargo.toml"))))
}

/// Lints every crate for this machine.
pub fn lints() -> Result<()> {
    let selection = ["--workspace", "--all-targets", "--features=multiscopic-fuzz/guided", "--", "-Dwarnings"];
    run(checked_cargo("clippy").args(selection))
}

/// Lints the program of other systems than Linux, which have no V4L2, and the library alone.
pub fn lints_without_features() -> Result<()> {
    ["multiscopic-cli", "multiscopic"].iter().try_for_each(|package| {
        run(checked_cargo("clippy").args(["--package", package, "--no-default-features", "--", "-Dwarnings"]))
    })
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

/// The processors that the core is compiled for: their targets, and the compiler's flags. A Cortex-M23 runs the instructions of a
/// Cortex-M0+ too, and rustup has no library for its own target on every server.
const CORES: [(&str, &str, &str); 10] = [
    ("Cortex-M0+", "thumbv6m-none-eabi", ""),
    ("Cortex-M23", "thumbv6m-none-eabi", "-Ctarget-cpu=cortex-m23"),
    ("Cortex-M3", "thumbv7m-none-eabi", ""),
    ("Cortex-M4 and M7", "thumbv7em-none-eabihf", ""),
    ("Cortex-M33 without DSP", "thumbv8m.main-none-eabihf", ""),
    ("Cortex-M33", "thumbv8m.main-none-eabihf", "-Ctarget-cpu=cortex-m33"),
    ("Cortex-M55", "thumbv8m.main-none-eabihf", "-Ctarget-cpu=cortex-m55"),
    ("Cortex-M85", "thumbv8m.main-none-eabihf", "-Ctarget-cpu=cortex-m85"),
    ("RV32IMC", "riscv32imc-unknown-none-elf", ""),
    ("RV32IMAC", "riscv32imac-unknown-none-elf", ""),
];

/// Compiles the core for every processor, with the kernel that each gets.
pub fn core_for_each_processor() -> Result<()> {
    for (core, target, flags) in CORES {
        let mut check = Toolchain::install(&[target])?.cargo("check");
        check.args(["--package", "multiscopic-core", "--target", target]).env("RUSTFLAGS", format!("-Dwarnings {flags}"));
        run(&mut check).with_context(|| format!("the core for a {core}"))?;
    }
    Ok(())
}

/// The profile that `test` builds firmware with, which then needs no other macros and build scripts than the lints.
const AS_FIRMWARE: [&str; 2] = ["--profile", "firmware"];

/// Lints the libraries and the firmware for Arm, and the kernel that only a processor with vectors has.
pub fn lints_for_arm(toolchain: &Toolchain) -> Result<()> {
    DistortedSet::render()?.write(&system::flash_set())?;
    write_calibrations(0, &[profile::QQVGA, profile::QQVGA_SGM].map(|profile| profile.matching(Fusion::Min)))?;
    // Examples of libraries run on this machine.
    let libraries = ["multiscopic-core", "multiscopic-edge", "multiscopic-c", "multiscopic-drivers"]
        .map(|package| format!("--package={package}"));
    let firmware = [
        "--package=multiscopic-firmware",
        "--features=multiscopic-firmware/flash-set,multiscopic-firmware/calibrations",
        "--bins",
        "--examples",
    ];
    let clippy = |arguments: &[&str]| {
        let mut clippy = toolchain.cargo("clippy");
        clippy.envs(Program::FlashExample("qqvga-rectified").setting().1).envs(Program::Calibrations(0).setting().1);
        clippy.args(AS_FIRMWARE).args(["--target", emulated_board::REFERENCE.target, "--lib"]);
        run(clippy.args(arguments).args(["--", "-Dwarnings"]))
    };
    clippy(&libraries.each_ref().map(String::as_str))?;
    clippy(&firmware)?;
    let EmulatedBoard { target, rustflags, .. } = &emulated_board::VECTORS;
    let mut vectors = toolchain.cargo("clippy");
    vectors.args(AS_FIRMWARE).args(["--target", target, "--lib", "--package=multiscopic-core"]).env("RUSTFLAGS", rustflags);
    run(vectors.args(["--", "-Dwarnings"]))
}

/// Lints the firmware for RISC-V.
pub fn lints_for_risc_v() -> Result<()> {
    let EmulatedBoard { target, feature, .. } = &emulated_board::RISC_V;
    let mut clippy = Toolchain::install(&[target])?.cargo("clippy");
    // Of the examples, some use registers of Arm.
    clippy.args(AS_FIRMWARE).args(["--target", target, "--package=multiscopic-firmware", "--lib", "--bins"]);
    run(clippy.args(feature.map(|feature| format!("--features={feature}"))).args(["--", "-Dwarnings"]))
}

/// Packages that take a moment to build, and `serde_json`: what decodes the firmware's log makes it keep all digits of numbers,
/// but the program is tested as users have it.
const BUILT_AGAIN: [&str; 3] = ["multiscopic-drivers", "multiscopic-tests", "serde_json"];

/// The sets of features of each package, by name and version.
type Features = BTreeMap<String, BTreeSet<String>>;

/// Fails if a package has features in one build of the suite that it does not have in another.
///
/// Cargo builds a package again for other features, and then whatever depends on it. Which features a package has depends on what
/// is built together: the runner alone, the program, the module for Python, or all tests.
pub fn features() -> Result<()> {
    let all = features_of(&["--workspace", "--edges=normal,build,dev"])?;
    let program = [&OPTIMIZED[..], &OPTIMIZED_PROGRAM, &["--edges=normal,build"]].concat();
    let builds = [
        ("the runner", vec!["-pmultiscopic-tests", "--edges=normal,build"]),
        ("the tests in release", [&OPTIMIZED[..], &["--edges=normal,build,dev"]].concat()),
        ("the module for Python", [&program[..], &["-p", PYTHON_PACKAGE]].concat()),
        ("the program", program),
    ];
    let mut complaints = Vec::new();
    for (build, selection) in builds {
        complaints.extend(differences(build, &features_of(&selection)?, "the checked tests", &all));
    }
    ensure!(
        complaints.is_empty(),
        "packages are built twice; see the end of tests/Cargo.toml's dependencies:\n{}",
        complaints.join("\n")
    );
    println!("features: every build of the suite asks for the same ones");
    Ok(())
}

/// The packages that are part of two builds, with other features in the first.
fn differences(build: &str, features: &Features, other_build: &str, others: &Features) -> Vec<String> {
    let differs = |(package, own): (&String, &BTreeSet<String>)| {
        let other = others.get(package)?;
        let may_differ = BUILT_AGAIN.iter().any(|name| package.split(' ').next() == Some(name));
        (!may_differ && !own.is_subset(other)).then(|| format!("{package}: {own:?} for {build}, {other:?} for {other_build}"))
    };
    features.iter().filter_map(differs).collect()
}

/// The features of every package that a selection of packages is built from.
fn features_of(selection: &[&str]) -> Result<Features> {
    let words = ["tree", "--locked", "--target=x86_64-unknown-linux-gnu", "--prefix=none", "--format={p}|{f}"];
    let tree = read(command("cargo", words).args(selection))?;
    let mut features = Features::new();
    // Lines such as `syn v2.0.119 (proc-macro)|default,full (*)`.
    for (package, own) in tree.lines().filter_map(|line| line.trim_end_matches(" (*)").split_once('|')) {
        let name = package.splitn(3, ' ').take(2).collect::<Vec<_>>().join(" ");
        features.entry(name).or_default().insert(own.to_owned());
    }
    Ok(features)
}

fn cargo(args: &[&str]) -> Command {
    command("cargo", args)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packages_with_other_features_are_named() {
        let features = |list: &[(&str, &str)]| -> Features {
            list.iter().map(|(package, features)| (package.to_string(), [features.to_string()].into())).collect()
        };
        let all = features(&[("a v1", "x,y"), ("b v1", ""), ("multiscopic-drivers v0", "x")]);
        let own = features(&[("a v1", "x"), ("b v1", ""), ("c v1", ""), ("multiscopic-drivers v0", "")]);
        assert_eq!(differences("one", &own, "all", &all), [r#"a v1: {"x"} for one, {"x,y"} for all"#]);
    }
}
