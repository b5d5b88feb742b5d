//! The suites: which steps `check`, `lint`, `firmware`, `test` and `test --all` run.
//!
//! `docs/testing.md` says what each step checks, and why it stands where it does.

mod static_checks;
mod step;

use anyhow::{Result, ensure};
use clap::Args;
use std::{iter, path::Path};

use crate::{
    counts::Guard,
    emulation::{build, emulated_board},
    firmware_checks::{
        self,
        bit_flips::BitFlips,
        cycles::Accounting,
        profiles::{self, Selection},
    },
    machine,
    publishing::{self, PublicApi, release, supply_chain::SupplyChain},
    system::{BackgroundTask, OPTIMIZED, PYTHON_PACKAGE, built_optimized_program, built_program, command, read, run},
    tools::Toolchain,
    workspace_checks::{
        cluster::Clusters,
        emulated_arm64,
        failing::{Crashing, Soaking},
        fuzzing::Fuzzing,
        mutating::Mutating,
        pages, python_package,
        sanitizing::{self, Sanitizing},
    },
};
use step::{
    Needs, Report,
    Scope::{All, Sample, Test},
    Step,
};

pub use static_checks::architecture;

/// The tests of `check`: units, and the comparisons of all methods with their references.
const QUICK: [&str; 10] = [
    "-pmultiscopic-core",
    "-pmultiscopic",
    "-pmultiscopic-cli",
    "-pmultiscopic-edge",
    "-pmultiscopic-reference",
    "-pmultiscopic-tests",
    "--lib",
    "--bins",
    "--test=matching",
    "--test=methods",
];

/// The tests that optimisation might change: of what computes, not of what talks to users, browsers, cameras and stages.
const COMPUTATIONS: [&str; 5] = ["--lib", "--test=matching", "--test=methods", "--test=mccnn", "--test=real_data"];
/// The tests of bytes from outside and of rectification by lines, which are mostly integers and bounds, and of the pipeline to
/// packets, which the sample of the firmware tests optimised too.
const OTHER_COMPUTATIONS: [&str; 4] = ["-pmultiscopic-edge", "--lib", "--test=outside_bytes", "--test=rectified_lines"];
/// The tests of the program, of which debug leaves out what is slow there.
const PROGRAM: [&str; 2] = ["--test=commands", "--test=capture"];
/// Those that take half of the time even in release, each with what else tests its subject.
const LONGEST: [(&str, &str); 5] = [
    ("edge_commands::simulations::every_other_profile_is_simulated", "small_profiles_are_simulated"),
    ("edge_commands::simulations::long_baselines_are_simulated_like_the_references", "small_profiles_are_simulated"),
    ("command_line::memory_demand::alignments_take_what_they_announce", "matches_take_what_they_announce"),
    ("lenses::distorted_images_match_as_those_without_distortion", "a_lens_is_recovered_with_its_uncertainty"),
    ("simulated::a_mount_is_kept_if_the_stage_stops_on_its_way_back", "a_mount_is_found_and_taken_out"),
];

/// The static checks.
const LINT: [Step; 8] = [
    Step { name: "formatting", scope: Test, run: static_checks::formatting },
    Step { name: "architecture", scope: Test, run: architecture },
    Step { name: "lints", scope: Test, run: static_checks::lints },
    Step { name: "lints for Arm", scope: Test, run: || static_checks::lints_for_arm(&arm()?) },
    Step { name: "features", scope: Test, run: static_checks::features },
    Step { name: "supply chain", scope: Test, run: || SupplyChain::CHECK.run() },
    Step { name: "subjects of commits", scope: Test, run: static_checks::subjects },
    Step { name: "documentation", scope: Test, run: static_checks::documentation },
];

/// The tests on this machine. Those that need the same build are beside each other.
const TESTS: [Step; 28] = [
    Step { name: "tests in debug", scope: Test, run: tests_in_debug },
    Step { name: "the published packages, packed", scope: Sample, run: publishing::pack_crates },
    Step { name: "computations in release", scope: Test, run: || run_optimized_tests(&COMPUTATIONS) },
    Step { name: "long tests in release", scope: Sample, run: || long_tests(false) },
    Step { name: "Python, as built for the tests", scope: Sample, run: python_package::test_extension },
    Step { name: "archives of the program", scope: Test, run: release::check },
    Step { name: "pages in a browser", scope: Test, run: pages::run_tests },
    Step { name: "instructions", scope: Test, run: || Guard::COMPARE.run() },
    Step { name: "the longest tests in release too", scope: All, run: || long_tests(true) },
    Step { name: "other computations in release", scope: All, run: || run_optimized_tests(&OTHER_COMPUTATIONS) },
    Step {
        name: "the core with the crate fixed",
        scope: All,
        run: || run(&mut cargo(&["test", "-pmultiscopic-core", "--features=fixed"])),
    },
    Step { name: "lints without features", scope: All, run: static_checks::lints_without_features },
    Step { name: "the Python wheel", scope: All, run: python_package::test_wheel },
    Step { name: "the published packages, compiled", scope: All, run: publishing::check_crates },
    Step { name: "archives, built twice", scope: All, run: || release::Release::TWICE.run() },
    Step { name: "64-bit Arm", scope: All, run: emulated_arm64::run_tests },
    Step { name: "everything that computes in AddressSanitizer", scope: All, run: || Sanitizing::ADDRESSES.run_tests() },
    Step { name: "everything that computes in Valgrind", scope: All, run: || Sanitizing::VALGRIND.run_tests() },
    Step { name: "matching in Miri", scope: All, run: sanitizing::run_tests_in_miri },
    Step { name: "fuzzing, guided by coverage", scope: All, run: || Fuzzing::A_MINUTE.run() },
    Step { name: "commands that are killed", scope: All, run: || Crashing::MANY.run() },
    Step { name: "hardware that fails", scope: All, run: || Soaking::LONG.run() },
    Step { name: "clusters", scope: All, run: || Clusters::ALL.run() },
    Step { name: "licences, sources and bans", scope: All, run: || SupplyChain::DENY.run() },
    Step { name: "what the published crates offer", scope: All, run: || PublicApi::SINCE_TAG.check() },
    Step { name: "mutants", scope: All, run: || Mutating::sample().run() },
    Step { name: "mutants of the capture sequence", scope: All, run: || Mutating::of("capture").run() },
    Step { name: "mutants of the selection", scope: All, run: || Mutating::of("selection").run() },
];

