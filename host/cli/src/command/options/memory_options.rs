//! How much memory the program may take, and what is told of it.

use clap::{Args, value_parser};
use multiscopic::{Alignment, Frames, Result, memory_limit};

use crate::command::terminal;

/// From how many megabytes on the user is told.
const MUCH: u64 = 1000;

/// The memory that the program may take.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Machine")]
pub struct MemoryOptions {
    /// Refuse what takes more memory, in megabytes [default: what is available]
    #[arg(long, value_name = "MB", value_parser = value_parser!(u64).range(1..))]
    max_memory: Option<u64>,
}

impl MemoryOptions {
    /// The most bytes that may be taken. `None` if nothing limits them.
    pub fn most_bytes(&self) -> Option<u64> {
        memory_limit(self.max_memory)
    }

    /// Checks that the alignment of `frames` may take what it takes.
    ///
    /// # Errors
    /// Those of [`Alignment::check_memory`].
    pub fn check_alignment(&self, frames: &Frames) -> Result<()> {
        say_if_much("aligning", Alignment::bytes(frames));
        Alignment::check_memory(frames, self.most_bytes())
    }
}

/// Tells how much memory is taken, if it is much.
pub fn say_if_much(what: &str, bytes: u64) {
    let megabytes = bytes.div_ceil(1_000_000);
    if megabytes >= MUCH {
        terminal::say(&format!("{what} takes about {megabytes} MB of memory"));
    }
}
