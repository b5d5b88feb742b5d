//! The command line of multiscopic.

mod command;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Accurate depth from one camera moved on purpose.
#[derive(Debug, Parser)]
#[command(version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Bench(command::bench::Bench),
}

fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Bench(bench) => bench.run(),
    };
    done.unwrap_or_else(|error| {
        eprintln!("multiscopic: {error}");
        ExitCode::from(2)
    })
}
