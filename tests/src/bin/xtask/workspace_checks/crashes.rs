//! Kills commands at random moments, and checks what they leave behind.

use std::time::Instant;

use anyhow::Result;
use clap::Args;

/// The number of times to kill each command.
#[derive(Args)]
pub struct Crashing {
    /// Moments at which each command is killed
    #[arg(long, value_name = "N", default_value_t = 200)]
    moments: usize,

    /// Seed of the moments
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    /// Kill the optimised program, which users run, instead of the one in debug
    #[arg(long)]
    release: bool,
}

impl Crashing {
    /// As often as by default.
    pub const MANY: Crashing = Crashing { moments: 200, seed: 1, release: false };

    /// Kills all commands.
    #[cfg(unix)]
    pub fn run(&self) -> Result<()> {
        use crate::system::{built_optimized_program, built_program};
        use multiscopic_reference::split_mix::Random;
        use multiscopic_tests::killed_commands::VICTIMS;

        // In debug, it is built as the runner itself, which takes no second build of everything.
        let program = if self.release { built_optimized_program()? } else { built_program()? };
        multiscopic_tests::program::use_binary(program);
        for victim in VICTIMS {
            let start = Instant::now();
            let tally = victim.kill(self.moments, &mut Random(self.seed));
            println!(
                "crash: {}: killed {} of {} runs in {:.0} s: {} left everything, {} nothing, {} a folder that is marked incomplete, \
                 {} some outputs with the others whole under temporary names; {} left temporary files, which the next run removed",
                victim.name,
                tally.killed,
                self.moments,
                start.elapsed().as_secs_f64(),
                tally.complete,
                tally.killed - tally.complete - tally.unsealed - tally.parted,
                tally.unsealed,
                tally.parted,
                tally.with_leftovers,
            );
        }
        Ok(())
    }

    /// Reports that nothing can be killed.
    #[cfg(not(unix))]
    pub fn run(&self) -> Result<()> {
        println!("crash: skipped, it needs a system of the Unix family");
        Ok(())
    }
}
