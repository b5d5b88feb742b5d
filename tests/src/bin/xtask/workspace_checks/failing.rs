//! Provokes failures, many at random: kills commands and checks what they leave behind, and captures and matches on simulated
//! hardware that fails.

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
}

impl Crashing {
    /// As often as by default.
    pub const MANY: Crashing = Crashing { moments: 200, seed: 1 };

    /// Kills all commands.
    #[cfg(unix)]
    pub fn run(&self) -> Result<()> {
        use crate::system::built_program;
        use multiscopic_reference::split_mix::Random;
        use multiscopic_tests::killed_commands::VICTIMS;
        use std::time::Instant;

        multiscopic_tests::program::use_binary(built_program()?);
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

/// The number of captures.
#[derive(Args)]
pub struct Soaking {
    /// Captures in all
    #[arg(long, value_name = "N", default_value_t = 10_000)]
    captures: usize,

    /// Rigs that capture at the same time
    #[arg(long, value_name = "N", default_value_t = 16)]
    rigs: usize,

    /// Seed of the troubles
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

impl Soaking {
    /// As many captures as by default.
    pub const LONG: Soaking = Soaking { captures: 10_000, rigs: 16, seed: 1 };

    /// Captures, and prints what the process takes meanwhile.
    #[cfg(target_os = "linux")]
    pub fn run(&self) -> Result<()> {
        use multiscopic_tests::soak::{Soak, Usage};
        use std::time::Instant;

        anyhow::ensure!(self.captures > 0 && self.rigs > 0, "there is nothing to do without captures or rigs");
        let captures_per_round = (self.captures / self.rigs / 20).clamp(1, 50);
        let soak = Soak { captures: self.captures, rigs: self.rigs, captures_per_round, seed: self.seed };
        let start = Instant::now();
        let troubles = soak.run(|&Usage { captures, resident_kib, descriptors, threads }| {
            let seconds = start.elapsed().as_secs();
            println!(
                "soak: {captures} captures in {seconds} s: {resident_kib} KiB, {descriptors} descriptors, {threads} threads"
            );
        });
        for (name, count) in troubles {
            println!("soak: {count} with trouble: {name}");
        }
        Ok(())
    }

    /// Reports that nothing can be watched.
    #[cfg(not(target_os = "linux"))]
    pub fn run(&self) -> Result<()> {
        println!("soak: skipped, only Linux tells what a process takes");
        Ok(())
    }
}
