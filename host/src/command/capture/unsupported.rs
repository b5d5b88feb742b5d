//! `multiscopic capture` in a build without V4L2.

use std::process::ExitCode;

use clap::Args;
use multiscopic::{Error, Result};

/// Captures the frames of a rig (Linux only)
#[derive(Clone, Debug, Args)]
pub struct UnsupportedCapture {
    /// Accepts whatever the supported command accepts, so that the error below is the one that shows.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    arguments: Vec<String>,
}

impl UnsupportedCapture {
    /// Refuses to run.
    pub fn run(&self) -> Result<ExitCode> {
        Err(Error::Usage("this build cannot capture: build multiscopic on Linux with the feature v4l2".into()))
    }
}
