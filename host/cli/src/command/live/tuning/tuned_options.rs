//! The options of `match` that the page sets, read as `match` reads them.

use clap::Parser;
use multiscopic::{Error, Result};

use crate::command::options::MatchingOptions;

/// A command line of nothing but matching options.
#[derive(Clone, Debug, Parser)]
#[command(no_binary_name = true, disable_help_flag = true)]
pub struct TunedOptions {
    #[command(flatten)]
    pub matching: MatchingOptions,
}

impl TunedOptions {
    /// Reads the words of a command line.
    pub fn parse(words: &[String]) -> Result<TunedOptions> {
        TunedOptions::try_parse_from(words).map_err(|error| {
            let text = error.render().to_string();
            let first = text.lines().next().unwrap_or_default();
            Error::Usage(first.trim_start_matches("error: ").to_owned())
        })
    }
}
