//! `multiscopic calibrate`: what a rig's camera and its motion are.

#[cfg(feature = "calibration")]
mod board;
#[cfg(feature = "calibration")]
mod camera_session;
#[cfg(feature = "calibration")]
mod lens;
#[cfg(feature = "calibration")]
mod lens_outcome;
mod mount;
#[cfg(feature = "calibration")]
mod simulated_board;

use std::process::ExitCode;

use clap::{Args, Subcommand};
use multiscopic::Result;

/// Calibrates the camera's lens, and how it is mounted on the stage
#[derive(Clone, Debug, Args)]
pub struct Calibrate {
    #[command(subcommand)]
    subject: Subject,
}

#[derive(Clone, Debug, Subcommand)]
enum Subject {
    #[cfg(feature = "calibration")]
    Board(board::Board),
    #[cfg(feature = "calibration")]
    Lens(lens::LensCommand),
    Mount(Box<mount::MountCommand>),
}

impl Calibrate {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        match &self.subject {
            #[cfg(feature = "calibration")]
            Subject::Board(command) => command.run(),
            #[cfg(feature = "calibration")]
            Subject::Lens(command) => command.run(),
            Subject::Mount(command) => command.run(),
        }
    }
}
