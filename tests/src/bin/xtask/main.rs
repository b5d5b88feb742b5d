//! `cargo xtask`: one command for developers and continuous integration. It needs only Rust.
//!
//! | module | what it is |
//! | --- | --- |
//! | `system` | paths, other programs, and threads |
//! | `tools` | the programs that checks run, and their installation |
//! | `counts` | the recorded counts of instructions and cycles |
//! | `timing` | the cycles that instructions take |
//! | `machine` | the virtual machine with cameras, and the tests in it |
//! | `emulation` | emulated boards: firmware is built for them, run and measured |
//! | `firmware_checks` | checks of the firmware on the boards |
//! | `workspace_checks` | checks of the whole workspace |
//! | `publishing` | everything that is published: crates, archives of the program, wheels, and the dependencies of all |
//! | `suite` | the steps that each suite runs |

mod counts;
mod emulation;
mod firmware_checks;
mod machine;
mod publishing;
mod suite;
mod system;
mod timing;
mod tools;
mod workspace_checks;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

use emulation::{build, emulated_board};
use firmware_checks::{bit_flips, c_library, cycles, profiles};
use publishing::{release, supply_chain};
use suite::Extent;
use workspace_checks::{cluster, emulated_arm64, failing, fuzzing, mutating, pages, python_package, sanitizing};

/// Runs the project's checks, tests and firmware.
#[derive(Parser)]
#[command(bin_name = "cargo xtask", version)]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Install what the firmware's tests need: the Arm targets and the emulator
    Setup,
    /// Run the checks for every change, a minute or two: formatting, architecture, lints, unit tests,
    /// bit-exactness
    Check,
    /// Run the tests: checked and release builds, cameras in a virtual machine, a sample of the firmware in the emulator
    Test(Extent),
    /// Run the tests that `test` has in the background: of the firmware and of cameras in emulators, archives, pages,
    /// instructions
    Background(Extent),
    /// Check formatting, architecture, lints and documentation
    Lint,
    /// Build the firmware, run it in the emulator, compare it with the host bit for bit, and measure it
    Edge(profiles::Selection),
    /// Add up the cycles that the firmware takes on each processor, and compare them with the record
    Cycles(cycles::Accounting),
    /// Compare the library for C with the core on each kind of processor, and build it as users do
    C,
    /// Make the library for C for every processor: header, archives, Arduino library
    CLibrary,
    /// Run the firmware that moves a camera and captures, with every fault
    Capture,
    /// Run firmware that must fail: too large, out of stack, without its frames
    Faults,
    /// Flip bits in the memory of firmware that matches: every end has a name, and later frames are right
    Flips(bit_flips::BitFlips),
    /// Run the camera tests in a virtual machine with real drivers
    V4l2,
    /// Compare each Arm kernel with its portable twin in the emulator
    Kernels,
    /// Test the kernel of 64-bit Arm, in the emulator on other machines
    Aarch64,
    /// Check the architecture: layers of modules, circles of files
    Architecture,
    /// Count the instructions of matching on this machine, and compare them with the record
    Instructions(counts::Guard),
    /// Drive the page of results in a headless browser
    Page,
    /// Build the Python package, and test it against the program
    Python,
    /// Share matches between the nodes of a Slurm cluster and of a Ray cluster on this machine, and lose a node
    Cluster(cluster::Clusters),
    /// Package the published crates, and compile each from its package
    Package,
    /// Compare what the published crates offer with an earlier revision
    Semver(publishing::PublicApi),
    /// Make archives of the program for Linux and Debian, which the same commit gives the same bytes
    Release(release::Release),
    /// Check the versions of dependencies, the reasons for them and the count of unsafe code
    SupplyChain(supply_chain::SupplyChain),
    /// Fuzz the readers of outside bytes, and what must equal its reference, guided by coverage
    Fuzz(fuzzing::Fuzzing),
    /// Kill commands at random moments, and check what they leave behind
    Crash(failing::Crashing),
    /// Capture and match on simulated hardware that fails at random, and watch memory, files and threads
    Soak(failing::Soaking),
    /// Lint and link the firmware for a Raspberry Pi Pico 2
    Pico2,
    /// Run the tests of everything that computes with AddressSanitizer or Valgrind
    Sanitize(sanitizing::Sanitizing),
    /// Run tests of matching in Miri, which ends them at undefined behaviour
    Miri,
    /// Break the code in small ways, one at a time, and look whether a test notices
    Mutants(mutating::Mutating),
    /// Link the matcher alone, which fails if any path leads to a panic
    NoPanic,
}

