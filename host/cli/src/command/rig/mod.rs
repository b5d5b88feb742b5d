//! `multiscopic rig`: folders of photos as rigs.

mod camera_options;
mod import;
mod init;

use std::process::ExitCode;

use clap::{Args, Subcommand};
use multiscopic::Result;

use import::Import;
use init::Init;

/// Describes folders of photos that were not taken by `multiscopic capture`
#[derive(Clone, Debug, Args)]
pub struct RigCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Clone, Debug, Subcommand)]
enum Action {
    Init(Init),
    Import(Import),
}

impl RigCommand {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        match &self.action {
            Action::Init(init) => init.run(),
            Action::Import(import) => import.run(),
        }
    }
}
