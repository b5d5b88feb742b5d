//! The command line.

mod command;

use std::{env, process::ExitCode};

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand, error::ErrorKind, value_parser};
use command::{
    batch::RunSettings,
    terminal::{self, examples},
};
use multiscopic::images::Picture;

/// Accurate depth from one camera moved on purpose.
#[derive(Debug, Parser)]
#[command(version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,

    /// Print results, warnings and errors alone: no notes and no progress
    #[arg(short, long, global = true)]
    quiet: bool,

    /// Most pixels of a picture: files that claim more are refused before memory is taken for them
    #[arg(long, value_name = "N", global = true, hide_short_help = true)]
    #[arg(default_value_t = Picture::MAX_PIXELS, value_parser = value_parser!(u64).range(1..))]
    max_pixels: u64,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(command::demo::Demo),
    Match(Box<command::r#match::Match>),
    Evaluate(Box<command::evaluate::Evaluate>),
    Merge(command::merge::Merge),
    Capture(command::capture::Capture),
    Align(command::align::Align),
    Calibrate(command::calibrate::Calibrate),
    Rig(command::rig::RigCommand),
    Scene(command::scene::SceneCommand),
    Bench(command::bench::Bench),
    Budget(command::budget::Budget),
    Simulate(command::simulate::Simulate),
    View(Box<command::view::View>),
    #[cfg(feature = "live")]
    Tune(command::live::Tune),
    #[cfg(feature = "live")]
    Live(Box<command::live::Live>),
    Listen(command::listen::Listen),
    Devices(command::devices::Devices),
    Weights(command::weights::WeightsCommand),
    #[cfg(feature = "manuals")]
    Completions(command::manuals::Completions),
    #[cfg(feature = "manuals")]
    Man(command::manuals::Man),
}

/// All commands and options, with examples.
fn program() -> clap::Command {
    examples::add_to(Cli::command())
}

fn main() -> ExitCode {
    let mut program = program();
    let arguments = program.try_get_matches_from_mut(env::args_os());
    let (cli, arguments) = match arguments.and_then(|arguments| Ok((Cli::from_arg_matches(&arguments)?, arguments))) {
        Ok(parsed) => parsed,
        // Running without arguments shows the help and succeeds.
        Err(error) if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
            let _ = terminal::print(&error.render().to_string());
            return ExitCode::SUCCESS;
        }
        Err(error) => error.exit(),
    };
    if let Err(error) = terminal::signals::install() {
        terminal::complain(&error.to_string());
        return ExitCode::from(2);
    }
    Picture::set_max_pixels(cli.max_pixels);
    if cli.quiet {
        terminal::be_quiet();
    }
    let done = match cli.command {
        Command::Demo(command) => command.run(),
        Command::Match(command) => command.run(&RunSettings::given(&program, &arguments)),
        Command::Evaluate(command) => command.run(&RunSettings::given(&program, &arguments)),
        Command::Merge(command) => command.run(),
        Command::Capture(command) => command.run(),
        Command::Align(command) => command.run(),
        Command::Calibrate(command) => command.run(),
        Command::Rig(command) => command.run(),
        Command::Scene(command) => command.run(),
        Command::Bench(command) => command.run(),
        Command::Budget(command) => command.run(),
        Command::Simulate(command) => command.run(),
        Command::View(command) => command.run(),
        #[cfg(feature = "live")]
        Command::Tune(command) => command.run(),
        #[cfg(feature = "live")]
        Command::Live(command) => command.run(),
        Command::Listen(command) => command.run(),
        Command::Devices(command) => command.run(),
        Command::Weights(command) => command.run(),
        #[cfg(feature = "manuals")]
        Command::Completions(command) => command.run(self::program()),
        #[cfg(feature = "manuals")]
        Command::Man(command) => command.run(self::program()),
    };
    done.unwrap_or_else(|error| {
        terminal::complain(&error.to_string());
        ExitCode::from(2)
    })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn options_are_consistent() {
        super::Cli::command().debug_assert();
    }
}
