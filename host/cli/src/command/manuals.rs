//! `multiscopic completions` and `multiscopic man`: what shells and `man` need to know of the commands.

use std::{fs, path::PathBuf, process::ExitCode};

use clap::{Args, Command};
use clap_complete::Shell;
use multiscopic::{Error, Result, files::output};

use super::terminal;

/// Prints the completions of a shell, which then knows the commands, options and values
#[derive(Clone, Debug, Args)]
pub struct Completions {
    /// The shell
    shell: Shell,
}

/// Writes the manual: a page for `man` about each command
#[derive(Clone, Debug, Args)]
pub struct Man {
    /// Folder for the pages, such as ~/.local/share/man/man1; it is made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
}

impl Completions {
    /// Runs the command, for all of the `program`.
    pub fn run(&self, mut program: Command) -> Result<ExitCode> {
        let (name, mut script) = (program.get_name().to_owned(), Vec::new());
        clap_complete::generate(self.shell, &mut program, name, &mut script);
        terminal::print_bytes(&script)?;
        Ok(ExitCode::SUCCESS)
    }
}

impl Man {
    /// Runs the command, for all of the `program`.
    pub fn run(&self, mut program: Command) -> Result<ExitCode> {
        fs::create_dir_all(&self.output).map_err(|source| Error::Write { path: self.output.clone(), source })?;
        // Gives each command its full name.
        program.build();
        let mut pages = Vec::new();
        collect(&program, &mut pages);
        output::write_together(|| {
            pages.iter().try_for_each(|page| {
                let path = self.output.join(page.get_filename());
                output::write(&path, |file| page.render(file))
            })
        })?;
        terminal::say(&format!("wrote {} pages to {}", pages.len(), self.output.display()));
        Ok(ExitCode::SUCCESS)
    }
}

/// The pages of a command and of those below it.
fn collect(command: &Command, pages: &mut Vec<clap_mangen::Man>) {
    pages.push(clap_mangen::Man::new(command.clone()));
    let below = command.get_subcommands().filter(|below| !below.is_hide_set() && below.get_name() != "help");
    below.for_each(|below| collect(below, pages));
}
