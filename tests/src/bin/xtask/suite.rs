//! The suites: which steps `check`, `lint`, `firmware`, `test` and `test --all` run.
//!
//! `docs/testing.md` says what each step checks, and why it stands where it does.

mod static_checks;
mod step;

use anyhow::{Result, ensure};
use clap::Args;
use std::iter;

use crate::{
    counts::Guard,
    emulation::{build, emulated_board},
    firmware_checks::{
        self,
        bit_flips::BitFlips,
        c_library,
        cycles::Accounting,
        profiles::{self, Selection},
        readme,
    },
    machine,
    publishing::{self, PublicApi, release, supply_chain::SupplyChain},
    system::{BackgroundTask, PYTHON_PACKAGE, built_program, checked_cargo, optimized_tests, read, run},
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

/// The tests of the checked build: all but those of the program and of errors on real images.
const CHECKED: [&str; 18] = [
    "--lib",
    "--bins",
    "--test=architecture",
    "--test=awaited_lines",
    "--test=capture",
    "--test=documents",
    "--test=hm01b0",
    "--test=line_queue",
    "--test=matching",
    "--test=methods",
    "--test=outside_bytes",
    "--test=pico2_lines",
    "--test=rectified_lines",
    "--test=seeds",
    "--test=simulation",
    "--test=soak",
    "--test=stepper",
    "--test=ur_rtde",
];
/// The tests in release: of the program, and of what computes, which optimisation might change.
const RELEASE: [&str; 6] = ["--lib", "--test=capture", "--test=commands", "--test=mccnn", "--test=methods", "--test=real_data"];
/// The tests of bytes from outside and of rectification by lines, which are mostly integers and bounds, of the pipeline to
/// packets, which the sample of the firmware tests optimised too, and of the library's parts.
const OTHER_COMPUTATIONS: [&str; 5] =
    ["-pmultiscopic-edge", "-pmultiscopic", "--lib", "--test=outside_bytes", "--test=rectified_lines"];
/// Those that take half of the time, each with what else tests its subject.
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

/// The tests that build for this machine, or take all of its processors. Those that need the same build are beside each other.
const TESTS: [Step; 24] = [
    Step { name: "the published packages, packed", scope: Sample, run: publishing::pack_crates },
    Step { name: "tests in release", scope: Test, run: tests_in_release },
    Step { name: "tests in the checked build", scope: Test, run: checked_tests },
    Step { name: "Python, as built for the tests", scope: Sample, run: python_package::test_extension },
    Step { name: "the longest tests in release", scope: All, run: longest_tests },
    Step { name: "other computations in release", scope: All, run: || run_optimized_tests(&OTHER_COMPUTATIONS) },
    Step {
        name: "the core with the crate fixed",
        scope: All,
        run: || run(checked_cargo("test").args(["-pmultiscopic-core", "--features=fixed"])),
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

/// The tests that take one processor at a time: of the firmware in emulators, of the libraries as firmware depends on them, of
/// cameras, and of the program in release.
const BACKGROUND: [Step; 24] = [
    Step { name: "the libraries for Arm", scope: All, run: || static_checks::libraries_for_arm(&arm()?) },
    Step { name: "the core for each processor", scope: Test, run: static_checks::core_for_each_processor },
    Step { name: "lints for RISC-V", scope: All, run: static_checks::lints_for_risc_v },
    Step { name: "lints for the Pico 2", scope: All, run: || build::lint_pico2(&arm()?) },
    Step { name: "the firmware for the Pico 2", scope: All, run: || build::build_pico2(&arm()?) },
    Step { name: "the kernels on each processor", scope: All, run: || firmware_checks::kernels(&arm()?) },
    Step { name: "firmware, a sample", scope: Sample, run: || profiles::run(&arm()?, &Selection::sample()) },
    Step { name: "firmware of every profile", scope: All, run: || profiles::run(&arm()?, &Selection::default()) },
    Step { name: "the firmware's cycles", scope: All, run: || Accounting::compare().run(&arm()?) },
    Step { name: "the firmware to begin with", scope: Test, run: first_programs },
    Step { name: "the library for C, a sample", scope: Sample, run: || c_library::run_tests(&arm()?, false) },
    Step { name: "the library for C", scope: All, run: || c_library::run_tests(&arm()?, true) },
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
    // By then the steps beside these have built the program in release, which the rest run.
    Step { name: "cameras in a virtual machine", scope: Sample, run: || machine::run_camera_tests(false) },
    Step { name: "cameras and stages in a virtual machine", scope: All, run: || machine::run_camera_tests(true) },
    Step { name: "archives of the program", scope: Test, run: release::check },
    Step { name: "pages in a browser", scope: Test, run: pages::run_tests },
    Step { name: "instructions", scope: Test, run: || Guard::COMPARE.run() },
];

/// The step of `test` that waits for them.
const WAITING: &str = "the steps in the background";

/// The disk space and time that the suites take, as measured on two processors.
const LINT_NEEDS: Needs = Needs { command: "cargo xtask lint", disk_gib: 2.5, minutes: 6 };
const TEST_NEEDS: Needs = Needs { command: "cargo xtask test", disk_gib: 4.0, minutes: 25 };
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
    /// Every test of this extent.
    pub fn test(self) -> Result<()> {
        let needs = if self.all { ALL_NEEDS } else { TEST_NEEDS };
        needs.check()?;
        let mut report = Report::default();
        report.step("setup", || build::set_up().map(drop));
        let arguments = iter::once("background").chain(self.all.then_some("--all"));
        let background = BackgroundTask::start(&arguments.collect::<Vec<_>>())?;
        report.run(self.steps(&TESTS));
        report.step(WAITING, || background.finish());
        report.finish()
    }

    /// Those of them that run in the background.
    pub fn background(self) -> Result<()> {
        let mut report = Report::default();
        report.step("setup", || build::set_up().map(drop));
        report.run(self.steps(&BACKGROUND));
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
    report.step("unit and bit-exactness tests", || run(checked_cargo("test").arg("--no-fail-fast").args(QUICK)));
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

fn checked_tests() -> Result<()> {
    let program = built_program()?;
    let test =
        |selection: &[&str]| run(checked_cargo("test").arg("--no-fail-fast").args(selection).env("MULTISCOPIC_BINARY", &program));
    all([
        test(&[&TESTED[..], &CHECKED].concat()),
        test(&[&TESTED[..], &["--doc"]].concat()),
        // As most firmware has it. In the workspace, the tests' features are on.
        test(&["-pmultiscopic-core", "--lib"]),
    ])
}

/// Fails if any did, with the messages of all.
fn all<const N: usize>(results: [Result<()>; N]) -> Result<()> {
    let failures: Vec<String> = results.into_iter().filter_map(|result| Some(format!("{:#}", result.err()?))).collect();
    ensure!(failures.is_empty(), failures.join("; "));
    Ok(())
}

fn tests_in_release() -> Result<()> {
    let skipped = longest()?.map(|name| ["--skip", name]);
    run_optimized_tests(&[&RELEASE[..], &["--", "--exact"], skipped.as_flattened()].concat())
}

fn longest_tests() -> Result<()> {
    run_optimized_tests(&[&RELEASE[..], &["--", "--exact"], &longest()?].concat())
}

/// The names of the longest tests. Fails if one is not there, or what else tests its subject.
fn longest() -> Result<[&'static str; LONGEST.len()]> {
    let list = ["--test=capture", "--test=commands", "--quiet", "--", "--list", "--format=terse"];
    let list = read(optimized_tests().args(list))?;
    let names: Vec<&str> = list.lines().filter_map(|line| line.strip_suffix(": test")).collect();
    for (longest, instead) in LONGEST {
        let is_there = names.contains(&longest) && names.iter().any(|name| name.ends_with(instead));
        ensure!(is_there, "there is no test {longest} or {instead}");
    }
    Ok(LONGEST.map(|(longest, _)| longest))
}

fn run_optimized_tests(selection: &[&str]) -> Result<()> {
    run(optimized_tests().args(selection).env("MULTISCOPIC_BINARY", built_program()?))
}

/// Runs the programs that users begin with.
fn first_programs() -> Result<()> {
    let toolchain = arm()?;
    firmware_checks::start(&toolchain)?;
    readme::run_example(&toolchain)
}

/// The toolchain for the boards with Arm processors.
fn arm() -> Result<Toolchain> {
    build::toolchain()
}

#[cfg(test)]
mod tests {
    use super::*;

    use anyhow::anyhow;
    use std::{collections::BTreeSet, fs};

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
        for (heading, steps) in [("## Lint\n", &LINT[..]), ("## Tests\n", &TESTS), ("## Tests in the background\n", &BACKGROUND)]
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
    fn every_test_program_is_run() {
        let folders = ["edge/drivers/tests", "edge/tests", "fuzz/tests", "host/engine/tests", "tests/tests"];
        let entries =
            folders.into_iter().flat_map(|folder| fs::read_dir(system::root().join(folder)).expect("a folder of tests"));
        let paths = entries.map(|entry| entry.expect("an entry").path());
        let programs = paths.filter(|path| path.is_file() || path.join("main.rs").is_file());
        let names: BTreeSet<String> =
            programs.map(|path| format!("--test={}", path.file_stem().expect("a name").display())).collect();
        // The virtual machine has the cameras.
        let run = CHECKED.iter().chain(&RELEASE).chain(&["--test=cameras"]).filter(|option| option.starts_with("--test="));
        assert_eq!(names, run.map(ToString::to_string).collect());
    }

    #[test]
    fn a_failure_does_not_hide_another() {
        assert!(all([Ok(()), Ok(())]).is_ok());
        let failure = all([Err(anyhow!("a")), Ok(()), Err(anyhow!("b"))]).expect_err("two failed").to_string();
        assert_eq!(failure, "a; b");
    }
}