/// The tests in emulators: of the firmware, of the libraries as firmware depends on them, and of cameras.
const EMULATED: [Step; 17] = [
    Step { name: "the libraries for Arm", scope: All, run: || static_checks::libraries_for_arm(&arm()?) },
    Step { name: "lints for RISC-V", scope: All, run: static_checks::lints_for_risc_v },
    Step { name: "lints for the Pico 2", scope: All, run: || build::lint_pico2(&arm()?) },
    Step { name: "the firmware for the Pico 2", scope: All, run: || build::build_pico2(&arm()?) },
    Step { name: "the kernels on each processor", scope: All, run: || firmware_checks::kernels(&arm()?) },
    Step { name: "firmware, a sample", scope: Sample, run: || profiles::run(&arm()?, &Selection::sample()) },
    Step { name: "firmware of every profile", scope: All, run: || profiles::run(&arm()?, &Selection::default()) },
    Step { name: "the firmware's cycles", scope: All, run: || Accounting::compare().run(&arm()?) },
    Step { name: "the firmware that captures", scope: Test, run: || firmware_checks::captures(&arm()?) },
    Step { name: "the firmware's faults", scope: Sample, run: || firmware_checks::faults(&arm()?, &[emulated_board::REFERENCE]) },
    Step {
        name: "the firmware's faults on each board",
        scope: All,
        run: || firmware_checks::faults(&arm()?, &emulated_board::ARM),
    },
    Step { name: "no panics, a sample", scope: Sample, run: || firmware_checks::no_panic(&arm()?, false) },
    Step { name: "no panics", scope: All, run: || firmware_checks::no_panic(&arm()?, true) },
    Step { name: "a few flipped bits", scope: Sample, run: || BitFlips::few().run(&arm()?) },
    Step { name: "many flipped bits", scope: All, run: || BitFlips::many().run(&arm()?) },
    // By then the steps beside these have built the program in release, which the machine runs.
    Step { name: "cameras in a virtual machine", scope: Sample, run: || machine::run_camera_tests(false) },
    Step { name: "cameras and stages in a virtual machine", scope: All, run: || machine::run_camera_tests(true) },
];

/// The step of `test` that waits for the tests in emulators.
const WAITING: &str = "emulators, in the background";

/// The disk space and time that the suites take, as measured on two processors.
const LINT_NEEDS: Needs = Needs { command: "cargo xtask lint", disk_gib: 2.5, minutes: 6 };
const TEST_NEEDS: Needs = Needs { command: "cargo xtask test", disk_gib: 7.0, minutes: 35 };
const ALL_NEEDS: Needs = Needs { command: "cargo xtask test --all", disk_gib: 24.0, minutes: 600 };

/// The extent of the tests.
#[derive(Args, Clone, Copy)]
pub struct Extent {
    /// Also what takes long or builds anew: every profile on every board, archives built twice, 64-bit Arm, AddressSanitizer,
    /// Valgrind, Miri, fuzzing, mutants, clusters
    #[arg(long)]
    all: bool,
}

impl Extent {
    /// Every test of this extent. Those in emulators run in the background: their compilers and emulators use one processor at
    /// a time.
    pub fn test(self) -> Result<()> {
        let needs = if self.all { ALL_NEEDS } else { TEST_NEEDS };
        needs.check()?;
        let mut report = Report::default();
        report.step("setup", || build::set_up().map(drop));
        let arguments = iter::once("emulated").chain(self.all.then_some("--all"));
        let emulated = BackgroundTask::start(&arguments.collect::<Vec<_>>())?;
        report.run(self.steps(&TESTS));
        report.step(WAITING, || emulated.finish());
        report.finish()
    }

