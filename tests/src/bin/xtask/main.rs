//! `cargo xtask`: one command for what a developer and the continuous integration do. Needs nothing but Rust.

mod aarch64;
mod archive;
mod board;
mod calibration;
mod capture;
mod check;
mod command;
mod counter;
mod debian;
mod edge;
mod emulator;
mod faults;
mod firmware;
mod footprint;
mod image_set;
mod instructions;
mod kernel;
mod kernels;
mod layout;
mod least_squares;
mod log;
mod machine;
mod packaging;
mod received;
mod record;
mod setup;
mod tool;
mod toolchain;
mod v4l2;
mod workers;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

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
    /// Run every test: on this machine in debug and release, with cameras in a virtual machine, then the firmware in the emulator
    Test,
    /// Check formatting, lints and documentation, then run every test
    Ci,
    /// Build the firmware, run it in the emulator, compare it with this machine bit for bit, and measure it
    Edge(edge::Selection),
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
    /// Count the instructions of matching on this machine and compare them with the record
    Instructions(instructions::Guard),
    /// Package the published crates, and build each from its package
    Package,
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
        Task::Setup => setup::run().map(drop),
        Task::Test => check::test(),
        Task::Ci => check::ci(),
        Task::V4l2 => v4l2::run_tests(),
        Task::Kernels => kernels::run(&setup::run()?),
        Task::Aarch64 => aarch64::run_tests(),
        Task::Instructions(guard) => guard.run(),
        Task::Package => packaging::check(),
        Task::NoPanic => faults::no_panic(&setup::run()?),
        Task::Capture => capture::run(&setup::run()?),
        Task::Faults => faults::run(&setup::run()?),
        Task::Edge(selection) => edge::run(&setup::run()?, &selection),
    }
}
