//! `cargo xtask`: one command for what a developer and the continuous integration do. Needs nothing but Rust.
//!
//! | room | what it is |
//! | --- | --- |
//! | `system` | other programs, threads, and where things are |
//! | `tools` | the programs that checks run, and how they are installed |
//! | `record` | the recorded counts of instructions |
//! | `machine` | the virtual machine with cameras |
//! | `emulation` | emulated boards: firmware is built for them, run and measured |
//! | `firmware_checks` | what the firmware must do on the boards |
//! | `workspace_checks` | what the whole workspace must do, step by step |

mod emulation;
mod firmware_checks;
mod machine;
mod record;
mod system;
mod tools;
mod workspace_checks;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

use emulation::setup;
use firmware_checks::{capturing, faults, kernel_twins, profiles};
use workspace_checks::{aarch64, instructions, suite, v4l2};

/// Runs the project's tests, checks and firmware.
#[derive(Parser)]
#[command(bin_name = "cargo xtask", version)]
struct Cli {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Install what the firmware needs: the Arm target and the emulator
    Setup,
    /// Check what changes break most often, in a minute or two: formatting, lints, units, bit-exactness
    Check,
    /// Run every test: on this machine in debug and release, with cameras in a virtual machine, then the firmware in the emulator
    Test,
    /// Check formatting, lints and documentation
    Lint,
    /// Build the firmware, run it in the emulator, compare it with this machine bit for bit, and measure it
    Edge(profiles::Selection),
    /// Run the firmware that moves a camera and captures, with everything that can go wrong
    Capture,
    /// Run the firmware where it must fail: too large, out of stack, without its frames
    Faults,
    /// Run the tests with cameras, in a virtual machine with real drivers
    V4l2,
    /// Compare the processors' kernels with their portable twins, in the emulator
    Kernels,
    /// Test the kernel of 64-bit Arm, in the emulator where this machine is another
    Aarch64,
    /// Print what breaks the workspace's architecture: imports up the rooms, circles of files, crowded folders, shared names
    Architecture,
    /// Count the instructions of matching on this machine and compare them with the record
    Instructions(instructions::Guard),
    /// Link the matcher alone, which fails if there is any way from it into a panic
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
        Task::Setup => setup::run().map(drop),
        Task::Test => suite::test(),
        Task::Check => suite::check(),
        Task::Lint => suite::lint(),
        Task::V4l2 => v4l2::run_tests(),
        Task::Kernels => kernel_twins::run(&setup::run()?),
        Task::Aarch64 => aarch64::run_tests(),
        Task::Instructions(guard) => guard.run(),
        Task::NoPanic => faults::no_panic(&setup::run()?),
        Task::Capture => capturing::run(&setup::run()?),
        Task::Faults => faults::run(&setup::run()?),
        Task::Edge(selection) => profiles::run(&setup::run()?, &selection),
    }
}