fn main() -> ExitCode {
    match run(Cli::parse().task) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", error.chain().map(|cause| cause.to_string()).collect::<Vec<_>>().join(": "));
            ExitCode::FAILURE
        }
    }
}

fn run(task: Task) -> anyhow::Result<()> {
    match task {
        Task::Architecture => suite::architecture(),
        Task::Setup => build::set_up().map(drop),
        Task::Test(extent) => extent.test(),
        Task::Background(extent) => extent.background(),
        Task::Check => suite::check(),
        Task::Lint => suite::lint(),
        Task::V4l2 => machine::run_camera_tests(true),
        Task::Kernels => firmware_checks::kernels(&build::set_up()?),
        Task::Aarch64 => emulated_arm64::run_tests(),
        Task::Instructions(guard) => guard.run(),
        Task::Page => pages::run_tests(),
        Task::Python => python_package::test_wheel(),
        Task::Package => publishing::check_crates(),
        Task::Semver(public_api) => public_api.check(),
        Task::Release(release) => release.run(),
        Task::Cluster(clusters) => clusters.run(),
        Task::SupplyChain(check) => check.run(),
        Task::Fuzz(fuzzing) => fuzzing.run(),
        Task::Crash(crashing) => crashing.run(),
        Task::Soak(soaking) => soaking.run(),
        Task::Sanitize(sanitizing) => sanitizing.run_tests(),
        Task::Miri => sanitizing::run_tests_in_miri(),
        Task::Mutants(mutating) => mutating.run(),
        Task::NoPanic => firmware_checks::no_panic(&build::set_up()?, true),
        Task::Pico2 => {
            let toolchain = build::set_up()?;
            build::lint_pico2(&toolchain)?;
            build::build_pico2(&toolchain)
        }
        Task::C => c_library::run_tests(&build::set_up()?, true),
        Task::CLibrary => c_library::pack(),
        Task::Capture => firmware_checks::captures(&build::set_up()?),
        Task::Faults => firmware_checks::faults(&build::set_up()?, &emulated_board::ARM),
        Task::Flips(flips) => flips.run(&build::set_up()?),
        Task::Cycles(accounting) => accounting.run(&build::set_up()?),
        Task::Edge(selection) => profiles::run(&build::set_up()?, &selection),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    use clap::CommandFactory;
    use std::{fs, path::PathBuf};

    /// The guides, and the sources of the runner's own help.
    fn guides() -> Vec<PathBuf> {
        let markdown = |folder: &str| {
            let entries = fs::read_dir(system::root().join(folder)).expect("a folder with guides");
            entries.map(|entry| entry.expect("an entry").path()).filter(|path| path.extension().is_some_and(|name| name == "md"))
        };
        ["", "docs", "edge/pico2", "tests/benches"]
            .into_iter()
            .flat_map(markdown)
            .filter(|path| !path.ends_with("CHANGELOG.md"))
            .collect()
    }

    #[test]
    fn commands_of_the_guides_exist() {
        let program = Cli::command();
        let (mut found, mut wrong) = (0, Vec::new());
        for path in guides() {
            let text = fs::read_to_string(&path).expect("a guide");
            for rest in text.split("cargo xtask ").skip(1) {
                // To the end of the code or of the line. Brackets and colons are not part of the command.
                let line = rest.split(['`', '\n', '#']).next().unwrap_or_default();
                let mut words = line.split_whitespace().map(|word| word.trim_matches(['[', ']', ',', ':', ';', ')', '.']));
                let name = words.next().unwrap_or_default();
                let command = program.find_subcommand(name);
                let has = |option: &str| {
                    command.is_some_and(|command| command.get_arguments().any(|argument| argument.get_long() == Some(option)))
                };
                let unknown = words.filter_map(|word| word.strip_prefix("--")).find(|option| !has(option));
                if name != "help" && (command.is_none() || unknown.is_some()) {
                    wrong.push(format!("{}: cargo xtask {line}", path.display()));
                }
                found += 1;
            }
        }
        assert!(wrong.is_empty(), "{} commands are not there:\n{}", wrong.len(), wrong.join("\n"));
        assert!(found > 50, "{found} commands");
    }
}
