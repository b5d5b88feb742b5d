//! `multiscopic capture` where there is no V4L2.

use std::process::ExitCode;

use clap::Args;
use multiscopic::{Error, Result};

/// Takes the frames of a rig (on Linux)
#[derive(Clone, Debug, Args)]
pub struct Capture {
    /// What it would take
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    arguments: Vec<String>,
}

impl Capture {
    /// Runs the command.
    pub fn run(&self) -> Result<ExitCode> {
        Err(Error::Usage("frames are captured on Linux, by a multiscopic with its feature v4l2".into()))
    }
}
