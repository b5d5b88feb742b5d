//! Captures and matches on simulated hardware that fails at random.

use anyhow::Result;
use clap::Args;

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
