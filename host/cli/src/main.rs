//! The command line.

mod command;
mod report;
mod results;

use std::{env, process::ExitCode};

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand, error::ErrorKind, value_parser};
use command::{
    batch::RunSettings,
    terminal::{self, examples},
};
use multiscopic::files::Limits;

/// Accurate depth from one camera moved on purpose.
#[derive(Debug, Parser)]
#[command(name = "multiscopic", version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,

    /// Print results, warnings and errors alone: no notes and no progress
    #[arg(short, long, global = true)]
    quiet: bool,

    /// Most pixels of a picture: files that claim more are refused before memory is taken for them
    #[arg(long, value_name = "N", global = true, hide_short_help = true)]
    #[arg(default_value_t = Limits::DEFAULT.max_pixels, value_parser = value_parser!(u64).range(1..))]
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
    Devices(command::hardware::Devices),
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
    command::set_limits(Limits { max_pixels: cli.max_pixels });
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
        terminal::complain(&command::advice::error(&error));
        ExitCode::from(2)
    })
}

#[cfg(test)]
mod tests {
    use std::{cell::RefCell, collections::BTreeMap, ffi::OsString};

    use proptest::{
        collection::vec,
        prelude::*,
        sample::select,
        test_runner::{Config, TestRunner},
    };

    use super::*;

    /// Values that some options take, and values that none does, the first of which is empty.
    const VALUES: &str = " 0 1 -1 7 16 64 0.5 -0 1e300 nan inf 99999999999999999999 min mean bm sgm net gc bm,sgm none smooth \
        3x3 cross 1,0=l.png 1,2 -1,1= 1..64 0.2..0.5 1/2 0/0 ur10:[::1]:5 gcode:/dev/ttyS0 manual tsukuba out.pfm --help - -- \
        \u{301}1 1é/2";

    /// The words that lead to each command, and the options that it has but `--help`, with one that none has.
    fn commands(program: &clap::Command, words: &[String]) -> Vec<(Vec<String>, Vec<String>)> {
        let options = program.get_arguments().filter(|option| option.get_id() != "help").flat_map(|option| {
            let short = option.get_short().map(|letter| format!("-{letter}"));
            option.get_long().map(|name| format!("--{name}")).into_iter().chain(short)
        });
        let own = (words.to_vec(), options.chain(["--unknown".into()]).collect());
        // `help` repeats all commands, without options.
        let inner = program.get_subcommands().filter(|command| command.get_name() != "help");
        let inner = inner.flat_map(|command| commands(command, &[words, &[command.get_name().into()]].concat()));
        [own].into_iter().chain(inner).collect()
    }

    /// The words of a command line, with options of a command and values of any kind.
    fn command_lines(commands: Vec<(Vec<String>, Vec<String>)>) -> impl Strategy<Value = Vec<OsString>> {
        let value = prop_oneof![4 => select(VALUES.split(' ').collect::<Vec<_>>()).prop_map(String::from), 1 => any::<String>()];
        let words = vec(value.clone(), 0..3);
        (select(commands), vec((any::<prop::sample::Index>(), value, 0..3), 0..5), words).prop_map(
            |((command, names), options, words)| {
                let options = options.into_iter().flat_map(|(name, value, form)| {
                    let name = name.get(&names).clone();
                    match form {
                        0 => vec![name],
                        1 => vec![name, value],
                        _ => vec![format!("{name}={value}")],
                    }
                });
                let words = command.into_iter().chain(options).chain(words);
                ["multiscopic".into()].into_iter().chain(words.map(OsString::from)).collect()
            },
        )
    }

    /// Tries `cases` random inputs, or more if `PROPTEST_CASES` asks for them, and returns how many of them had each outcome.
    ///
    /// # Panics
    /// For an input that `outcome` fails for or panics at, with the smallest such input.
    pub fn tally<S: Strategy>(
        cases: u32,
        inputs: &S,
        outcome: impl Fn(S::Value) -> Result<&'static str, TestCaseError>,
    ) -> BTreeMap<&'static str, u64> {
        let counts = RefCell::new(BTreeMap::new());
        let default = Config::default();
        let config = Config { cases: default.cases.max(cases), failure_persistence: None, ..default };
        TestRunner::new(config)
            .run(inputs, |input| {
                let outcome = outcome(input)?;
                *counts.borrow_mut().entry(outcome).or_insert(0) += 1;
                Ok(())
            })
            .unwrap_or_else(|error| panic!("{error}"));
        let counts = counts.into_inner();
        println!("{counts:?}");
        counts
    }

    #[test]
    fn options_are_consistent() {
        super::Cli::command().debug_assert();
    }

    #[test]
    fn any_command_line_is_taken_or_refused() {
        let mut program = program();
        program.build();
        let lines = command_lines(commands(&program, &[]));
        let program = RefCell::new(program);
        let outcomes = tally(1000, &lines, |words| {
            let arguments = program.borrow_mut().try_get_matches_from_mut(&words);
            match arguments.and_then(|arguments| Cli::from_arg_matches(&arguments)) {
                Ok(_) => Ok("taken"),
                Err(error) if error.exit_code() == 0 || error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => {
                    Ok("help")
                }
                Err(error) => {
                    prop_assert_eq!(error.exit_code(), 2);
                    prop_assert!(error.render().to_string().starts_with("error: "));
                    Ok("refused")
                }
            }
        });
        assert!(outcomes["taken"] > 30 && outcomes["refused"] > 300);
    }
}