    /// Every test in an emulator of this extent.
    pub fn emulated(self) -> Result<()> {
        let mut report = Report::default();
        report.step("setup", || build::set_up().map(drop));
        report.run(self.steps(&EMULATED));
        report.finish()
    }

    fn steps(self, steps: &[Step]) -> impl Iterator<Item = &Step> {
        steps.iter().filter(move |step| step.scope.is_run(self.all))
    }
}

/// The checks for every change.
pub fn check() -> Result<()> {
    let mut report = Report::default();
    report.run(&LINT[..3]);
    report.step("unit and bit-exactness tests", || run(cargo(&["test", "--no-fail-fast"]).args(QUICK)));
    report.finish()
}

/// The static checks.
pub fn lint() -> Result<()> {
    LINT_NEEDS.check()?;
    let mut report = Report::default();
    report.step("setup", || build::set_up().map(drop));
    report.run(&LINT);
    report.finish()
}

/// pytest tests the Python package. The firmware has no tests on this machine, but two dozen programs to link.
const TESTED: [&str; 5] = ["--workspace", "--exclude", PYTHON_PACKAGE, "--exclude", "multiscopic-firmware"];

fn tests_in_debug() -> Result<()> {
    let program = built_program()?;
    all([
        // Examples without tests are left to the lints.
        run_tests(&program, &[&TESTED[..], &["--tests"]].concat()),
        run_tests(&program, &[&TESTED[..], &["--doc"]].concat()),
        // As most firmware has it. In the workspace, the tests' features are on.
        run(&mut cargo(&["test", "--no-fail-fast", "-pmultiscopic-core", "--lib"])),
    ])
}

/// Fails if any did, with the messages of all.
fn all<const N: usize>(results: [Result<()>; N]) -> Result<()> {
    let failures: Vec<String> = results.into_iter().filter_map(|result| Some(format!("{:#}", result.err()?))).collect();
    ensure!(failures.is_empty(), failures.join("; "));
    Ok(())
}

fn run_tests(program: &Path, selection: &[&str]) -> Result<()> {
    run(cargo(&["test", "--no-fail-fast"]).args(selection).env("MULTISCOPIC_BINARY", program))
}

/// Runs in release the tests of the program that debug leaves out, with or without the longest.
fn long_tests(with_longest: bool) -> Result<()> {
    let list = ["--quiet", "--", "--list", "--ignored", "--format=terse"];
    let list = read(cargo(&["test"]).args(TESTED).args(PROGRAM).args(list))?;
    let mut names: Vec<&str> = list.lines().filter_map(|line| line.strip_suffix(": test")).collect();
    for (longest, instead) in LONGEST {
        let is_there = names.contains(&longest) && names.iter().any(|name| name.ends_with(instead));
        ensure!(is_there, "debug does not leave out {longest} or {instead}");
    }
    names.retain(|name| with_longest || LONGEST.iter().all(|(longest, _)| name != longest));
    run_optimized_tests(&[&PROGRAM[..], &["--", "--exact"], &names].concat())
}

fn run_optimized_tests(selection: &[&str]) -> Result<()> {
    run_tests(&built_optimized_program()?, &[&OPTIMIZED[..], &["--release"], selection].concat())
}

/// The toolchain for the boards with Arm processors.
fn arm() -> Result<Toolchain> {
    build::toolchain()
}

fn cargo(args: &[&str]) -> std::process::Command {
    command("cargo", args)
}

#[cfg(test)]
mod tests {
    use super::*;

    use anyhow::anyhow;
    use std::fs;

    use crate::system;

    /// The rows of a table of the guide, by the heading above it: the name of a step and the suites that it is part of.
    fn rows(guide: &str, heading: &str) -> Vec<[String; 2]> {
        let section = guide.split_once(heading).expect("a heading").1.split("\n## ").next().expect("a section");
        let lines = section.lines().filter(|line| line.starts_with("| ")).skip(2);
        lines
            .map(|line| {
                let cells: Vec<&str> = line.split('|').map(str::trim).collect();
                [cells[1].to_owned(), cells[2].to_owned()]
            })
            .collect()
    }

    #[test]
    fn the_guide_lists_every_step() {
        let guide = fs::read_to_string(system::root().join("docs/testing.md")).expect("the guide");
        for (heading, steps) in
            [("## Lint\n", &LINT[..]), ("## Tests on this machine\n", &TESTS), ("## Tests in emulators\n", &EMULATED)]
        {
            let suites = |scope| match scope {
                Test => "`test`",
                Sample => "`test` alone",
                All => "`test --all`",
            };
            let suites = |step: &Step| if heading.contains("Lint") { "`lint`" } else { suites(step.scope) };
            let expected: Vec<[String; 2]> = steps.iter().map(|step| [step.name.to_owned(), suites(step).to_owned()]).collect();
            assert_eq!(rows(&guide, heading), expected, "{heading}");
        }
    }

    #[test]
    fn a_failure_does_not_hide_another() {
        assert!(all([Ok(()), Ok(())]).is_ok());
        let failure = all([Err(anyhow!("a")), Ok(()), Err(anyhow!("b"))]).expect_err("two failed").to_string();
        assert_eq!(failure, "a; b");
    }
}
